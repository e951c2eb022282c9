"""The tables of evaluations: figures of all rows, errors by force, further outputs of the runs."""

from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

import numpy as np

from t2twin.core.tables import NONE, Table
from t2twin.translate.evaluation.baselines import NOISE_FLOOR
from t2twin.translate.evaluation.metrics import CONFIDENCE, REPORTED_LEVEL
from t2twin.translate.evaluation.records import (
    Evaluation,
    Figures,
    ForceFigures,
    Interval,
    ModelRow,
)

Evaluations = Mapping[str, Evaluation]  # of one dataset by split


class Column(NamedTuple):
    """A column of a table: a figure, its title and its number format."""

    figure: str
    title: str
    form: str

    def cell(self, values: Figures, intervals: Mapping[str, Interval | None]) -> str:
        """The figure and its interval, as in "47 (12–95)"."""
        value, span = values.get(self.figure), intervals.get(self.figure)
        if value is None:
            return NONE
        shown = self.form.format(value)
        if span is not None:
            low, high = map(self.form.format, span)
            shown = f"{shown} ({low}–{high})"
        return shown.replace("-", "−")


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
OF_IMAGES = (  # columns of predicted images
    Column("psnr_db", "PSNR, dB", "{:.2f}"),
    Column("psnr_contact_db", "PSNR in contact, dB", "{:.2f}"),
    Column("ssim", "SSIM", "{:.3f}"),
    Column("rmse_grey", "RMSE, grey levels", "{:.2f}"),
    Column("rmse_percent", "% of full scale", "{:.2f}"),
)
OUTPUTS = {  # titles of the metrics of outputs besides counts, by name
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
SMALL_FULL_SCALE = 1000  # below which counts have a decimal
PAPER = "Grella et al. 2023, on hardware"
SSIM_OF_PAPER = Column("ssim", "SSIM", "{:.2f}")  # has two decimals
VIEW = (
    "Of the taxels, {under} lie under the image's view, {near} within one pitch of it "
    "({pitch_mm:.1f} mm), {beyond} beyond."
)
DIFFERENCE = "touch2touch minus resnet18"


def results_tables(evaluations: Evaluations, name: Callable[[str], str] = str) -> list[Table]:
    """The figures of each split, the errors by force, and the further outputs. name: displayed name
    of a row or a split."""
    tables = [table for one in evaluations.values() for table in figures_tables(one, name)]
    forces = ((one, [row.by_force for row in one.models.values()]) for one in evaluations.values())
    tables += [_force_table(one, name) for one, bins in forces if any(len(n) > 1 for n in bins)]
    lines = []
    for split, one in evaluations.items():
        for run, row in one.runs.items():
            title = f"{name(run)}, {name(split)}"
            sure = row.uncertainty and {"pairs": row.overall["pairs"]} | row.uncertainty.figures
            by_motion = {f"{kind} pairs": values for kind, values in (row.by_motion or {}).items()}
            found = {"uncertainty": sure, **by_motion, "shear force": row.shear}
            found["contact in the view"] = row.contact
            for part, values in found.items():
                if values is None:
                    continue
                pairs = f"{values['pairs']:,}"
                for metric, value in values.items():
                    shown = f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"
                    if metric in OUTPUTS:
                        lines.append([title, part, pairs, OUTPUTS[metric], shown])
    if lines:
        tables.append(Table(["", "output", "pairs", "metric", ""], {"": lines}))
    return tables


def figures_tables(one: Evaluation, name: Callable[[str], str] = str) -> list[Table]:
    """The main figures of all rows with their intervals, and below those of the paper; for counts,
    a second table of further figures."""
    main, further = (
        [
            column._replace(form=counts_form(one.full_scale_counts or np.inf))
            if column.figure.endswith("_counts")
            else column
            for column in columns
        ]
        for columns in ((MAIN, FURTHER) if one.pictures is None else (OF_IMAGES, ()))
    )
    rows = [
        [name(row), *(column.cell(each.overall, each.interval) for column in main)]
        for row, each in one.models.items()
    ]
    if one.paired:
        values = {figure: each["difference"] for figure, each in one.paired.items()}
        spans = {n: (each["low"], each["high"]) for n, each in one.paired.items() if "low" in each}
        rows.append([DIFFERENCE, *(column.cell(values, spans) for column in main)])
    for row, values in one.paper.items():
        cells = (column.cell(values, {}) for column in (*main[:2], SSIM_OF_PAPER))
        rows.append([f"{name(row)}, {PAPER}", *cells])
    heads, title = ["", *(column.title for column in main)], name(one.split)
    tables = [Table(heads, {"": rows}, f"{title}, {one.pairs:,} pairs", [*_notes(one, name)])]
    if further:
        rows = [
            [name(row), *(column.cell(each.overall, {}) for column in further)]
            for row, each in one.models.items()
        ]
        heads = ["", *(column.title for column in further)]
        notes = [] if one.view is None else [VIEW.format_map(one.view)]
        tables.append(Table(heads, {"": rows}, f"{title}, further figures", notes))
    return tables


def counts_form(full_scale: float) -> str:
    """Number format of counts of an array."""
    return "{:,.1f}" if full_scale < SMALL_FULL_SCALE else "{:,.0f}"


def _notes(one: Evaluation, name: Callable[[str], str]) -> Iterator[str]:
    """Sentences on intervals, training data, backgrounds, the paper."""
    if one.shapes > 1:
        yield (
            f"In brackets: the {100 * CONFIDENCE:.0f} % interval, by bootstrap over the "
            f"{one.shapes} shapes."
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
    if own := [one.title for one in bins if one.mean_of == "split" and one.of_mean_array]:
        captions.append(
            f"Training has too few presses at {', '.join(own)}; the mean array there is that of "
            "the evaluated presses."
        )

    def cell(one: ForceFigures) -> str:
        if one.phantom_counts is not None:
            return f"{one.rmse_counts:,.0f} ({one.phantom_counts:,.0f})"
        of_mean = one.of_mean_array
        return f"{one.rmse_counts:,.0f}" + ("" if of_mean is None else f" ({100 * of_mean:.0f} %)")

    lines = [
        [f"{one.title}, {one.pairs:,} pairs", *(cell(row.by_force[n]) for row in rows.values())]
        for n, one in enumerate(bins)
    ]
    return Table(["", *rows], {"": lines}, title=" ".join(captions))
