"""Text tables of evaluations, for the terminal and in Markdown.

Sections: the overall table and its notes, the findings, the irreducible error, the training data of
runs, and the errors by force.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from t2twin.translate.evaluation.metrics.floors import NOISE_FLOOR
from t2twin.translate.evaluation.metrics.motion import motion_text
from t2twin.translate.evaluation.metrics.reliability import uncertainty_text
from t2twin.translate.evaluation.records import (
    Evaluation,
    FigureName,
    Finding,
    ForceFigures,
    Interval,
    IrreducibleError,
    ModelRow,
)


class Column(NamedTuple):
    """A figure with the title of its column and its number format."""

    figure: FigureName
    title: str
    form: str


FIGURES = (
    Column("rmse_counts", "RMSE, counts", "{:.0f}"),
    Column("rmse_percent", "%", "{:.2f}"),
    Column("ssim", "SSIM", "{:.3f}"),
    Column("ssim_contact", "in contact", "{:.3f}"),
    Column("contact_iou", "IoU", "{:.3f}"),
    Column("centroid_error_mm", "centroid, mm", "{:.2f}"),
    Column("total_error_percent", "total, %", "{:.1f}"),
    Column("rmse_under_counts", "under view", "{:.0f}"),
    Column("rmse_near_counts", "near it", "{:.0f}"),
    Column("rmse_beyond_counts", "beyond", "{:.0f}"),
)
"""All figures (records.Figures)."""

SHORT = (
    Column("rmse_counts", "counts", "{:,.0f}"),
    Column("rmse_percent", "%", "{:.2f}"),
    Column("ssim", "SSIM", "{:.3f}"),
    Column("contact_iou", "IoU", "{:.3f}"),
)
"""The figures of the Markdown table."""

FORMS = {column.figure: column.form for column in FIGURES}
"""Number formats by figure."""

UNKNOWN = "-"

CAPTION = "RMSE by force, in counts, and in percent of the RMSE of the mean array at that force."
NO_CONTACT = "no contact"
NO_CONTACT_CAPTION = "Without contact: RMSE, and in brackets the mean of the summed counts."


def table(evaluation: Evaluation) -> str:
    """The overall figures with their intervals below them, the paper's rows, and notes."""
    cells = [["", *(column.title for column in FIGURES)]]
    for name, model in evaluation.models.items():
        cells.append([name, *(_cell(getattr(model.overall, c.figure), c.form) for c in FIGURES)])
        cells.append(["", *(interval_text(model.interval[c.figure], c.form) for c in FIGURES)])
    for name, row in evaluation.paper.items():
        cells.append(
            [
                f"{name} (paper, hardware)",
                *(_cell(getattr(row, c.figure, None), c.form) for c in FIGURES),
            ]
        )
    head = f"{evaluation.split}, {evaluation.pairs} pairs"
    return "\n".join([head, *_aligned(cells), *_notes(evaluation)])


def _notes(evaluation: Evaluation) -> list[str]:
    bootstrap, view = evaluation.bootstrap, evaluation.view
    notes = [
        f"Below each figure: its {100 * bootstrap.confidence:.0f} % interval, by bootstrap over "
        f"the {bootstrap.shapes} shapes.",
        f"Of the taxels, {view.taxels.under} lie under the DIGIT's view, {view.taxels.near} within "
        f"one pitch of it ({view.pitch_mm:.1f} mm), {view.taxels.beyond} beyond.",
    ]
    notes += notes_on_runs(evaluation)
    notes += training_lines(evaluation) + background_lines(evaluation)
    if evaluation.paper:
        notes.append("The paper's rows are from real sensors and not directly comparable.")
    return notes


def notes_on_runs(evaluation: Evaluation) -> list[str]:
    """Lines on uncertainty, motion and shear force of runs that have them."""
    return uncertainty_text(evaluation.models) + motion_text(evaluation.models)


