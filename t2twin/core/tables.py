"""Tables, shown as text, as Markdown, and in HTML by the macro `table` of the pages."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

Cell = str | tuple[str, str]
"""A text, or a figure and its interval, "" for none."""

NONE = "–"
"""Text of a figure that is unknown."""


@dataclass(frozen=True)
class Table:
    """A table whose first column names its rows.

    columns: titles, one per cell of a row. groups: rows of cells by the title of their group, ""
    for none. over: titles above the columns, from the second one on, with the number of columns of
    each; empty for none. title: a line above the table. notes: sentences below it.
    """

    columns: Sequence[str]
    groups: Mapping[str, Sequence[Sequence[Cell]]]
    over: Sequence[tuple[str, int]] = ()
    title: str = ""
    notes: Sequence[str] = ()

    @property
    def heads(self) -> list[str]:
        """Titles of the columns, with those above them."""
        above = [f"{title}: " for title, columns in self.over for _ in range(columns)]
        above = ["", *above] if above else [""] * len(self.columns)
        return [a + b for a, b in zip(above, self.columns, strict=True)]

    @property
    def lines(self) -> dict[str, list[list[str]]]:
        """The groups with a further row, without a name, below each row that has intervals."""
        return {
            title: [line for row in rows for line in _with_intervals(row)]
            for title, rows in self.groups.items()
        }


def text(table: Table) -> str:
    """The table for a terminal, in ASCII as far as its names are."""
    rows = [row for group in table.lines.values() for row in group]
    widths = [max(map(len, column)) for column in zip(table.heads, *rows, strict=True)]

    def line(row: Sequence[str]) -> str:
        first, *others = zip(row, widths, strict=True)
        return "  ".join((first[0].ljust(first[1]), *(cell.rjust(n) for cell, n in others)))

    lines = [table.title, line(table.heads)]
    for title, group in table.lines.items():
        lines += [title, *map(line, group)]
    shown = "\n".join(filter(None, (*lines, *table.notes)))
    return shown.replace("–", "-").replace("−", "-")


def markdown(table: Table) -> str:
    """The table in Markdown, between its title and its notes; intervals are in brackets."""
    rows: list[Sequence[str]] = [table.heads, ["---"] * len(table.columns)]
    for title, group in table.groups.items():
        if title:
            rows.append([f"**{title}**", *[""] * (len(table.columns) - 1)])
        for row in group:
            rows.append([cell if isinstance(cell, str) else _in_brackets(*cell) for cell in row])
    lines = "\n".join(f"| {' | '.join(row)} |" for row in rows)
    return "\n\n".join(filter(None, (table.title, lines, *table.notes))) + "\n"


def _in_brackets(figure: str, interval: str) -> str:
    return f"{figure} ({interval})" if interval else figure


def _with_intervals(row: Sequence[Cell]) -> list[list[str]]:
    """The row, and the row of its intervals if there are any."""
    pairs = [(cell, "") if isinstance(cell, str) else cell for cell in row]
    figures, intervals = (list(each) for each in zip(*pairs, strict=True))
    return [figures, intervals] if any(intervals) else [figures]
