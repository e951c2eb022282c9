"""RMSE of the taxels under the DIGIT's view, near it and beyond, by model and shape."""

from collections.abc import Sequence

from t2twin.report.data import ReportData
from t2twin.report.html import markup
from t2twin.report.html.labels import SPLIT_NAMES, name_of, shape_name
from t2twin.translate.evaluation.metrics.floors import GROUPS, NOISE_FLOOR
from t2twin.translate.evaluation.records import Evaluation, Figures, ModelRow

MAX_ROWS = 60
"""Shapes or families that have a row (assumed: a page of paper)."""


def section(report: ReportData) -> str:
    """One table a split."""
    view = report.evaluation.view
    text = (
        f"The DIGIT sees {view.width_mm:.1f} × {view.height_mm:.1f} mm. Of the taxels "
        f"{view.taxels.under} lie under that view, {view.taxels.near} outside within one pitch of "
        f"it ({view.pitch_mm:.1f} mm), {view.taxels.beyond} beyond. What a shape does outside the "
        "view is known only from what of it is seen. RMSE of each group alone, counts."
    )
    if any(len(row.by_family) > MAX_ROWS for row in report.evaluation.models.values()):
        text += f" Of the families the {MAX_ROWS} with most pairs are given."
    tables = [_table(evaluation, split) for split, evaluation in report.evaluations.items()]
    return markup.section(
        "by-view", "Under the view and outside it", [markup.paragraph(text), *tables]
    )


def _table(evaluation: Evaluation, split: str) -> str:
    models = {name: row for name, row in evaluation.models.items() if name != NOISE_FLOOR}
    heads = [
        [("", 1), *((name_of(name), len(GROUPS)) for name in models)],
        [("", 1), *[(group, 1) for group in GROUPS] * len(models)],
    ]
    parts = [_by(row, split) for row in models.values()]
    whole = _row("all", [row.overall for row in models.values()])
    each = [_row(shape_name(name), [part[name] for part in parts]) for name in parts[0]]
    return markup.table(heads, [(SPLIT_NAMES[split].capitalize(), [whole, *each])])


def _by(row: ModelRow, split: str) -> dict[str, Figures]:
    """Validation by primitive, test by tool; of too many shapes by family, the largest first."""
    if split != "test" and 0 < len(row.by_shape) <= MAX_ROWS:
        return row.by_shape
    largest = sorted(row.by_family.items(), key=lambda item: -item[1].pairs)[:MAX_ROWS]
    return row.by_family if len(row.by_family) <= MAX_ROWS else dict(largest)


def _row(name: str, figures: Sequence[Figures]) -> list[str]:
    cells = [name]
    for one in figures:
        groups = (one.rmse_under_counts, one.rmse_near_counts, one.rmse_beyond_counts)
        cells += [_count(value) for value in groups]
    return cells


def _count(value: float | None) -> str:
    return "–" if value is None else f"{value:,.0f}"
