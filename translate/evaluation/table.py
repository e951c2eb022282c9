"""What an evaluation found, as lines of text.

What a row's run was trained on, in words.

The errors by force, as tables of text.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from t2twin.translate.evaluation.metrics.floors import NOISE_FLOOR
from t2twin.translate.evaluation.metrics.reliability import certainty_text
from t2twin.translate.evaluation.records import (
    Evaluation,
    FigureName,
    Finding,
    ForceFigures,
    Interval,
    IrreducibleError,
    ModelRow,
    PaperRow,
)


class Column(NamedTuple):
    """A figure, the title of its column, and how it is written."""

    figure: FigureName
    title: str
    how: str


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
"""Those of a short table."""

HOW = {column.figure: column.how for column in FIGURES}


def table(evaluation: Evaluation) -> str:
    """The overall figures of `evaluate`, under each its interval, the paper's own below."""
    cells = [["", *(column.title for column in FIGURES)]]
    for name, model in evaluation.models.items():
        cells.append([name, *(_cell(model.overall.value(c.figure), c.how) for c in FIGURES)])
        cells.append(["", *(spanned(model.interval.value(c.figure), c.how) for c in FIGURES)])
    for name, row in evaluation.paper.items():
        cells.append(
            [f"{name} (paper, hardware)", *(_cell(row.value(c.figure), c.how) for c in FIGURES)]
        )
    lines = in_columns(cells)
    return "\n".join([f"{evaluation.split}, {evaluation.pairs} pairs", *lines, *_notes(evaluation)])


def _notes(evaluation: Evaluation) -> list[str]:
    how, view = evaluation.bootstrap, evaluation.view
    notes = [
        f"Below each figure its {100 * how.confidence:.0f} % interval, by bootstrap over the "
        f"{how.shapes} shapes.",
        f"Of the taxels {view.taxels.under} lie under the DIGIT's view, {view.taxels.near} within "
        f"one pitch of it ({view.pitch_mm:.1f} mm), {view.taxels.beyond} beyond.",
    ]
    notes += certainty_text(evaluation.models)
    notes += trained_lines(evaluation) + background_lines(evaluation)
    if evaluation.paper:
        notes.append("The paper's rows are from real sensors and not to be compared one to one.")
    return notes


def markdown(evaluations: Mapping[str, Evaluation]) -> str:
    """A table in Markdown: what `evaluate` found of each split, side by side.

    evaluations: by split. The interval of the RMSE stands in brackets; the paper's rows are in
    italics. Below: how sure runs are, what each was trained on, and the errors of several forces.
    """
    heads = ["", *(f"{split}: {column.title}" for split in evaluations for column in SHORT)]
    lines = [heads, ["---"] * len(heads)]
    first = next(iter(evaluations.values()))
    for name in first.models:
        rows = [evaluation.models.get(name) for evaluation in evaluations.values()]
        lines.append([name, *(cell for row in rows for cell in _short_cells(row))])
    for name in first.paper:
        rows = [evaluation.paper.get(name) for evaluation in evaluations.values()]
        cells = [cell for row in rows for cell in _paper_cells(row)]
        lines.append([f"*{name}, Grella et al. 2023, hardware*", *cells])
    table = "".join(f"| {' | '.join(line)} |\n" for line in lines)
    by_force = "".join(by_force_markdown(evaluation) for evaluation in evaluations.values())
    sure = "".join(
        f"\n{split}: {line}\n"
        for split, evaluation in evaluations.items()
        for line in certainty_text(evaluation.models)
    )
    runs = (*trained_lines(first), *background_lines(first))
    return table + sure + "".join(f"\n{line}\n" for line in runs) + by_force


def _short_cells(row: ModelRow | None) -> list[str]:
    """A split's figures of a row, dashes where the split lacks it."""
    cells = []
    for column in SHORT:
        cell = _cell(None if row is None else row.overall.value(column.figure), column.how)
        span = None if row is None else row.interval.rmse_counts
        if column.figure == "rmse_counts" and span is not None:
            cell += f" ({spanned(span, column.how)})"
        cells.append(cell)
    return cells


def _paper_cells(row: PaperRow | None) -> list[str]:
    return [_cell(None if row is None else row.value(c.figure), c.how) for c in SHORT]


def findings_text(findings: Mapping[str, Finding]) -> str:
    """A line a finding."""
    return "\n".join(f"{one.question} {answered(one)}" for one in findings.values())


def answered(finding: Finding) -> str:
    """As in "Yes: by 52 (12 to 95); val 900, test 1800."."""
    how = HOW[finding.figure]
    of = ", ".join(f"{name} {how.format(value)}" for name, value in finding.figures.items())
    span = finding.interval
    between = (
        "no interval" if span is None else f"{how.format(span.low)} to {how.format(span.high)}"
    )
    return (
        f"{finding.answer.capitalize()}: difference {how.format(finding.difference)} "
        f"({between}); {of}."
    )


