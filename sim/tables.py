"""Reads CSV files of spreadsheets."""

import csv
import io
import re
from dataclasses import MISSING, fields
from math import isfinite
from pathlib import Path
from typing import TypeVar

from t2twin.core.errors import T2TwinError
from t2twin.core.files import read_file
from t2twin.core.records import check_names, convert

Record = TypeVar("Record")

DELIMITERS = ",;\t"  # of columns; spreadsheets of many countries write the second
DECIMAL_COMMA = re.compile(r"^([-+]?\d+),(\d+)$")  # where commas do not delimit columns


def read_csv(path: Path) -> tuple[list[str], list[tuple[str, dict[str, str]]]]:
    """The names of the columns; of each row its place, such as "line 2", and its nonempty cells.

    The delimiter is the most frequent one in the first line; decimal commas become points.
    """
    try:
        text = read_file(path).decode("utf-8-sig")
        delimiter = max(DELIMITERS, key=text.partition("\n")[0].count)
        if text.count('"') % 2:  # the reader would take all that follows for one cell
            raise csv.Error("a quotation mark is not closed")
        reader = csv.reader(
            io.StringIO(text, newline=""), delimiter=delimiter, skipinitialspace=True
        )
        lines = [(reader.line_num, [cell.strip() for cell in row]) for row in reader]
    except (UnicodeDecodeError, csv.Error) as error:
        raise T2TwinError(f"{path} cannot be read as a CSV table ({error})") from error
    lines = [(number, cells) for number, cells in lines if any(cells)]
    if not lines:
        raise T2TwinError(f"{path} is empty; expected a CSV table")
    (_, names), *others = lines
    rows = []
    for number, cells in others:
        place = f"line {number}"
        if len(cells) != len(names):
            raise T2TwinError(f"{path}, {place}: {len(cells)} cells in {len(names)} columns")
        if delimiter != ",":
            cells = [DECIMAL_COMMA.sub(r"\1.\2", each) for each in cells]
        rows.append((place, {name: cell for name, cell in zip(names, cells, strict=True) if cell}))
    return names, rows


def read_rows(path: Path, kind: type[Record]) -> tuple[Record, ...]:
    """The rows of a CSV file. kind: a dataclass whose fields are the columns, defaults of empty
    cells. Raises T2TwinError, with the line, for other columns and values that do not fit."""
    names, rows = read_csv(path)
    known = fields(kind)  # pyright: ignore[reportArgumentType]
    check_names(names, [field.name for field in known], path)
    for field in known:
        if field.default is MISSING and field.name not in names:
            raise T2TwinError(f"{path} has no column {field.name}; it has {', '.join(names)}")
    records = []
    for place, cells in rows:
        records.append(convert(cells, kind, f"{path}, {place}", strict=False))
        for name, value in vars(records[-1]).items():
            if isinstance(value, float) and name in cells and not isfinite(value):
                raise T2TwinError(f"{path}, {place}: {name} is {value}; expected a finite number")
    return tuple(records)
