"""The report of runs: one self-contained HTML page."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from t2twin.core import arguments
from t2twin.report.data import ReportData, read_report_data
from t2twin.report.dataset import forces, pairs
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
IMPORTED_TITLE = "Touch-to-touch translation of the pairs in {}"

DATASET, RUNS = "report/templates/dataset", "report/templates/runs"
"""Folders of the templates; two sections are also in the report of a dataset."""

SECTIONS: dict[str, tuple[str, str, Callable[[ReportData], Mapping[str, Any]]]] = {
    "summary": ("", RUNS, overview.summary),
    "about": ("", RUNS, overview.about),
    "results": ("Results", RUNS, results.section),
    "finding": ("The paper's finding", RUNS, results.finding),
    "by-force": ("By force", RUNS, breakdowns.by_force),
    "uncertainty": ("Uncertainty", RUNS, uncertainty.section),
    "samples": ("Samples", RUNS, qualitative.section),
    "pairs": ("Pairs", DATASET, pairs.section),
    "curves": ("Learning", RUNS, learning_curves.section),
    "forces": ("Forces", DATASET, forces.section),
    "by-shape": ("By shape", RUNS, breakdowns.by_shape),
    "limits": ("Limits", RUNS, overview.limits),
}
"""Title of the link, folder of the template, and function that computes the values."""

LINKS = {name: title for name, (title, _, _) in SECTIONS.items() if title}


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
    info, hidden = report.info, set()
    if not info.is_simulated:
        hidden.add("forces")  # imported pairs have neither contact forces nor depths
    if not report.gap and not any(one.findings for one in report.evaluations.values()):
        hidden.add("finding")  # about both translators
    if not any(one.has_forces for one in report.evaluations.values()):
        hidden.add("by-force")
    if not uncertainty.has_uncertainty(report.evaluations):
        hidden.add("uncertainty")
    sections: Sections = {
        name: (f"{folder}/{name}.html", partial(compute, report))
        for name, (_, folder, compute) in SECTIONS.items()
        if name not in hidden
    }
    title = TITLE if info.is_simulated else IMPORTED_TITLE.format(report.data)
    if info.is_simulated and not info.is_protocol:
        title += f", world {info.world_name}"
    return write_page(out, title, sections, LINKS, report=report, dataset=report)
