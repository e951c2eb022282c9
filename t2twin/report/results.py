"""The paper's table for this dataset, the paper's own figures below, and what they say.

RMSE is the root of the mean squared error of the counts, over pairs and taxels: the root of the
loss that the paper calls L3.
"""

from collections.abc import Mapping, Sequence

from t2twin.report import markup
from t2twin.report.names import name_of
from t2twin.report.report_data import SHOWN, ReportData
from t2twin.translate.evaluation.baselines import MEAN_ARRAY, NEAREST_NEIGHBOUR
from t2twin.translate.evaluation.layout_floor import LAYOUT_FLOOR
from t2twin.translate.evaluation.noise_floor import NOISE_FLOOR
from t2twin.translate.evaluation.records import (
    Evaluation,
    FigureName,
    Figures,
    Interval,
    ModelRow,
    PaperRow,
)

PAPER = "Grella et al. 2023, on hardware"
SPLIT_NAMES = {"val": "Validation, unseen versions", "test": "Test, objects"}
WHERE = {"val": "On validation", "test": "On the objects"}
NONE = "–"

WHAT = (
    "RMSE is the root of the mean squared error of the counts, over all pairs and taxels; the "
    "paper writes it as sqrt(L3). SSIM is the structural similarity (Wang et al. 2004) of the "
    "tactile image of the predicted counts with that of the true ones, averaged over the pairs; 1 "
    "is the same image."
)
"""Said once, above the tables."""

SHORT: tuple[tuple[FigureName, str], ...] = (
    ("rmse_counts", "{:,.0f}"),
    ("rmse_percent", "{:.2f}"),
    ("ssim", "{:.3f}"),
)
RATIOS: tuple[tuple[FigureName, str, str], ...] = (
    ("ssim_contact", "SSIM in contact", "{:.3f}"),
    ("contact_iou", "Contact IoU", "{:.3f}"),
    ("centroid_error_mm", "Centroid, mm", "{:.2f}"),
    ("total_error_percent", "Total, %", "{:.1f}"),
)


def section(report: ReportData) -> str:
    """The two tables and the sentences that the numbers make."""
    evaluations = report.evaluations
    val = evaluations["val"]
    return markup.section(
        "results",
        "Results",
        [
            markup.paragraph(WHAT),
            _paper_table(evaluations),
            markup.paragraph(
                "The paper's figures are of another pair of sensors, real ones, and cannot be "
                "compared one to one with those above; it gives one SSIM a model, without saying "
                "of which set. What can be compared is how far each model is from a predictor that "
                "learns nothing. Mean array: the mean of the training set's arrays, whatever the "
                "picture. Nearest neighbour: the array of the training pair whose DIGIT picture is "
                f"nearest.{_floors(val)} Pale: {100 * val.bootstrap.confidence:.0f} % "
                "intervals, by bootstrap over shapes.",
                "note",
            ),
            markup.items(sentences({split: evaluations[split].models for split in SHOWN})),
            _further_table(evaluations),
            markup.paragraph(
                "What the paper's table lacks. A pixel is in contact above "
                f"{100 * val.contact_level:.0f} % of its own tactile image's "
                "maximum. SSIM in contact: over the true contact. IoU: intersection over union of "
                "the predicted and the true contact. Centroid: distance between the two tactile "
                "images' centroids. Total: mean error of the summed counts, in parts of their "
                "mean.",
                "note",
            ),
        ],
    )


def sentences(models: Mapping[str, Mapping[str, ModelRow]]) -> list[str]:
    """What the numbers say, one sentence a split and a run. models: by split and name."""
    return [
        f"{WHERE[split]}, {name_of(name)} is {_against(row, rows[MEAN_ARRAY])} the mean array "
        f"and {_against(row, rows[NEAREST_NEIGHBOUR])} the nearest neighbour."
        for split, rows in ((split, models[split]) for split in SHOWN)
        for name, row in rows.items()
        if row.run is not None
    ]


def _floors(evaluation: Evaluation) -> str:
    """What the rows are that no predictor is expected to pass."""
    said = ""
    if NOISE_FLOOR in evaluation.models:
        said += " Noise floor: the same press read twice by the CySkin."
    if LAYOUT_FLOOR in evaluation.models:
        said += (
            " Layout floor: the nearest to the true array that a tactile image of the layout "
            "trained on can say."
        )
    return said


def counts(value: float) -> str:
    return f"{value:,.0f}"


def _against(model: ModelRow, other: ModelRow) -> str:
    """As in "12.0 % below", by RMSE."""
    part = model.overall.rmse_counts / other.overall.rmse_counts - 1.0
    if abs(part) < 0.0005:
        return "level with"
    return f"{100 * abs(part):.1f} % {'below' if part < 0 else 'above'}"


def _paper_table(evaluations: Mapping[str, Evaluation]) -> str:
    val = evaluations["val"]
    titles = [("RMSE, counts", 1), (f"% of {val.full_scale_counts:,.0f}", 1), ("SSIM", 1)]
    heads = [
        [("", 1), *((_split_title(split, evaluations[split]), 3) for split in SHOWN)],
        [("", 1), *titles * len(SHOWN)],
    ]
    here = []
    for name in val.models:
        rows = [evaluations[split].models[name] for split in SHOWN]
        here.append([name_of(name), *_cells([row.overall for row in rows])])
        here.append(["", *(_span(r.interval.value(key), how) for r in rows for key, how in SHORT)])
    paper = [
        [name_of(name), *_cells([evaluations[split].paper[name] for split in SHOWN], "{:.2f}")]
        for name in val.paper
    ]
    return markup.table(heads, [("This dataset, simulated", here), (PAPER, paper)])


def _cells(rows: Sequence[Figures | PaperRow], ssim: str = "{:.3f}") -> list[str]:
    cells = []
    for row in rows:
        cells.append(counts(row.rmse_counts))
        cells.append(f"{row.rmse_percent:.2f} %")
        cells.append(_figure(row.ssim, ssim))
    return cells


def _further_table(evaluations: Mapping[str, Evaluation]) -> str:
    heads = [
        [("", 1), *((SPLIT_NAMES[split], len(RATIOS)) for split in SHOWN)],
        [("", 1), *[(title, 1) for _, title, _ in RATIOS] * len(SHOWN)],
    ]
    lines = []
    for name in evaluations["val"].models:
        rows = [evaluations[split].models[name] for split in SHOWN]
        figures = [_figure(r.overall.value(key), how) for r in rows for key, _, how in RATIOS]
        spans = [_span(r.interval.value(key), how) for r in rows for key, _, how in RATIOS]
        lines += [[name_of(name), *figures], ["", *spans]]
    return markup.table(heads, [("", lines)])


def _split_title(split: str, evaluation: Evaluation) -> str:
    return f"{SPLIT_NAMES[split]} ({evaluation.pairs:,} pairs)"


def _span(span: Interval | None, how: str) -> str:
    return "" if span is None else f"{how.format(span.low)}–{how.format(span.high)}"


def _figure(value: float | None, how: str) -> str:
    return NONE if value is None else how.format(value)
