"""The tables of evaluations: figures of all rows, errors by force, further outputs of the runs.

Each is a `core.tables.Table`: the command prints it as text, results.md has it in Markdown, and the
report shows it in HTML.
"""

from collections.abc import Callable, Collection, Iterator, Mapping
from typing import NamedTuple

from t2twin.core.tables import NONE, Cell, Table, markdown, text
from t2twin.translate.evaluation.baselines import NOISE_FLOOR
from t2twin.translate.evaluation.metrics import REPORTED_LEVEL, REPORTED_SHARE
from t2twin.translate.evaluation.records import (
    Evaluation,
    ForceFigures,
    Interval,
    ModelRow,
    Values,
)

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
DIFFERENCE = "touch2touch minus resnet18"


def results_text(evaluations: Evaluations) -> str:
    """All tables of a dataset for the terminal."""
    tables = []
    for split, one in evaluations.items():
        columns = (*MAIN, *FURTHER) if one.pictures is None else OF_IMAGES
        tables += [figures_table({split: one}, columns), *force_tables({split: one})]
    tables += outputs_table(evaluations)
    return "\n\n".join(map(text, tables)) + "\n"


def results_markdown(evaluations: Evaluations) -> str:
    """The main figures of all splits, the errors by force and the further outputs, in Markdown."""
    splits = dict(zip(evaluations, evaluations, strict=True))
    of_counts = all(one.pictures is None for one in evaluations.values())
    columns = (*MAIN, FURTHER[1]) if of_counts else OF_IMAGES[:3]
    tables = [figures_table(evaluations, columns, splits)]
    tables += [*force_tables(evaluations), *outputs_table(evaluations)]
    return "\n".join(map(markdown, tables))


def figures_table(
    evaluations: Evaluations,
    columns: Collection[Column],
    splits: Mapping[str, str] | None = None,
    name: Callable[[str], str] = str,
    own: str = "",
) -> Table:
    """Figures of all rows with their intervals, and below those of the paper.

    splits: titles above the columns of each; without them, the table is of one split. name:
    displayed name of a row. own: title of the rows that are not the paper's.
    """
    each = list(evaluations.values())
    if (full_scale := each[0].full_scale_counts) is not None:
        form = counts_form(full_scale)
        columns = [c._replace(form=form) if c.figure.endswith("_counts") else c for c in columns]

    def line(title: str, cell: Callable[[Evaluation, Column], Cell]) -> list[Cell]:
        return [title, *(cell(one, column) for one in each for column in columns)]

    def of_row(row: str) -> Callable[[Evaluation, Column], Cell]:
        return lambda one, column: _cell(one.models.get(row), column)

    groups: dict[str, list[list[Cell]]] = {own: []}
    for row in dict.fromkeys(row for one in each for row in one.models):
        groups[own].append(line(name(row), of_row(row)))
    if any(one.paired for one in each):
        groups[own].append(line(DIFFERENCE, _difference))
    for row in dict.fromkeys(row for one in each for row in one.paper):
        cells = line(name(row), lambda one, c, row=row: _of_paper(one.paper.get(row, {}), c))
        if any(cell != NONE for cell in cells[1:]):
            groups.setdefault(PAPER, []).append(cells)
    title = "" if splits else f"{each[0].split}, {each[0].pairs} pairs"
    over = [(title, len(columns)) for title in (splits or {}).values()]
    heads = ["", *[column.title for column in columns] * len(each)]
    return Table(heads, groups, over, title, list(_notes(evaluations, columns)))


def _cell(row: ModelRow | None, column: Column) -> Cell:
    """A figure of a row, and its interval."""
    if row is None:
        return NONE
    figure = _number(vars(row.overall), column)
    return figure, _interval(row.interval.get(column.figure), column.form)


def _difference(evaluation: Evaluation, column: Column) -> Cell:
    found = evaluation.paired.get(column.figure, {})
    low, high, value = found.get("low"), found.get("high"), found.get("difference")
    span = None if low is None or high is None else Interval(low, high)
    return _number({column.figure: value}, column), _interval(span, column.form)


def _of_paper(values: Values, column: Column) -> str:
    """A figure of the paper, with its decimals."""
    return _number(values, column._replace(form="{:.2f}") if column.figure == "ssim" else column)


def _number(values: Mapping[str, float | None], column: Column) -> str:
    value = values.get(column.figure)
    return NONE if value is None else column.form.format(value).replace("-", "−")


def counts_form(full_scale: float) -> str:
    """Number format of counts of an array."""
    return "{:,.1f}" if full_scale < SMALL_FULL_SCALE else "{:,.0f}"


def _interval(interval: Interval | None, form: str) -> str:
    """As in "12–95"; empty without interval."""
    ends = "" if interval is None else f"{form.format(interval.low)}–{form.format(interval.high)}"
    return ends.replace("-", "−")


def _notes(evaluations: Evaluations, columns: Collection[Column]) -> Iterator[str]:
    """Sentences on intervals, groups of taxels, training data, backgrounds, the paper."""
    one = next(iter(evaluations.values()))
    shapes = " and ".join(str(each.bootstrap["shapes"]) for each in evaluations.values())
    yield (
        f"Below or behind a figure: its {100 * float(one.bootstrap['confidence']):.0f} % interval, "
        f"by bootstrap over the {shapes} shapes."
    )
    if (view := one.view) is not None and FURTHER[-1] in columns:
        yield (
            f"Of the taxels, {view['under']} lie under the image's view, {view['near']} within one "
            f"pitch of it ({view['pitch_mm']:.1f} mm), {view['beyond']} beyond."
        )
    if one.pictures is not None:
        yield f"The images of {one.target} are compared at {one.pictures}."
        if one.background is None:
            yield "The contact has no figures: no background frame is known."
    for name, row in one.runs.items():
        recipe, pairs, steps = training_data(row)
        yield f"{name} was trained on {recipe}, {pairs} pairs, {steps} steps."
    if one.background is not None and one.pictures is None:
        yield f"Background frame of the field runs: {one.background}."
    if one.paper:
        yield "The paper's rows are from real sensors and not directly comparable."


def training_data(row: ModelRow) -> tuple[str, str, str]:
    """Recipe, number of training pairs and of steps of a row's run; NONE if unknown. A dataset
    without a name has the first digits of its SHA-256."""
    unnamed = f"dataset {row.trained_data[:8]}" if row.trained_data else NONE
    pairs, steps = (
        NONE if number is None else f"{number:,}"
        for number in (row.trained_pairs, row.trained_steps)
    )
    return row.trained_recipe or unnamed, pairs, steps


def outputs_table(evaluations: Evaluations, name: Callable[[str], str] = str) -> list[Table]:
    """Uncertainty, motion, shear force and contact of the runs that predict them, one metric a
    line; empty without."""
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


def force_tables(evaluations: Evaluations, name: Callable[[str], str] = str) -> list[Table]:
    """The errors by force of the splits that have several, with one line per force.

    The noise floor, which does not depend on the force, is left out.
    """
    return [_force_table(one, name) for one in evaluations.values() if one.has_forces]


def _force_table(evaluation: Evaluation, name: Callable[[str], str]) -> Table:
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
