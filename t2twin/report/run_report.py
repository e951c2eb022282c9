"""The report of runs: one self-contained HTML page."""

from collections.abc import Sequence
from pathlib import Path

from t2twin.core import arguments
from t2twin.report.data import ReportData, read_report_data
from t2twin.report.dataset import contents, forces, pairs
from t2twin.report.html.page import Sections, write_page
from t2twin.report.sections import (
    breakdowns,
    learning_curves,
    overview,
    qualitative,
    results,
    uncertainty,
)

TITLE = "Touch-to-touch translation on a simulated bench"
WORLD_TITLE = TITLE + ", world {}"
IMPORTED_TITLE = "Touch-to-touch translation of the pairs in {}"

LINKS = {
    "results": "Results",
    "finding": "The paper's finding",
    "by-force": "By force",
    "by-view": "By view",
    "uncertainty": "Uncertainty",
    "irreducible-error": "Irreducible error",
    "samples": "Samples",
    "pairs": "Pairs",
    "shapes": "Shapes",
    "curves": "Learning",
    "forces": "Forces",
    "by-shape": "By shape",
    "limits": "Limits",
}

SIMULATED_ONLY = {
    "by-view": "position of the image relative to the taxels",
    "shapes": "the shapes",
    "forces": "contact forces and depths",
}
"""Sections of simulated datasets only, with the data that imported pairs lack."""


def write_report(
    out: str | Path,
    data: str | Path,
    runs: Sequence[str | Path],
    evaluation: str | Path | None = None,
) -> Path:
    """Writes out/index.html, a self-contained page, and returns its path.

    data: a finished dataset, simulated or imported, with training pairs and validation pairs, test
    pairs or both. runs: folders of finished trainings. evaluation: a folder of
    `t2twin evaluate --split both`. The report uses it if it evaluates these runs on this dataset,
    else the folder `evaluate` next to `out`; else it evaluates the runs into out/evaluate-val and
    out/evaluate-test. The findings are written to out/findings.json.
    Raises T2TwinError, before anything is written, for a missing or unfinished dataset or run, and
    for a run that cannot predict the dataset's taxel layout.
    """
    folder, data = arguments.path(out, "out"), arguments.path(data, "data")
    given = None if evaluation is None else arguments.path(evaluation, "evaluation")
    report = read_report_data(folder, data, arguments.paths(runs, "runs"), given)
    return draw_report(folder, report)


def draw_report(out: Path, report: ReportData) -> Path:
    """Writes out/index.html and returns its path."""
    omitted = omitted_sections(report)
    titles = {LINKS[name]: why for name, why in omitted.items()}
    values = {
        "summary": lambda: overview.summary(report),
        "about": lambda: overview.about(report, titles),
        "results": lambda: results.section(report),
        "finding": lambda: results.finding(report),
        "by-force": lambda: breakdowns.by_force(report),
        "by-view": lambda: breakdowns.by_view(report),
        "uncertainty": lambda: uncertainty.section(report),
        "irreducible-error": lambda: uncertainty.irreducible_error(report),
        "samples": lambda: qualitative.section(report),
        "pairs": lambda: pairs.section(report),
        "shapes": contents.contact_sheet,
        "curves": lambda: learning_curves.section(report),
        "forces": lambda: forces.section(report),
        "by-shape": lambda: breakdowns.by_shape(report),
        "limits": lambda: overview.limits(report),
    }
    if not any(one.has_forces for one in report.evaluations.values()):
        del values["by-force"]
    if not uncertainty.has_uncertainty(report.evaluations):
        del values["uncertainty"]
    sections: Sections = {
        name: (_template(name), compute) for name, compute in values.items() if name not in omitted
    }
    return write_page(out, _title(report), sections, LINKS, report=report, dataset=report)


def _template(name: str) -> str:
    """Template of a section; two of them are also in the report of a dataset."""
    return f"report/templates/{'dataset' if name in ('pairs', 'forces') else 'runs'}/{name}.html"


def omitted_sections(report: ReportData) -> dict[str, str]:
    """Names of the omitted sections, with the data that they would require.

    The contact sheet shows the shapes of the paper's protocol. The sections on force and
    uncertainty are not listed.
    """
    omitted = {} if report.info.is_simulated else dict(SIMULATED_ONLY)
    if not report.info.is_protocol:
        omitted["shapes"] = SIMULATED_ONLY["shapes"]
    if any(evaluation.irreducible_error is None for evaluation in report.evaluations.values()):
        omitted["irreducible-error"] = "noise of the images"
    if not report.gap and not any(one.findings for one in report.evaluations.values()):
        omitted["finding"] = "runs of both translators"
    return omitted


def _title(report: ReportData) -> str:
    if report.info.is_protocol:
        return TITLE
    if report.info.is_simulated:
        return WORLD_TITLE.format(report.info.world_name)
    return IMPORTED_TITLE.format(report.data)