def irreducible_error_text(lookalikes: IrreducibleError, split: str) -> str:
    """What the pictures' look-alikes say of the error that stays."""
    lines = [
        f"Pictures of one press differ by {lookalikes.noise_grey:.2f} grey levels (noise). Nearest "
        "picture of each press, and sqrt(mean squared difference of the counts / 2):"
    ]
    places = (
        (lookalikes.split, f"other shapes of {split}"),
        (lookalikes.training, "training pairs"),
    )
    for floor, name in places:
        if floor is None:
            lines.append(f"  {name}: there are none")
            continue
        near, close, value = floor.nearest, floor.close, floor.extrapolated_rmse_counts
        within = f"{close.pairs} within {lookalikes.close_grey:.2f}"
        if close.pairs:
            within += f" ({close.rmse_counts:.0f} counts)"
        line = (
            f"  {name}: {near.rmse_counts:.0f} counts at {near.distance_grey:.1f} grey "
            f"levels in the median; {within}"
        )
        if value is not None:
            between = spanned(floor.interval, "{:.0f}")
            line += f"; extrapolated to the noise {value:.0f} ({between})"
        lines.append(line)
    return "\n".join(lines)


def spanned(span: Interval | None, how: str) -> str:
    """As in "12-95"; nothing where there is no interval."""
    return "" if span is None else f"{how.format(span.low)}-{how.format(span.high)}"


def _cell(value: float | None, how: str) -> str:
    return "-" if value is None else how.format(value)


UNKNOWN = "-"


def trained_on(row: ModelRow, known: Mapping[str, str] | None = None) -> tuple[str, str, str]:
    """The world, the number of training pairs and of steps; a dash for what is not known.

    known: names of worlds by the SHA-256 of their datasets' info.json, for runs of older versions,
    which do not say. A dataset without a name is called by its first digits.
    """
    sha256 = row.trained_data or ""
    world = row.trained_world or (known or {}).get(sha256)
    unnamed = f"data set {sha256[:8]}" if sha256 else UNKNOWN
    return world or unnamed, _number(row.trained_pairs), _number(row.trained_steps)


def trained_lines(evaluation: Evaluation) -> list[str]:
    """A line a run, as in "resnet18 was trained on paper, 14,112 pairs, 5,292 steps."."""
    lines = []
    for name, row in evaluation.runs.items():
        world, pairs, steps = trained_on(row)
        numbers = ((pairs, "pairs"), (steps, "steps"))
        known = [f"{number} {what}" for number, what in numbers if number != UNKNOWN]
        lines.append(f"{name} was trained on {', '.join((world, *known))}.")
    return lines


def background_lines(evaluation: Evaluation) -> list[str]:
    """A line on the background frame, where a run was given one."""
    if evaluation.background is None:
        return []
    return [f"Background frame given to the field runs: {evaluation.background}."]


def _number(value: int | None) -> str:
    return UNKNOWN if value is None else f"{value:,}"


CAPTION = (
    "RMSE by force, in counts, and in percent of that of the mean array of presses of that force."
)
UNTOUCHED = "Where nothing is touched: RMSE, and in brackets the mean of the summed counts."


def force_title(one: ForceFigures) -> str:
    """As in "8 N", "0.71-1 N" or "untouched"."""
    if one.phantom_counts is not None:
        return "untouched"
    if one.low_n == one.high_n:
        return f"{one.low_n:g} N"
    return f"{one.low_n:.3g}-{one.high_n:.3g} N"


def force_cell(one: ForceFigures) -> str:
    """As in "812 (31 %)", of the mean array's, or "5 (60)" where nothing is touched."""
    if one.phantom_counts is not None:
        return f"{one.rmse_counts:,.0f} ({one.phantom_counts:,.0f})"
    if one.of_mean_array is None:
        return f"{one.rmse_counts:,.0f}"
    return f"{one.rmse_counts:,.0f} ({100 * one.of_mean_array:.0f} %)"


def force_rows(evaluation: Evaluation) -> list[list[str]]:
    """A row of titles, then a row a model; of evaluations that have several forces.

    The noise floor, which is the same at every force, is left out.
    """
    rows = {name: row for name, row in evaluation.models.items() if name != NOISE_FLOOR}
    first = next(iter(rows.values()))
    titles = [f"{force_title(one)}, {one.pairs:,} pairs" for one in first.by_force]
    return [["", *titles], *([name, *_cells(row)] for name, row in rows.items())]


def by_force_text(evaluation: Evaluation) -> str:
    """In columns, with a line above; empty of one force."""
    if not evaluation.has_forces:
        return ""
    rows = force_rows(evaluation)
    # Forces downwards: a screen has more room there.
    turned = [list(column) for column in zip(*rows, strict=True)]
    return "\n".join([" ".join(_said(evaluation)), *in_columns(turned)])


def by_force_markdown(evaluation: Evaluation) -> str:
    """A table in Markdown, with a line above; empty of one force."""
    if not evaluation.has_forces:
        return ""
    heads, *rows = force_rows(evaluation)
    lines = [heads, ["---"] * len(heads), *rows]
    table = "".join(f"| {' | '.join(line)} |\n" for line in lines)
    return f"\n{evaluation.split}: {' '.join(_said(evaluation))}\n\n{table}"


def in_columns(rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of text, the first column to the left, the others to the right."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return [
        "  ".join(
            cell.ljust(width) if column == 0 else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        for row in rows
    ]


def _cells(row: ModelRow) -> list[str]:
    return [force_cell(one) for one in row.by_force]


def _said(evaluation: Evaluation) -> list[str]:
    first = next(iter(evaluation.models.values())).by_force
    untouched = any(one.phantom_counts is not None for one in first)
    own = [force_title(one) for one in first if one.mean_of == "split"]
    said = [CAPTION, *([UNTOUCHED] if untouched else [])]
    if own:
        said.append(
            f"Training has too few presses at {', '.join(own)}; there the mean array is that of "
            "these presses themselves."
        )
    return said
