"""A user's table of pairs, CSV or Parquet, and where each of its rows stands, for messages."""

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from t2twin.primitives_cad.errors import T2TwinError
from t2twin.sim.csv_table import ERRORS, read_csv, rows

SUFFIXES = (".csv", ".parquet")


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
            table, places = read_csv(path.read_bytes())
        else:
            with pq.ParquetFile(path) as file:
                table = file.read()
            places = rows(table)
    except (*ERRORS, OSError) as error:
        # What is said of Parquet is of its reader's insides.
        reason = f" ({error})" if path.suffix.lower() == ".csv" else ""
        raise T2TwinError(f"{path} cannot be read as a table of pairs{reason}") from error
    if not len(table):
        raise T2TwinError(f"{path} holds no pairs")
    twice = sorted({name for name in table.column_names if table.column_names.count(name) > 1})
    if twice:
        raise T2TwinError(f"{path} has two columns {twice[0]}; leave one out")
    return table, places