def markdown(evaluations: Mapping[str, Evaluation]) -> str:
    """The figures of all splits in one Markdown table. evaluations: by split.

    The interval of the RMSE is in brackets, the paper's rows are in italics. Below the table:
    uncertainty and training data of runs, and the errors by force.
    """
    heads = ["", *(f"{split}: {column.title}" for split in evaluations for column in SHORT)]
    lines = [heads]
    first = next(iter(evaluations.values()))
    for name in first.models:
        rows = [evaluation.models.get(name) for evaluation in evaluations.values()]
        lines.append([name, *(cell for row in rows for cell in _short_cells(row))])
    for name in first.paper:
        rows = [evaluation.paper.get(name) for evaluation in evaluations.values()]
        cells = [_cell(getattr(row, c.figure, None), c.form) for row in rows for c in SHORT]
        lines.append([f"*{name}, Grella et al. 2023, hardware*", *cells])
    by_force = "".join(by_force_markdown(evaluation) for evaluation in evaluations.values())
    uncertainty = "".join(
        f"\n{split}: {line}\n"
        for split, evaluation in evaluations.items()
        for line in notes_on_runs(evaluation)
    )
    runs = (*training_lines(first), *background_lines(first))
    return markdown_table(lines) + uncertainty + "".join(f"\n{line}\n" for line in runs) + by_force


def _short_cells(row: ModelRow | None) -> list[str]:
    """The figures of a row in one split, dashes if the split lacks it."""
    cells = []
    for column in SHORT:
        cell = _cell(row and getattr(row.overall, column.figure), column.form)
        interval = None if row is None else row.interval["rmse_counts"]
        if column.figure == "rmse_counts" and interval is not None:
            cell += f" ({interval_text(interval, column.form)})"
        cells.append(cell)
    return cells


def findings_text(findings: Mapping[str, Finding]) -> str:
    """One line per finding."""
    return "\n".join(f"{one.question} {_answer(one)}" for one in findings.values())


def _answer(finding: Finding) -> str:
    """As in "Yes: difference 52 (12 to 95); val 900, test 1800."."""
    form, interval = FORMS[finding.figure], finding.interval
    figures = ", ".join(f"{name} {form.format(value)}" for name, value in finding.figures.items())
    between = (
        "no interval"
        if interval is None
        else f"{form.format(interval.low)} to {form.format(interval.high)}"
    )
    return (
        f"{finding.answer.capitalize()}: difference {form.format(finding.difference)} "
        f"({between}); {figures}."
    )


def irreducible_error_text(found: IrreducibleError, split: str) -> str:
    """The estimates of the irreducible error, one line per set of neighbors."""
    lines = [
        f"Irreducible error: sqrt(mean squared difference of the counts / 2) between each press "
        f"and the press with the nearest image. Two images of one press differ by "
        f"{found.noise_grey:.2f} grey levels (noise)."
    ]
    sets = ((found.split, f"other shapes of {split}"), (found.training, "training pairs"))
    for floor, name in sets:
        if floor is None:
            lines.append(f"  {name}: there are none")
            continue
        near, close, value = floor.nearest, floor.close, floor.extrapolated_rmse_counts
        within = f"{close.pairs} within {found.close_grey:.2f}"
        if close.pairs:
            within += f" ({close.rmse_counts:.0f} counts)"
        line = (
            f"  {name}: {near.rmse_counts:.0f} counts at a median distance of "
            f"{near.distance_grey:.1f} grey levels; {within}"
        )
        if value is not None:
            interval = interval_text(floor.interval, "{:.0f}")
            line += f"; extrapolated to the noise {value:.0f} ({interval})"
        lines.append(line)
    return "\n".join(lines)


def training_data(row: ModelRow, worlds: Mapping[str, str] | None = None) -> tuple[str, str, str]:
    """World, number of training pairs and of steps of a row's run; dashes if unknown.

    worlds: names by the SHA-256 of the datasets' info.json, for runs of older versions. A dataset
    without a name has its first digits.
    """
    sha256 = row.trained_data or ""
    world = row.trained_world or (worlds or {}).get(sha256)
    unnamed = f"dataset {sha256[:8]}" if sha256 else UNKNOWN
    return world or unnamed, _cell(row.trained_pairs, "{:,}"), _cell(row.trained_steps, "{:,}")


