"""The report: one HTML page that needs nothing but itself."""

from collections.abc import Callable, Mapping, Sequence
from html import escape
from pathlib import Path

from t2twin.core import arguments
from t2twin.core.files import locked, whole_file
from t2twin.core.progress import Progress
from t2twin.report.data import PAGE, ReportData, read_report_data
from t2twin.report.dataset import forces, pairs, shapes
from t2twin.report.html.style import STYLE
from t2twin.report.omitted import omitted_sections
from t2twin.report.sections import (
    by_force,
    by_shape,
    by_view,
    calibration,
    irreducible_error,
    learning_curves,
    limits,
    paper_finding,
    provenance,
    qualitative,
    results,
    summary,
)

TITLE = "Touch-to-touch translation on a simulated bench"
WORLD_TITLE = TITLE + ", world {}"
IMPORTED_TITLE = "Touch-to-touch translation of the pairs in {}"

LINKS = {
    "results": "Results",
    "finding": "The paper's finding",
    "by-force": "By force",
    "by-view": "By view",
    "sureness": "How sure",
    "lookalikes": "Look-alikes",
    "samples": "Samples",
    "pairs": "Pairs",
    "shapes": "Shapes",
    "curves": "Learning",
    "forces": "Forces",
    "by-shape": "By shape",
    "limits": "Limits",
}


def write_report(
    out: str | Path,
    data: str | Path,
    runs: Sequence[str | Path],
    evaluation: str | Path | None = None,
) -> Path:
    """Writes out/index.html, with every picture in it, and returns its path.

    data: a finished dataset, simulated or imported, with training pairs and those of validation,
    test or both. runs: folders of finished trainings. evaluation:
    a folder of `t2twin evaluate --split both`, which is drawn where it is of these runs on this
    dataset; else the one in the folder `evaluate` beside `out` is, and where neither fits, the runs
    are evaluated into out/evaluate-val and out/evaluate-test. The findings go to out/findings.json.
    Raises T2TwinError, before anything is written, for a dataset or a run that is missing or
    unfinished, and a run that cannot give the dataset's taxel layout.
    """
    folder, data = arguments.path(out, "out"), arguments.path(data, "data")
    given = None if evaluation is None else arguments.path(evaluation, "evaluation")
    report = read_report_data(folder, data, arguments.paths(runs, "runs"), given)
    return draw_report(folder, report)


def draw_report(out: Path, report: ReportData) -> Path:
    """Writes out/index.html of what was read for it, and returns its path."""
    missing = omitted_sections(report)
    about_titles = {LINKS[name]: what for name, what in missing.items()}
    sections: dict[str, Callable[[], str]] = {
        "about": lambda: provenance.section(report, about_titles),
        "results": lambda: results.section(report),
        "finding": lambda: paper_finding.section(report),
        "by-force": lambda: by_force.section(report),
        "by-view": lambda: by_view.section(report),
        "sureness": lambda: calibration.section(report),
        "lookalikes": lambda: irreducible_error.section(report),
        "samples": lambda: qualitative.section(report),
        "pairs": lambda: pairs.section(report),
        "shapes": lambda: shapes.section(),
        "curves": lambda: learning_curves.section(report),
        "forces": lambda: forces.section(report),
        "by-shape": lambda: by_shape.section(report),
        "limits": lambda: limits.section(report),
    }
    if not any(one.has_forces for one in report.evaluations.values()):
        del sections["by-force"]
    if not calibration.has_uncertainty(report.evaluations):
        del sections["sureness"]
    return write_page(
        out,
        _title(report),
        lambda: summary.section(report),
        {name: section for name, section in sections.items() if name not in missing},
        LINKS,
    )


def _title(report: ReportData) -> str:
    if report.info.is_protocol:
        return TITLE
    if report.info.is_simulated:
        return WORLD_TITLE.format(report.info.world_name)
    return IMPORTED_TITLE.format(report.data)


def write_page(
    out: Path,
    title: str,
    opening: Callable[[], str],
    sections: Mapping[str, Callable[[], str]],
    titles: Mapping[str, str],
) -> Path:
    """Writes out/index.html and returns its path.

    opening: what stands above the line of links. sections: by name, made one after the other.
    titles: of the links to them, by name.
    """
    makers = Progress([opening, *sections.values()], desc="report", unit="section")
    above, *body = [maker() for maker in makers]
    links = {name: titles[name] for name in sections if name in titles}
    path = out / PAGE
    with locked(path.parent), whole_file(path) as temporary:
        temporary.write_text(_page(title, above, links, body), encoding="utf-8")
    return path


def _page(title: str, above: str, named: Mapping[str, str], body: list[str]) -> str:
    links = " ".join(f'<a href="#{name}">{escape(text)}</a>' for name, text in named.items())
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
        f"<h1>{escape(title)}</h1>\n{above}\n<nav>{links}</nav>\n"
        + "\n".join(body)
        + "\n</body>\n</html>\n"
    )
