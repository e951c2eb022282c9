"""The paper's table for this dataset, the paper's own figures below, and what they say."""

from typing import Any

from t2twin.report import markup
from t2twin.report.material import SHOWN, ReportData
from t2twin.report.names import name_of
from t2twin.translate.evaluation.baselines import MEAN_ARRAY, NEAREST_NEIGHBOUR
from t2twin.translate.evaluation.evaluate import LAYOUT_FLOOR, NOISE_FLOOR

PAPER = "Grella et al. 2023, on hardware"
SPLIT_NAMES = {"val": "Validation, unseen versions", "test": "Test, objects"}
WHERE = {"val": "On validation", "test": "On the objects"}
NONE = "–"

SHORT = (("rmse_counts", "{:,.0f}"), ("rmse_percent", "{:.2f}"), ("ssim", "{:.3f}"))
RATIOS = (
    ("ssim_contact", "SSIM in contact", "{:.3f}"),
    ("contact_iou", "Contact IoU", "{:.3f}"),
    ("centroid_error_mm", "Centroid, mm", "{:.2f}"),
    ("total_error_percent", "Total, %", "{:.1f}"),
)


def section(material: ReportData) -> str:
    """The two tables and the sentences that the numbers make."""
    metrics = {split: material.evaluated[split].metrics for split in SHOWN}
    how = metrics["val"]["bootstrap"]
    return markup.section(
        "results",
        "Results",
        [
            _paper_table(metrics),
            markup.paragraph(
                "The paper's figures are of another pair of sensors, real ones, and cannot be "
                "compared one to one with those above; it gives one SSIM a model, without saying "
                "of which set. What can be compared is how far each model is from a predictor that "
                "learns nothing. Mean array: the mean of the training set's arrays, whatever the "
                "picture. Nearest neighbour: the array of the training pair whose DIGIT picture is "
                f"nearest.{_floors(metrics['val'])} Pale: {100 * how['confidence']:.0f} % "
                "intervals, by bootstrap over shapes.",
                "note",
            ),
            markup.items(sentences(metrics)),
            _further_table(metrics),
            markup.paragraph(
                "What the paper's table lacks. A pixel is in contact above "
                f"{100 * metrics['val']['contact_level']:.0f} % of its own tactile image's "
                "maximum. SSIM in contact: over the true contact. IoU: intersection over union of "
                "the predicted and the true contact. Centroid: distance between the two tactile "
                "images' centroids. Total: mean error of the summed counts, in parts of their "
                "mean.",
                "note",
            ),
        ],
    )


def sentences(metrics: dict[str, dict[str, Any]]) -> list[str]:
    """What the numbers say, one sentence a split and a run.

    metrics: by split, what `evaluate` returns.
    """
    return [
        f"{WHERE[split]}, {name_of(name)} is {_against(model, models[MEAN_ARRAY])} the mean array "
        f"and {_against(model, models[NEAREST_NEIGHBOUR])} the nearest neighbour."
        for split, models in ((split, metrics[split]["models"]) for split in SHOWN)
        for name, model in models.items()
        if "run" in model
    ]


def _floors(metrics: dict[str, Any]) -> str:
    """What the rows are that no predictor is expected to pass."""
    said = ""
    if NOISE_FLOOR in metrics["models"]:
        said += " Noise floor: the same press read twice by the CySkin."
    if LAYOUT_FLOOR in metrics["models"]:
        said += (
            " Layout floor: the nearest to the true array that a tactile image of the layout "
            "trained on can say."
        )
    return said


def counts(value: float) -> str:
    return f"{value:,.0f}"


def _against(model: dict[str, Any], other: dict[str, Any]) -> str:
    """As in "12.0 % below", by sqrt(L3)."""
    part = model["overall"]["rmse_counts"] / other["overall"]["rmse_counts"] - 1.0
    if abs(part) < 0.0005:
        return "level with"
    return f"{100 * abs(part):.1f} % {'below' if part < 0 else 'above'}"


def _paper_table(metrics: dict[str, dict[str, Any]]) -> str:
    full_scale = metrics["val"]["full_scale_counts"]
    heads = [
        [("", 1), *((_split_title(split, metrics[split]), 3) for split in SHOWN)],
        [
            ("", 1),
            *[("sqrt(L3), counts", 1), (f"% of {full_scale:,.0f}", 1), ("SSIM", 1)] * len(SHOWN),
        ],
    ]
    here = []
    for name in metrics["val"]["models"]:
        models = [metrics[split]["models"][name] for split in SHOWN]
        here.append([name_of(name), *_cells([model["overall"] for model in models])])
        here.append(["", *(_span(m["interval"][key], how) for m in models for key, how in SHORT)])
    paper = [
        [name_of(name), *_cells([metrics[split]["paper"][name] for split in SHOWN], "{:.2f}")]
        for name in metrics["val"]["paper"]
    ]
    return markup.table(heads, [("This dataset, simulated", here), (PAPER, paper)])


def _cells(figures: list[dict[str, float]], ssim: str = "{:.3f}") -> list[str]:
    cells = []
    for figure in figures:
        cells.append(counts(figure["rmse_counts"]))
        cells.append(f"{figure['rmse_percent']:.2f} %")
        cells.append(_figure(figure.get("ssim"), ssim))
    return cells


def _further_table(metrics: dict[str, dict[str, Any]]) -> str:
    heads = [
        [("", 1), *((SPLIT_NAMES[split], len(RATIOS)) for split in SHOWN)],
        [("", 1), *[(title, 1) for _, title, _ in RATIOS] * len(SHOWN)],
    ]
    rows = []
    for name in metrics["val"]["models"]:
        models = [metrics[split]["models"][name] for split in SHOWN]
        rows.append(
            [
                name_of(name),
                *(_figure(m["overall"][k], how) for m in models for k, _, how in RATIOS),
            ]
        )
        rows.append(["", *(_span(m["interval"][k], how) for m in models for k, _, how in RATIOS)])
    return markup.table(heads, [("", rows)])


def _split_title(split: str, metrics: dict[str, Any]) -> str:
    return f"{SPLIT_NAMES[split]} ({metrics['pairs']:,} pairs)"


def _span(span: list[float] | None, how: str) -> str:
    return "" if span is None else f"{how.format(span[0])}–{how.format(span[1])}"


def _figure(value: float | None, how: str) -> str:
    return NONE if value is None else how.format(value)
