"""A user's table of pairs, CSV or Parquet, and where each of its rows stands, for messages."""

import csv
import io
import re
from pathlib import Path

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq

from t2twin.primitives_cad.errors import T2TwinError

SUFFIXES = (".csv", ".parquet")

DELIMITERS = (b",", b";", b"\t")
"""What may stand between a CSV file's columns; spreadsheets of many countries write the second."""

DECIMAL_COMMA = re.compile(rb"[;\t\n]-?\d+,\d+(?=[;\t\r\n]|$)")
"""A number with a decimal comma, where columns are not divided by commas."""


def find_table(source: Path) -> Path:
    """The table itself: source, or the one in that folder. Raises T2TwinError."""
    if source.is_dir():
        tables = sorted(path for path in source.iterdir() if path.suffix.lower() in SUFFIXES)
        if len(tables) != 1:
            raise T2TwinError(
                f"{source} holds {len(tables)} CSV and Parquet files; name the one with the pairs"
            )
        return tables[0]
    if not source.is_file() or source.suffix.lower() not in SUFFIXES:
        raise T2TwinError(f"{source} is no pairs; give a .csv or .parquet file, or its folder")
    return source


def read_table(path: Path) -> tuple[pa.Table, list[str]]:
    """The table, and each row's place: "line 2" of a CSV file, "row 1" of Parquet, from 1.

    A CSV file's columns stand between commas, semicolons or tabs, whichever its first line has
    most of. Raises T2TwinError for a file that cannot be read, or holds no rows.
    """
    try:
        if path.suffix.lower() == ".csv":
            table, places = _read_csv(path.read_bytes())
        else:
            with pq.ParquetFile(path) as file:
                table = file.read()
            places = _rows(table)
    except (pa.ArrowException, OSError, UnicodeDecodeError, csv.Error) as error:
        raise T2TwinError(f"{path} cannot be read as a table of pairs ({error})") from error
    if not len(table):
        raise T2TwinError(f"{path} holds no pairs")
    twice = sorted({name for name in table.column_names if table.column_names.count(name) > 1})
    if twice:
        raise T2TwinError(f"{path} has two columns {twice[0]}; leave one out")
    return table, places


def _read_csv(content: bytes) -> tuple[pa.Table, list[str]]:
    first_line = content.partition(b"\n")[0]
    delimiter = max(DELIMITERS, key=first_line.count)
    comma = delimiter != b"," and DECIMAL_COMMA.search(content)
    table = pyarrow.csv.read_csv(
        io.BytesIO(content),
        parse_options=pyarrow.csv.ParseOptions(delimiter=delimiter.decode()),
        convert_options=pyarrow.csv.ConvertOptions(decimal_point="," if comma else "."),
    )
    # Lines that are empty are no rows.
    text = io.StringIO(content.decode("utf-8-sig"), newline="")
    lines = csv.reader(text, delimiter=delimiter.decode())
    places = [f"line {lines.line_num}" for row in lines if row][1:]
    # Quotes may hide ends of lines from one reader and not from the other.
    return table, places if len(places) == len(table) else _rows(table)


def _rows(table: pa.Table) -> list[str]:
    return [f"row {number}" for number in range(1, len(table) + 1)]
