"""The tables of evaluations: figures of all rows, errors by force, further outputs of the runs.

Each is a `core.tables.Table`: the command prints it as text, results.md has it in Markdown, and the
report shows it in HTML.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

import numpy as np

from t2twin.core.tables import NONE, Table, markdown, text
from t2twin.translate.evaluation.baselines import NOISE_FLOOR
from t2twin.translate.evaluation.metrics import REPORTED_LEVEL, REPORTED_SHARE
from t2twin.translate.evaluation.records import Evaluation, ForceFigures, Interval, ModelRow, Values

Evaluations = Mapping[str, Evaluation]
"""Evaluations of one dataset by split."""


class Column(NamedTuple):
    """A figure with the title of its column and its number format."""

    figure: str
    title: str
    form: str


MAIN = (
    Column("rmse_counts", "RMSE, counts", "{:,.0f}"),
    Column("rmse_percent", "% of full scale", "{:.2f}"),
    Column("ssim", "SSIM", "{:.3f}"),
)
FURTHER = (
    Column("ssim_contact", "SSIM in contact", "{:.3f}"),
    Column("contact_iou", "Contact IoU", "{:.3f}"),
    Column("centroid_error_mm", "Centroid, mm", "{:.2f}"),
    Column("total_error_percent", "Total, %", "{:.1f}"),
    Column("rmse_under_counts", "Under view", "{:,.0f}"),
    Column("rmse_near_counts", "Near it", "{:,.0f}"),
    Column("rmse_beyond_counts", "Beyond", "{:,.0f}"),
)
OF_IMAGES = (
    Column("psnr_db", "PSNR, dB", "{:.2f}"),
    Column("psnr_contact_db", "PSNR in contact, dB", "{:.2f}"),
    Column("ssim", "SSIM", "{:.3f}"),
    Column("rmse_grey", "RMSE, grey levels", "{:.2f}"),
    Column("rmse_percent", "% of full scale", "{:.2f}"),
)
"""Columns of predicted images."""

OUTPUTS = {
    "coverage_percent": f"coverage of {100 * REPORTED_LEVEL:.0f} % intervals, %",
    "gain_percent": "lower RMSE without the least certain fifth, %",
    "force_median_error_percent": "force error, median, %",
    "force_coverage_percent": "coverage of the force, %",
    "rmse_counts": "RMSE, counts",
    "direction_error_deg": "direction error, median, degrees",
    "magnitude_error_percent": "magnitude error, median, %",
    "depth_rmse_mm": "RMSE of the depth, median, mm",
    "depth_mean_rmse_mm": "RMSE of the depth, mean, mm",
    "deepest_error_percent": "largest depth, median error, %",
    "deepest_worst_percent": "largest depth, largest error, %",
    "iou": "IoU",
    "force_in_view_error_percent": "force in view, median error, %",
    "center_error_mm": "center of pressure, median error, mm",
    "depth_coverage_percent": "coverage of the depth, %",
    "center_coverage_percent": "coverage of the center, %",
    "missed_percent": "contacts missed, %",
    "false_percent": "contacts found without force, %",
}
"""Titles of the metrics of outputs besides counts, by name."""

SMALL_FULL_SCALE = 1000
"""Full scale below which counts have a decimal."""

PAPER = "Grella et al. 2023, on hardware"
SSIM_OF_PAPER = Column("ssim", "SSIM", "{:.2f}")  # has two decimals
VIEW = (
    "Of the taxels, {under} lie under the image's view, {near} within one pitch of it "
    "({pitch_mm:.1f} mm), {beyond} beyond."
)
DIFFERENCE = "touch2touch minus resnet18"


def results_text(evaluations: Evaluations) -> str:
    """All tables of a dataset for the terminal."""
    return "\n\n".join(map(text, results_tables(evaluations))) + "\n"


def results_markdown(evaluations: Evaluations) -> str:
    """The same in Markdown."""
    return "\n".join(map(markdown, results_tables(evaluations)))


def results_tables(evaluations: Evaluations, name: Callable[[str], str] = str) -> list[Table]:
    """The figures of each split, the errors by force, and the further outputs. name: displayed name
    of a row or a split."""
    tables = [table for one in evaluations.values() for table in figures_tables(one, name)]
    tables += [_force_table(one, name) for one in evaluations.values() if one.has_forces]
    return [*tables, *_outputs_table(evaluations, name)]


def figures_tables(evaluation: Evaluation, name: Callable[[str], str] = str) -> list[Table]:
    """The main figures of all rows with their intervals, and below those of the paper; for counts,
    a second table of further figures."""
    one, form = evaluation, counts_form(evaluation.full_scale_counts or np.inf)
    main, further = (
        [each._replace(form=form) if each.figure.endswith("_counts") else each for each in columns]
        for columns in ((MAIN, FURTHER) if one.pictures is None else (OF_IMAGES, ()))
    )
    figures = {name(row): vars(each.overall) for row, each in one.models.items()}
    rows = [
        [name(row), *(_cell(figures[name(row)], each.interval, column) for column in main)]
        for row, each in one.models.items()
    ]
    if one.paired:
        values = {figure: each["difference"] for figure, each in one.paired.items()}
        spans = {figure: _span(each["low"], each["high"]) for figure, each in one.paired.items()}
        rows.append([DIFFERENCE, *(_cell(values, spans, column) for column in main)])
    for row, values in one.paper.items():
        cells = (_cell(values, {}, column) for column in (*main[:2], SSIM_OF_PAPER))
        rows.append([f"{name(row)}, {PAPER}", *cells])
    heads, title = ["", *(column.title for column in main)], name(one.split)
    tables = [Table(heads, {"": rows}, f"{title}, {one.pairs:,} pairs", [*_notes(one, name)])]
    if further:
        rows = [[row, *(_cell(values, {}, c) for c in further)] for row, values in figures.items()]
        heads = ["", *(column.title for column in further)]
        notes = [] if one.view is None else [VIEW.format_map(one.view)]
        tables.append(Table(heads, {"": rows}, f"{title}, further figures", notes))
    return tables


def _span(low: float | None, high: float | None) -> Interval | None:
    return None if low is None or high is None else Interval(low, high)


def _cell(
    values: Mapping[str, float | None], intervals: Mapping[str, Interval | None], column: Column
) -> str:
    """A figure and its interval, as in "47 (12–95)"."""
    value, span = values.get(column.figure), intervals.get(column.figure)
    if value is None:
        return NONE
    ends = "" if span is None else f" ({column.form.format(span[0])}–{column.form.format(span[1])})"
    return f"{column.form.format(value)}{ends}".replace("-", "−")


def counts_form(full_scale: float) -> str:
    """Number format of counts of an array."""
    return "{:,.1f}" if full_scale < SMALL_FULL_SCALE else "{:,.0f}"


def _notes(one: Evaluation, name: Callable[[str], str]) -> Iterator[str]:
    """Sentences on intervals, training data, backgrounds, the paper."""
    yield (
        f"In brackets: the {100 * float(one.bootstrap['confidence']):.0f} % interval, by bootstrap "
        f"over the {one.bootstrap['shapes']} shapes."
    )
    if one.pictures is not None:
        yield f"The images of {one.target} are compared at {one.pictures}."
        if one.background is None:
            yield "The contact has no figures: no background frame is known."
    for run, row in one.runs.items():
        yield f"{name(run)} was trained on {training_data(row)}."
    if one.background is not None and one.pictures is None:
        yield f"Background frame of the field runs: {one.background}."
    if one.paper:
        yield "The paper's rows are from real sensors and not directly comparable."


def training_data(row: ModelRow) -> str:
    """As in "union, 9 pairs, 5 steps"; a dataset without a name has digits of its SHA-256."""
    unnamed = f"dataset {row.trained_data[:8]}" if row.trained_data else NONE
    pairs, steps = (
        NONE if number is None else f"{number:,}"
        for number in (row.trained_pairs, row.trained_steps)
    )
    return f"{row.trained_recipe or unnamed}, {pairs} pairs, {steps} steps"


def _outputs_table(evaluations: Evaluations, name: Callable[[str], str]) -> list[Table]:
    """The further outputs of the runs that predict them, one metric a line; empty without."""
    lines = [
        [
            f"{name(run)}, {name(split)}",
            part,
            f"{values['pairs']:,}",
            OUTPUTS[metric],
            _short(value),
        ]
        for split, one in evaluations.items()
        for run, row in one.runs.items()
        for part, values in _outputs(row).items()
        for metric, value in values.items()
        if metric in OUTPUTS and value is not None
    ]
    return [Table(["", "output", "pairs", "metric", ""], {"": lines})] if lines else []


def _outputs(row: ModelRow) -> dict[str, Values]:
    found: dict[str, Values] = {}
    if (sure := row.uncertainty) is not None:
        found["uncertainty"] = {
            "pairs": row.overall.pairs,
            "coverage_percent": 100.0 * sure.coverage_at(REPORTED_LEVEL),
            "gain_percent": 100.0 * sure.sparsification_gain(REPORTED_SHARE),
            "force_median_error_percent": sure.force_median_error_percent,
            "force_coverage_percent": sure.force_coverage_percent,
        }
    found |= {f"{kind} pairs": values for kind, values in (row.by_motion or {}).items()}
    found |= {} if row.shear is None else {"shear force": row.shear}
    return found | ({} if row.contact is None else {"contact in the view": row.contact})


def _short(value: float) -> str:
    """A number with three digits."""
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"


def _force_table(evaluation: Evaluation, name: Callable[[str], str]) -> Table:
    """A line for each force; without the noise floor, which does not depend on the force."""
    rows = {name(row): one for row, one in evaluation.models.items() if row != NOISE_FLOOR}
    bins = next(iter(rows.values())).by_force
    captions = [
        f"{evaluation.split}: RMSE by force, in counts, and in percent of the RMSE of the mean "
        "array at that force."
    ]
    if any(one.phantom_counts is not None for one in bins):
        captions.append("Without contact: RMSE, and in brackets the mean of the summed counts.")
    if own := [one.title for one in bins if one.mean_of == "split"]:
        captions.append(
            f"Training has too few presses at {', '.join(own)}; the mean array there is that of "
            "the evaluated presses."
        )
    by_force = zip(*(row.by_force for row in rows.values()), strict=True)
    lines = [
        [f"{one.title}, {one.pairs:,} pairs", *map(_force_cell, figures)]
        for one, figures in zip(bins, by_force, strict=True)
    ]
    return Table(["", *rows], {"": lines}, title=" ".join(captions))


def _force_cell(one: ForceFigures) -> str:
    """As in "812 (31 %)", relative to the mean array, or "5 (60)" without contact."""
    if one.phantom_counts is not None:
        return f"{one.rmse_counts:,.0f} ({one.phantom_counts:,.0f})"
    if one.of_mean_array is None:
        return f"{one.rmse_counts:,.0f}"
    return f"{one.rmse_counts:,.0f} ({100 * one.of_mean_array:.0f} %)"
