"""CSV read into frozen dataclasses, one row each; what does not fit raises one sentence.

CSV as spreadsheets write it: delimiters, decimal commas, and where each row stands.
"""

import csv
import io
import re
from dataclasses import MISSING, fields
from math import isfinite
from pathlib import Path
from typing import Any, TypeVar

import pyarrow as pa
import pyarrow.csv

from t2twin.core.errors import T2TwinError
from t2twin.core.files import read_file
from t2twin.core.records import check_names, convert

Record = TypeVar("Record")


def read_rows(path: Path, kind: type[Record], what: str) -> tuple[Record, ...]:
    """The rows of a CSV file, in its order.

    kind: a dataclass, whose fields are the columns; those without a default must be there, and no
    others may be. An empty cell takes its field's default. what: the file is, for messages.
    Raises T2TwinError that names the file and, where it can, the line and the column.
    """
    content = read_file(path)
    try:
        table, places = read_csv(content)
    except ERRORS as error:
        raise T2TwinError(f"{path} cannot be read as {what}'s CSV ({error})") from error
    known = fields(kind)  # pyright: ignore[reportArgumentType]
    check_names(table.column_names, [field.name for field in known], path)
    for field in known:
        if field.default is MISSING and field.name not in table.column_names:
            raise T2TwinError(
                f"{path} has no column {field.name}; its columns are "
                f"{', '.join(table.column_names)}"
            )
    rows = zip(table.to_pylist(), (f"{path}, {place}" for place in places), strict=True)
    return tuple(convert(_cells(row, at), kind, at) for row, at in rows)


def _cells(row: dict[str, Any], at: str) -> dict[str, Any]:
    """The cells that are not empty. Raises T2TwinError for a number that is not finite."""
    for name, value in row.items():
        if isinstance(value, float) and not isfinite(value):
            raise T2TwinError(
                f"{at}: {name} is {value}; it must be a finite number, or empty where it is not "
                "known"
            )
    return {name: value for name, value in row.items() if value is not None}


DELIMITERS = (b",", b";", b"\t")
"""What may stand between a CSV file's columns; spreadsheets of many countries write the second."""

DECIMAL_COMMA = re.compile(rb"(?:^|[;\t\n])-?\d+,\d+(?=[;\t\r\n]|$)")
"""A number with a decimal comma, where columns are not divided by commas."""

ERRORS = (pa.ArrowException, UnicodeDecodeError, csv.Error)
"""What read_csv raises for what is no table."""


def read_csv(content: bytes) -> tuple[pa.Table, list[str]]:
    """The table, and each row's place in the file: "line 2".

    Columns stand between commas, semicolons or tabs, whichever the first line has most of. A byte
    order mark and empty lines are passed over. Raises ERRORS.
    """
    first_line = content.partition(b"\n")[0]
    delimiter = max(DELIMITERS, key=first_line.count)
    comma = delimiter != b"," and DECIMAL_COMMA.search(content)
    table = pyarrow.csv.read_csv(
        io.BytesIO(content),
        parse_options=pyarrow.csv.ParseOptions(delimiter=delimiter.decode()),
        convert_options=pyarrow.csv.ConvertOptions(
            decimal_point="," if comma else ".", null_values=[""]
        ),
    )
    # Lines that are empty are no rows.
    text = io.StringIO(content.decode("utf-8-sig"), newline="")
    lines = csv.reader(text, delimiter=delimiter.decode())
    places = [f"line {lines.line_num}" for row in lines if row][1:]
    # Quotes may hide ends of lines from one reader and not from the other.
    return table, places if len(places) == len(table) else rows(table)


def rows(table: pa.Table) -> list[str]:
    """The rows of a table that has no lines, from 1."""
    return [f"row {number}" for number in range(1, len(table) + 1)]
