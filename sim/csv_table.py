"""CSV as spreadsheets write it: delimiters, decimal commas, and where each row stands."""

import csv
import io
import re

import pyarrow as pa
import pyarrow.csv

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
