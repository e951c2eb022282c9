"""The errors by force, as tables of text."""

from collections.abc import Sequence

from t2twin.translate.evaluation.noise_floor import NOISE_FLOOR
from t2twin.translate.evaluation.records import Evaluation, ForceFigures, ModelRow

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
