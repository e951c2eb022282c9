"""The report: one HTML page that needs nothing but itself."""

from collections.abc import Callable, Sequence
from html import escape
from pathlib import Path

from tqdm import tqdm

from t2twin.primitives_cad.writing import whole_file
from t2twin.report import (
    about,
    by_shape,
    by_view,
    curves,
    finding,
    forces,
    limits,
    lookalikes,
    pairs,
    qualitative,
    results,
    shapes,
)
from t2twin.report.report_data import ReportData, read_report_data

PAGE = "index.html"
TITLE = "Touch-to-touch translation on a simulated bench"

STYLE = """
:root { color-scheme: light; }
body { margin: 0 auto; max-width: 66rem; padding: 1rem; color: #1b1b1b; background: #fff;
  font: 1rem/1.5 system-ui, -apple-system, "Segoe UI", "Helvetica Neue", Arial, sans-serif; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: 1rem 0 0.5rem; }
h2 { font-size: 1.25rem; margin: 2.5rem 0 0.5rem; border-bottom: 1px solid #ccc; }
p, li { max-width: 46rem; }
nav { font-size: 0.9rem; }
nav a { margin-right: 0.9rem; color: #0b5394; white-space: nowrap; }
.note, figcaption { color: #444; font-size: 0.88rem; }
figure { margin: 1rem 0; }
figcaption { max-width: 46rem; margin-top: 0.2rem; }
img { display: block; width: 100%; height: auto; }
.wide { overflow-x: auto; }
.wide > img { min-width: 46rem; }
.grid { display: grid; grid-template-columns: repeat(auto-fill, minmax(19rem, 1fr));
  gap: 0.5rem 1.2rem; }
.grid figure { margin: 0.4rem 0; }
table { border-collapse: collapse; font-size: 0.92rem; margin: 0.8rem 0; }
th, td { padding: 0.22rem 0.7rem; vertical-align: top; }
th { font-weight: 600; text-align: left; }
.facts td, .facts th { border-bottom: 1px solid #e6e6e6; }
.facts th { white-space: nowrap; }
.figures { font-variant-numeric: tabular-nums; }
.figures thead th { border-bottom: 1px solid #999; text-align: right; vertical-align: bottom; }
.figures thead th:first-child { text-align: left; }
.figures thead tr:not(:last-child) th:empty { border-bottom: 0; }
.figures thead th[scope="colgroup"] { text-align: center; border-left: 1.2rem solid #fff; }
.figures tbody th { font-weight: 400; white-space: nowrap; }
.figures td { text-align: right; white-space: nowrap; border-bottom: 1px solid #eee; }
.figures tbody th { border-bottom: 1px solid #eee; }
.figures .span td, .figures .span th { color: #666; font-size: 0.82rem; padding-top: 0; }
.figures tr:has(+ .span) > * { border-bottom: 0; padding-bottom: 0; }
.figures .group th { font-weight: 600; padding-top: 0.7rem; border-bottom: 1px solid #999; }
@media print {
  body { max-width: none; font-size: 10pt; padding: 0; }
  nav { display: none; }
  .wide { overflow: visible; }
  .wide > img { min-width: 0; }
  .grid { grid-template-columns: 1fr 1fr; }
  table { font-size: 8pt; }
  th, td { padding: 0.12rem 0.35rem; }
  figure, tr { break-inside: avoid; }
  h2 { break-after: avoid; }
}
"""

LINKS = {
    "results": "Results",
    "finding": "The paper's finding",
    "by-view": "By view",
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

    data: a finished dataset with all three splits. runs: folders of finished trainings. evaluation:
    a folder of `t2twin evaluate --split both`, which is drawn where it is of these runs on this
    dataset; else the one in the folder `evaluate` beside `out` is, and where neither fits, the runs
    are evaluated into out/evaluate-val and out/evaluate-test. The findings go to out/findings.json.
    Raises T2TwinError, before anything is written, for a dataset or a run that is missing or
    unfinished, and a run that cannot give the dataset's taxel layout.
    """
    given = None if evaluation is None else Path(evaluation)
    folders = [Path(run) for run in runs]
    return draw_report(Path(out), read_report_data(Path(out), Path(data), folders, given))


def draw_report(out: Path, report: ReportData) -> Path:
    """Writes out/index.html of what was read for it, and returns its path."""
    sections: list[Callable[[], str]] = [
        lambda: about.section(report),
        lambda: results.section(report),
        lambda: finding.section(report),
        lambda: by_view.section(report),
        lambda: lookalikes.section(report),
        lambda: qualitative.section(report),
        lambda: pairs.section(report),
        lambda: shapes.section(),
        lambda: curves.section(report),
        lambda: forces.section(report),
        lambda: by_shape.section(report),
        lambda: limits.section(report),
    ]
    return write_page(out, TITLE, LINKS, sections)


def write_page(
    out: Path, title: str, links: dict[str, str], sections: list[Callable[[], str]]
) -> Path:
    """Writes out/index.html of sections, made one after the other; returns its path.

    links: the sections' names and titles, for the line at the top.
    """
    body = [section() for section in tqdm(sections, desc="report", unit="section")]
    path = out / PAGE
    with whole_file(path) as temporary:
        temporary.write_text(_page(title, links, body), encoding="utf-8")
    return path


def _page(title: str, named: dict[str, str], body: list[str]) -> str:
    links = " ".join(f'<a href="#{name}">{escape(text)}</a>' for name, text in named.items())
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
        f"<h1>{escape(title)}</h1>\n<nav>{links}</nav>\n" + "\n".join(body) + "\n</body>\n</html>\n"
    )
