"""Reads CSV files of spreadsheets: into tables, and into frozen dataclasses, one for each row.

Content that does not fit raises a T2TwinError of one sentence with the line and the column.
"""

import csv
import io
import re
from collections.abc import Sequence
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

DELIMITERS = (b",", b";", b"\t")
"""Delimiters of CSV columns; spreadsheets of many countries write the second."""

DECIMAL_COMMA = re.compile(rb"(?:^|[;\t\n])-?\d+,\d+(?=[;\t\r\n]|$)")
"""A number with a decimal comma, where commas do not delimit columns."""

ERRORS = (pa.ArrowException, UnicodeDecodeError, csv.Error)
"""Exceptions of `read_csv` for content that is not a table."""


def read_rows(path: Path, kind: type[Record], what: str) -> tuple[Record, ...]:
    """The rows of a CSV file, in its order.

    kind: a dataclass whose fields are the columns; fields without a default are required, other
    columns are rejected. An empty cell takes the field's default. what: name of the file's
    content, for messages. Raises T2TwinError with the file and, if known, the line and the column.
    """
    content = read_file(path)
    known = fields(kind)  # pyright: ignore[reportArgumentType]
    try:
        table, places = read_csv(content, [field.name for field in known if field.type is str])
    except ERRORS as error:
        raise T2TwinError(f"{path} cannot be read as {what}'s CSV ({error})") from error
    check_names(table.column_names, [field.name for field in known], path)
    for field in known:
        if field.default is MISSING and field.name not in table.column_names:
            raise T2TwinError(
                f"{path} has no column {field.name}; its columns are "
                f"{', '.join(table.column_names)}"
            )
    rows = zip(table.to_pylist(), (f"{path}, {place}" for place in places), strict=True)
    needed = {field.name for field in known if field.default is MISSING}
    return tuple(convert(_cells(row, at, needed), kind, at) for row, at in rows)


def _cells(row: dict[str, Any], at: str, needed: set[str]) -> dict[str, Any]:
    """The nonempty cells of a row. needed: columns that may not be empty. Raises T2TwinError for a
    number that is not finite."""
    for name, value in row.items():
        if isinstance(value, float) and not isfinite(value):
            other = "" if name in needed else ", or empty where it is not known"
            raise T2TwinError(f"{at}: {name} is {value}; it must be a finite number{other}")
    return {name: value for name, value in row.items() if value is not None}


def read_csv(content: bytes, texts: Sequence[str] = ()) -> tuple[pa.Table, list[str]]:
    """The table, and the place of each row in the file, such as "line 2".

    The delimiter is the most frequent one in the first line. Skips a byte order mark, empty lines,
    and spaces around cells. texts: columns that are text, also where all cells are numbers; an
    empty cell is null. Raises ERRORS.
    """
    first_line = content.partition(b"\n")[0]
    delimiter = max(DELIMITERS, key=first_line.count)
    reader = _reader(content, delimiter)
    places = [f"line {reader.line_num}" for row in reader if row][1:]
    if b" " in content:
        content = _without_spaces(content, delimiter)
    comma = delimiter != b"," and DECIMAL_COMMA.search(content)
    table = pyarrow.csv.read_csv(
        io.BytesIO(content),
        # A process that ends while threads of Arrow still run may abort.
        read_options=pyarrow.csv.ReadOptions(use_threads=False),
        parse_options=pyarrow.csv.ParseOptions(delimiter=delimiter.decode()),
        convert_options=pyarrow.csv.ConvertOptions(
            decimal_point="," if comma else ".",
            null_values=[""],
            strings_can_be_null=True,
            column_types=dict.fromkeys(texts, pa.string()),
        ),
    )
    # The two readers may disagree about line ends within quotes.
    return table, places if len(places) == len(table) else row_labels(table)


def _reader(content: bytes, delimiter: bytes) -> Any:
    """A reader of the csv module."""
    text = io.StringIO(content.decode("utf-8-sig"), newline="")
    return csv.reader(text, delimiter=delimiter.decode(), skipinitialspace=True)


def _without_spaces(content: bytes, delimiter: bytes) -> bytes:
    """The CSV without the spaces around its cells, which Arrow keeps."""
    if content.count(b'"') % 2:
        raise csv.Error("a quotation mark is not closed")
    text = io.StringIO()
    rows = ([cell.strip() for cell in row] for row in _reader(content, delimiter))
    csv.writer(text, delimiter=delimiter.decode()).writerows(rows)
    return text.getvalue().encode()


def row_labels(table: pa.Table) -> list[str]:
    """Places of the rows of a table without lines, such as "row 1"."""
    return [f"row {number}" for number in range(1, len(table) + 1)]
