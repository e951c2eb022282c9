"""sqrt(L3) of the taxels under the DIGIT's view, near it and beyond, by model and shape."""

from typing import Any

from t2twin.report import markup
from t2twin.report.material import SHOWN, ReportData
from t2twin.report.names import SPLIT_NAMES, name_of
from t2twin.translate.evaluation.evaluate import NOISE_FLOOR
from t2twin.translate.evaluation.field_of_view import GROUPS

BY = {"val": "by_shape", "test": "by_family"}
"""Validation by primitive, test by tool."""


def section(material: ReportData) -> str:
    """One table a split."""
    view = material.evaluated["val"].metrics["view"]
    taxels = view["taxels"]
    text = (
        f"The DIGIT sees {view['width_mm']:.1f} × {view['height_mm']:.1f} mm. Of the taxels "
        f"{taxels['under']} lie under that view, {taxels['near']} outside within one pitch of it "
        f"({view['pitch_mm']:.1f} mm), {taxels['beyond']} beyond. What a shape does outside the "
        "view is known only from what of it is seen. sqrt(L3) of each group alone, counts."
    )
    tables = [_table(material.evaluated[split].metrics, split) for split in SHOWN]
    return markup.section(
        "by-view", "Under the view and outside it", [markup.paragraph(text), *tables]
    )


def _table(metrics: dict[str, Any], split: str) -> str:
    models = {name: one for name, one in metrics["models"].items() if name != NOISE_FLOOR}
    heads = [
        [("", 1), *((name_of(name), len(GROUPS)) for name in models)],
        [("", 1), *[(group, 1) for group in GROUPS] * len(models)],
    ]
    whole = _row("all", [model["overall"] for model in models.values()])
    names = next(iter(models.values()))[BY[split]]
    each = [_row(name, [model[BY[split]][name] for model in models.values()]) for name in names]
    return markup.table(heads, [(SPLIT_NAMES[split].capitalize(), [whole, *each])])


def _row(name: str, figures: list[dict[str, Any]]) -> list[str]:
    return [name, *(_count(one[_key(group)]) for one in figures for group in GROUPS)]


def _key(group: str) -> str:
    return f"rmse_{group}_counts"


def _count(value: float | None) -> str:
    return "–" if value is None else f"{value:,.0f}"
