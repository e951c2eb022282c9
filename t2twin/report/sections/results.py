"""The paper's table for this dataset, with the paper's values, and the paper's finding.

RMSE is the root of the mean squared error of the counts over pairs and taxels: the square root of
the paper's loss L3.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from t2twin.report.data import ReportData
from t2twin.report.html.labels import SPLIT_NAMES, name_of
from t2twin.translate.evaluation.findings import DIFFERENCES
from t2twin.translate.evaluation.records import (
    Evaluation,
    FigureName,
    Figures,
    Finding,
    Interval,
    PaperRow,
)
from t2twin.translate.evaluation.table import FORMS, background_lines

PAPER = "Grella et al. 2023, on hardware"
TITLES = {"val": "Validation, unseen versions", "test": "Test, objects"}
"""Titles of the splits of the paper's protocol."""

NONE = "–"

Columns = tuple[tuple[FigureName, str, str], ...]
"""Figures of the tables: name, title and format."""

MAIN: Columns = (
    ("rmse_counts", "RMSE, counts", "{:,.0f}"),
    ("rmse_percent", "% of {full_scale:,.0f}", "{:.2f} %"),
    ("ssim", "SSIM", "{:.3f}"),
)
FURTHER: Columns = (
    ("ssim_contact", "SSIM in contact", "{:.3f}"),
    ("contact_iou", "Contact IoU", "{:.3f}"),
    ("centroid_error_mm", "Centroid, mm", "{:.2f}"),
    ("total_error_percent", "Total, %", "{:.1f}"),
    ("rmse_under_counts", "Under view", "{:,.0f}"),
    ("rmse_near_counts", "Near it", "{:,.0f}"),
    ("rmse_beyond_counts", "Beyond", "{:,.0f}"),
)
PAPER_MAIN: Columns = (*MAIN[:2], ("ssim", "SSIM", "{:.2f}"))


def section(report: ReportData) -> dict[str, Any]:
    """Two tables of the figures."""
    evaluations, first = report.evaluations, report.evaluation
    titles = {
        split: TITLES[split] if report.info.is_protocol else SPLIT_NAMES[split].capitalize()
        for split in evaluations
    }
    with_pairs = {s: f"{titles[s]} ({one.pairs:,} pairs)" for s, one in evaluations.items()}
    main = [("This dataset" + ", simulated" * report.info.is_simulated, _rows(evaluations, MAIN))]
    if first.paper:
        paper = [
            [name_of(name), *_cells([one.paper[name] for one in evaluations.values()], PAPER_MAIN)]
            for name in first.paper
        ]
        main.append((PAPER, paper))
    return {
        "main": (_heads(with_pairs, MAIN, first.full_scale_counts), main),
        "further": (_heads(titles, FURTHER), [("", _rows(evaluations, FURTHER))]),
        "background_lines": background_lines(first),
    }


def _heads(titles: Mapping[str, str], figures: Columns, full_scale: float = 0.0) -> list[list]:
    """Two rows: splits, and figures of each split."""
    columns = [title.format(full_scale=full_scale) for _, title, _ in figures]
    return [
        ["", *((title, len(columns)) for title in titles.values())],
        ["", *columns * len(titles)],
    ]


def _rows(evaluations: Mapping[str, Evaluation], figures: Columns) -> list[list[str]]:
    """Figures of the models that all splits have, with intervals in additional rows."""
    each = evaluations.values()
    rows = []
    for name in next(iter(each)).models:
        if all(name in one.models for one in each):
            models = [one.models[name] for one in each]
            rows.append([name_of(name), *_cells([model.overall for model in models], figures)])
            spans = ((m.interval[key], how) for m in models for key, _, how in figures)
            rows.append(["", *(_span(span, how.removesuffix(" %")) for span, how in spans)])
    return rows


def _cells(rows: Sequence[Figures | PaperRow], figures: Columns) -> list[str]:
    values = ((getattr(row, key), how) for row in rows for key, _, how in figures)
    return [NONE if value is None else how.format(value) for value, how in values]


def _span(span: Interval | None, how: str) -> str:
    return "" if span is None else f"{how.format(span.low)}–{how.format(span.high)}"


def finding(report: ReportData) -> dict[str, Any]:
    """Answers to the paper's statements, with bootstrap intervals."""
    return {
        "heads": [["", "Answer", "Difference", "Interval", "Figures"]],
        "rows": finding_rows(report.evaluations, report.gap),
    }


def finding_rows(
    evaluations: Mapping[str, Evaluation], gap: Mapping[str, Finding]
) -> list[tuple[str, list[list[str]]]]:
    """Rows by question: split or model, answer, difference, interval, figures.

    evaluations: by split. gap: differences between the splits. Questions about both models require
    both.
    """
    found = [
        (SPLIT_NAMES[split], evaluation.findings[name])
        for name in DIFFERENCES
        for split, evaluation in evaluations.items()
        if name in evaluation.findings
    ]
    groups: dict[str, list[list[str]]] = {}
    for title, one in (*found, *((name_of(one.model or ""), one) for one in gap.values())):
        groups.setdefault(one.question, []).append(_finding(title, one))
    return list(groups.items())


def _finding(title: str, finding: Finding) -> list[str]:
    how, span = FORMS[finding.figure].replace(":.0f", ":,.0f"), finding.interval
    figures = ", ".join(
        f"{SPLIT_NAMES.get(name) or name_of(name)} {how.format(value)}"
        for name, value in finding.figures.items()
    )
    if finding.percent_of_mean_array is not None:
        percents = (f"{finding.percent_of_mean_array[name]:.0f} %" for name in finding.figures)
        figures += f"; {' and '.join(percents)} of the mean array's"
    signed = [how.format(value).replace("-", "−") for value in (finding.difference, *(span or ()))]
    return [title, finding.answer, signed[0], " to ".join(signed[1:]) or "none", figures]
