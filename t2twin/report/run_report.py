"""The report of runs: one self-contained HTML page."""

from collections.abc import Callable, Sequence
from pathlib import Path

from t2twin.core import arguments
from t2twin.report.data import ReportData, read_report_data
from t2twin.report.dataset import contents, forces, pairs
from t2twin.report.html.page import write_page
from t2twin.report.sections import (
    by_force,
    by_shape,
    by_view,
    irreducible_error,
    learning_curves,
    limits,
    paper_finding,
    provenance,
    qualitative,
    results,
    summary,
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
    sections: dict[str, Callable[[], str]] = {
        "about": lambda: provenance.section(report, {LINKS[n]: why for n, why in omitted.items()}),
        "results": lambda: results.section(report),
        "finding": lambda: paper_finding.section(report),
        "by-force": lambda: by_force.section(report),
        "by-view": lambda: by_view.section(report),
        "uncertainty": lambda: uncertainty.section(report),
        "irreducible-error": lambda: irreducible_error.section(report),
        "samples": lambda: qualitative.section(report),
        "pairs": lambda: pairs.section(report),
        "shapes": contents.contact_sheet_section,
        "curves": lambda: learning_curves.section(report),
        "forces": lambda: forces.section(report),
        "by-shape": lambda: by_shape.section(report),
        "limits": lambda: limits.section(report),
    }
    if not any(one.has_forces for one in report.evaluations.values()):
        del sections["by-force"]
    if not uncertainty.has_uncertainty(report.evaluations):
        del sections["uncertainty"]
    return write_page(
        out,
        _title(report),
        lambda: summary.section(report),
        {name: section for name, section in sections.items() if name not in omitted},
        LINKS,
    )


def omitted_sections(report: ReportData) -> dict[str, str]:
    """Names of the omitted sections, with the data that they would require.

    The contact sheet shows the shapes of the paper's protocol. The page does not list the sections
    on force and uncertainty as omitted.
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
