"""What an evaluation found, as lines of text."""

from collections.abc import Mapping
from typing import NamedTuple

from t2twin.translate.evaluation.certainty import certainty_text
from t2twin.translate.evaluation.force_table import by_force_markdown, in_columns
from t2twin.translate.evaluation.records import (
    Evaluation,
    FigureName,
    Finding,
    Interval,
    LookAlikes,
    ModelRow,
    PaperRow,
)
from t2twin.translate.evaluation.trained import background_lines, trained_lines


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


def lookalikes_text(lookalikes: LookAlikes, split: str) -> str:
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