def training_lines(evaluation: Evaluation) -> list[str]:
    """One line per run, as in "resnet18 was trained on paper, 14,112 pairs, 5,292 steps."."""
    lines = []
    for name, row in evaluation.runs.items():
        world, pairs, steps = training_data(row)
        numbers = ((pairs, "pairs"), (steps, "steps"))
        known = [f"{number} {unit}" for number, unit in numbers if number != UNKNOWN]
        lines.append(f"{name} was trained on {', '.join((world, *known))}.")
    return lines


def background_lines(evaluation: Evaluation) -> list[str]:
    """One line on the source of the background frames, if runs used them."""
    if evaluation.background is None:
        return []
    return [f"Background frame of the field runs: {evaluation.background}."]


def by_force_text(evaluation: Evaluation) -> str:
    """The errors by force in columns; empty for a single force."""
    if not evaluation.has_forces:
        return ""
    rows = force_rows(evaluation)
    transposed = [list(column) for column in zip(*rows, strict=True)]  # one line per force
    return "\n".join([" ".join(_force_notes(evaluation)), *_aligned(transposed)])


def by_force_markdown(evaluation: Evaluation) -> str:
    """The errors by force as a Markdown table; empty for a single force."""
    if not evaluation.has_forces:
        return ""
    notes = " ".join(_force_notes(evaluation))
    return f"\n{evaluation.split}: {notes}\n\n{markdown_table(force_rows(evaluation))}"


def force_rows(evaluation: Evaluation) -> list[list[str]]:
    """A row of titles, then one row per model, for evaluations with several forces.

    The noise floor, which does not depend on the force, is left out.
    """
    rows = {name: row for name, row in evaluation.models.items() if name != NOISE_FLOOR}
    first = next(iter(rows.values()))
    titles = [f"{_force_title(one)}, {one.pairs:,} pairs" for one in first.by_force]
    cells = [[name, *(force_cell(one) for one in row.by_force)] for name, row in rows.items()]
    return [["", *titles], *cells]


def force_cell(one: ForceFigures) -> str:
    """As in "812 (31 %)", relative to the mean array, or "5 (60)" without contact."""
    if one.phantom_counts is not None:
        return f"{one.rmse_counts:,.0f} ({one.phantom_counts:,.0f})"
    if one.of_mean_array is None:
        return f"{one.rmse_counts:,.0f}"
    return f"{one.rmse_counts:,.0f} ({100 * one.of_mean_array:.0f} %)"


def _force_title(one: ForceFigures) -> str:
    """As in "8 N", "0.71-1 N" or "no contact"."""
    if one.phantom_counts is not None:
        return NO_CONTACT
    if one.low_n == one.high_n:
        return f"{one.low_n:g} N"
    return f"{one.low_n:.3g}-{one.high_n:.3g} N"


def _force_notes(evaluation: Evaluation) -> list[str]:
    bins = next(iter(evaluation.models.values())).by_force
    no_contact = any(one.phantom_counts is not None for one in bins)
    own = [_force_title(one) for one in bins if one.mean_of == "split"]
    notes = [CAPTION, *([NO_CONTACT_CAPTION] if no_contact else [])]
    if own:
        notes.append(
            f"Training has too few presses at {', '.join(own)}; the mean array there is that of "
            "the evaluated presses."
        )
    return notes


def interval_text(interval: Interval | None, form: str) -> str:
    """As in "12-95"; empty without interval."""
    return "" if interval is None else f"{form.format(interval.low)}-{form.format(interval.high)}"


def _aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of text, the first column aligned left, the others right."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return [
        "  ".join(
            cell.ljust(width) if column == 0 else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        for row in rows
    ]


def markdown_table(rows: Sequence[Sequence[str]]) -> str:
    heads, *others = rows
    return "".join(f"| {' | '.join(row)} |\n" for row in (heads, ["---"] * len(heads), *others))


def _cell(value: float | None, form: str) -> str:
    return UNKNOWN if value is None else form.format(value)
