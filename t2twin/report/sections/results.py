"""The paper's table for this dataset, the paper's own figures below, and what they say.

RMSE is the root of the mean squared error of the counts, over pairs and taxels: the root of the
loss that the paper calls L3.
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
"""Of the paper's protocol."""

NONE = "–"

WHAT = (
    "RMSE is the root of the mean squared error of the counts, over all pairs and taxels; the "
    "paper writes it as sqrt(L3). A tactile image is the counts interpolated between the taxels. "
    "SSIM is the structural similarity (Wang et al. 2004) of the tactile image of the predicted "
    "counts with that of the true ones, averaged over the pairs; 1 is the same image."
)
TRIVIAL = (
    "Mean array: the mean of the training set's arrays, whatever the picture. Nearest neighbor: "
    "the array of the training pair whose DIGIT picture is nearest."
)
HARDWARE = (
    "The paper's figures are of another pair of sensors, real ones, and cannot be compared one to "
    "one with those above; it gives one SSIM a model, without saying of which set. What can be "
    "compared is how far each model is from a predictor that learns nothing. "
)
"""Said once, about the first table."""

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
            markup.paragraph(WHAT),
            _paper_table(evaluations, titles, "This dataset" + ", simulated" * simulated),
            markup.paragraph(
                f"{HARDWARE if first.paper else ''}{TRIVIAL}{_floors(first)} Pale: "
                f"{100 * first.bootstrap.confidence:.0f} % intervals, by bootstrap over shapes. "
                + " ".join(background_lines(first)),
                "note",
            ),
            markup.items(sentences({split: one.models for split, one in evaluations.items()})),
            markup.paragraph(
                "More figures of the same. A pixel is in contact above "
                f"{100 * first.contact_level:.0f} % of its own tactile image's "
                "maximum. SSIM in contact: over the true contact. Contact IoU: intersection over "
                "union of the predicted and the true contact, 1 where they are the same. Centroid: "
                "distance between the two tactile images' centroids. Total: mean error of the "
                "summed counts, in parts of their mean."
            ),
            _further_table(evaluations, titles),
        ],
    )


def sentences(models: Mapping[str, Mapping[str, ModelRow]]) -> list[str]:
    """What the numbers say, one sentence a split and a run. models: by split and name."""
    return [
        f"On {SPLIT_NAMES[split]}, {name_of(name)} is {_against(row, rows[MEAN_ARRAY])} the mean "
        f"array and {_against(row, rows[NEAREST_NEIGHBOR])} the nearest neighbor."
        for split, rows in models.items()
        for name, row in rows.items()
        if row.run is not None
    ]


def _floors(evaluation: Evaluation) -> str:
    """What the other rows are: one that knows the force, and those that nothing is to pass."""
    said = ""
    if MEAN_ARRAY_OF_FORCE in evaluation.models:
        said += " Mean array of the force: the same of the training presses of that force alone."
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
    if other.overall.rmse_counts == 0:
        return "above" if model.overall.rmse_counts else "level with"
    part = model.overall.rmse_counts / other.overall.rmse_counts - 1.0
    if abs(part) < 0.0005:
        return "level with"
    return f"{100 * abs(part):.1f} % {'below' if part < 0 else 'above'}"


def _paper_table(
    evaluations: Mapping[str, Evaluation], titles: Mapping[str, str], group: str
) -> str:
    """titles: of the splits. group: the title of the rows that are not the paper's."""
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
    """The rows that every split has: one of several forces has one more than one of a single."""
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
