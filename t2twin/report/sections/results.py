"""The paper's table for this dataset, with the paper's values and a summary.

RMSE is the root of the mean squared error of the counts over pairs and taxels: the square root of
the paper's loss L3.
"""

from collections.abc import Mapping, Sequence

from t2twin.report.data import ReportData
from t2twin.report.html import markup
from t2twin.report.html.labels import SPLIT_NAMES, name_of
from t2twin.translate.evaluation.metrics.baselines import MEAN_ARRAY, NEAREST_NEIGHBOR
from t2twin.translate.evaluation.metrics.floors import LAYOUT_FLOOR, NOISE_FLOOR
from t2twin.translate.evaluation.metrics.forces import MEAN_ARRAY_OF_FORCE
from t2twin.translate.evaluation.records import (
    Evaluation,
    FigureName,
    Figures,
    Interval,
    ModelRow,
    PaperRow,
)
from t2twin.translate.evaluation.table import background_lines

PAPER = "Grella et al. 2023, on hardware"
TITLES = {"val": "Validation, unseen versions", "test": "Test, objects"}
"""Titles of the splits of the paper's protocol."""

NONE = "–"

METRICS = (
    "RMSE is the root of the mean squared error of the counts over all pairs and taxels, sqrt(L3) "
    "in the paper. A tactile image is the interpolation of the counts between the taxels. SSIM is "
    "the structural similarity (Wang et al. 2004) of the tactile images of predicted and true "
    "counts, averaged over the pairs; 1 for identical images."
)
BASELINES = (
    "Mean array: mean of the training arrays. Nearest neighbor: array of the training pair with "
    "the nearest DIGIT image."
)
HARDWARE = (
    "The paper's values are from real sensors and cannot be compared directly with those above; "
    "it gives one SSIM per model without stating the split. Comparable are the differences between "
    "a model and the baselines. "
)

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
    """Two tables and a summary."""
    evaluations, first = report.evaluations, report.evaluation
    simulated = report.info.is_simulated
    titles = {
        split: TITLES[split] if report.info.is_protocol else SPLIT_NAMES[split].capitalize()
        for split in evaluations
    }
    return markup.section(
        "results",
        "Results",
        [
            markup.paragraph(METRICS),
            _paper_table(evaluations, titles, "This dataset" + ", simulated" * simulated),
            markup.paragraph(
                f"{HARDWARE if first.paper else ''}{BASELINES}{_floors(first)} Pale rows: "
                f"{100 * first.bootstrap.confidence:.0f} % bootstrap intervals over shapes. "
                + " ".join(background_lines(first)),
                "note",
            ),
            markup.items(sentences({split: one.models for split, one in evaluations.items()})),
            markup.paragraph(
                "Further metrics. The contact is the set of pixels above "
                f"{100 * first.contact_level:.0f} % of the maximum of their tactile image. SSIM in "
                "contact: over the true contact. Contact IoU: intersection over union of the "
                "predicted and the true contact; 1 for identical contacts. Centroid: distance of "
                "the centroids of both tactile images. Total: mean error of the summed counts, "
                "relative to their mean."
            ),
            _further_table(evaluations, titles),
        ],
    )


def sentences(models: Mapping[str, Mapping[str, ModelRow]]) -> list[str]:
    """Comparison of each run with the baselines. models: by split and name."""
    return [
        f"{SPLIT_NAMES[split].capitalize()}: the RMSE of {name_of(name)} is "
        f"{_against(row, rows[MEAN_ARRAY])} that of the mean array and "
        f"{_against(row, rows[NEAREST_NEIGHBOR])} that of the nearest neighbor."
        for split, rows in models.items()
        for name, row in rows.items()
        if row.run is not None
    ]


def _floors(evaluation: Evaluation) -> str:
    """Definitions of the other baselines and of the lower bounds."""
    text = ""
    if MEAN_ARRAY_OF_FORCE in evaluation.models:
        text += " Mean array of the force: mean of the training arrays of the same force."
    if NOISE_FLOOR in evaluation.models:
        text += " Noise floor: difference between two readings of the same press."
    if LAYOUT_FLOOR in evaluation.models:
        text += (
            " Layout floor: smallest error of arrays that tactile images of the training layout "
            "can represent."
        )
    return text


def counts(value: float) -> str:
    return f"{value:,.0f}"


def _against(model: ModelRow, other: ModelRow) -> str:
    """Relative difference of the RMSE, such as "12.0 % below"."""
    if other.overall.rmse_counts == 0:
        return "above" if model.overall.rmse_counts else "equal to"
    difference = model.overall.rmse_counts / other.overall.rmse_counts - 1.0
    if abs(difference) < 0.0005:
        return "equal to"
    return f"{100 * abs(difference):.1f} % {'below' if difference < 0 else 'above'}"


def _paper_table(
    evaluations: Mapping[str, Evaluation], titles: Mapping[str, str], group: str
) -> str:
    """titles: of the splits. group: title of the rows of this dataset."""
    each, first = evaluations.values(), next(iter(evaluations.values()))
    columns = [("RMSE, counts", 1), (f"% of {first.full_scale_counts:,.0f}", 1), ("SSIM", 1)]
    heads = [
        [("", 1), *((f"{titles[s]} ({one.pairs:,} pairs)", 3) for s, one in evaluations.items())],
        [("", 1), *columns * len(evaluations)],
    ]
    here = []
    for name in _in_all(evaluations):
        rows = [one.models[name] for one in each]
        here.append([name_of(name), *_cells([row.overall for row in rows])])
        here.append(["", *(_span(r.interval.value(key), how) for r in rows for key, how in SHORT)])
    paper = [
        [name_of(name), *_cells([one.paper[name] for one in each], "{:.2f}")]
        for name in first.paper
    ]
    return markup.table(heads, [(group, here), *([(PAPER, paper)] if paper else [])])


def _in_all(evaluations: Mapping[str, Evaluation]) -> list[str]:
    """Models in all splits: a split with several forces has an additional baseline."""
    first, *others = evaluations.values()
    return [name for name in first.models if all(name in one.models for one in others)]


def _cells(rows: Sequence[Figures | PaperRow], ssim: str = "{:.3f}") -> list[str]:
    cells = []
    for row in rows:
        cells.append(counts(row.rmse_counts))
        cells.append(f"{row.rmse_percent:.2f} %")
        cells.append(_figure(row.ssim, ssim))
    return cells


def _further_table(evaluations: Mapping[str, Evaluation], titles: Mapping[str, str]) -> str:
    each = evaluations.values()
    heads = [
        [("", 1), *((titles[split], len(RATIOS)) for split in evaluations)],
        [("", 1), *[(title, 1) for _, title, _ in RATIOS] * len(evaluations)],
    ]
    lines = []
    for name in _in_all(evaluations):
        rows = [one.models[name] for one in each]
        figures = [_figure(r.overall.value(key), how) for r in rows for key, _, how in RATIOS]
        spans = [_span(r.interval.value(key), how) for r in rows for key, _, how in RATIOS]
        lines += [[name_of(name), *figures], ["", *spans]]
    return markup.table(heads, [("", lines)])


def _span(span: Interval | None, how: str) -> str:
    return "" if span is None else f"{how.format(span.low)}–{how.format(span.high)}"


def _figure(value: float | None, how: str) -> str:
    return NONE if value is None else how.format(value)
