"""Tables, shown as text, as Markdown, and in HTML by the macro `table` of the pages."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

NONE = "–"  # a figure that is unknown


@dataclass(frozen=True)
class Table:
    """A table whose first column names its rows."""

    columns: Sequence[str]  # titles, one per cell of a row
    groups: Mapping[str, Sequence[Sequence[str]]]  # rows of cells by the title of their group or ""
    title: str = ""  # a line above the table
    notes: Sequence[str] = ()  # sentences below it


def text(table: Table) -> str:
    """The table for a terminal, in ASCII as far as its names are."""
    rows = [row for group in table.groups.values() for row in group]
    widths = [max(map(len, column)) for column in zip(table.columns, *rows, strict=True)]

    def line(row: Sequence[str]) -> str:
        first, *others = zip(row, widths, strict=True)
        return "  ".join((first[0].ljust(first[1]), *(cell.rjust(n) for cell, n in others)))

    lines = [table.title, line(table.columns)]
    for title, group in table.groups.items():
        lines += [title, *map(line, group)]
    shown = "\n".join(filter(None, (*lines, *table.notes)))
    return shown.replace("–", "-").replace("−", "-")


def markdown(table: Table) -> str:
    """The table in Markdown, between its title and its notes."""
    rows: list[Sequence[str]] = [table.columns, ["---"] * len(table.columns)]
    for title, group in table.groups.items():
        if title:
            rows.append([f"**{title}**", *[""] * (len(table.columns) - 1)])
        rows += group
    lines = "\n".join(f"| {' | '.join(row)} |" for row in rows)
    return "\n\n".join(filter(None, (table.title, lines, *table.notes))) + "\n"
