"""RMSE of the taxels in the DIGIT's field of view, near it and beyond, by model and shape."""

from collections.abc import Sequence

from t2twin.report.data import ReportData
from t2twin.report.html import markup
from t2twin.report.html.labels import SPLIT_NAMES, name_of, shape_name
from t2twin.translate.evaluation.metrics.floors import GROUPS, NOISE_FLOOR
from t2twin.translate.evaluation.records import Evaluation, Figures, ModelRow

MAX_ROWS = 60
"""Maximum number of rows (assumed: a printed page)."""


def section(report: ReportData) -> str:
    """One table per split."""
    view = report.evaluation.view
    text = (
        f"The DIGIT's field of view is {view.width_mm:.1f} × {view.height_mm:.1f} mm. "
        f"{view.taxels.under} taxels are under it, {view.taxels.near} outside within one pitch "
        f"({view.pitch_mm:.1f} mm), and {view.taxels.beyond} beyond. Counts outside the field of "
        "view are extrapolated from the visible contact. RMSE of each group of taxels, counts."
    )
    if any(len(row.by_family) > MAX_ROWS for row in report.evaluation.models.values()):
        text += f" Shown are the {MAX_ROWS} families with the most pairs."
    tables = [_table(evaluation, split) for split, evaluation in report.evaluations.items()]
    return markup.section("by-view", "Error by field of view", [markup.paragraph(text), *tables])


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
    """Errors by shape, or by family: of the test split and of too many shapes."""
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
