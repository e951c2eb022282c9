"""Reads a user's table of pairs from CSV or Parquet."""

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from t2twin.core.errors import T2TwinError
from t2twin.core.files import open_regular, read_file
from t2twin.core.records import check_names
from t2twin.sim.tables import ERRORS, read_csv, row_labels

SUFFIXES = (".csv", ".parquet")

TEXTS = ("image", "split", "shape", "family")
"""Columns of CSV that are text, also where they look like numbers."""

MAX_PARQUET_BYTES = 1_000_000_000
"""Largest Parquet file, also when decoded, bytes (assumed: 10,000 images of 100 kB)."""

BATCH_ROWS = 64
"""Rows that are decoded together (assumed: some MB)."""


def find_table(source: Path) -> Path:
    """The table: source, or the only one in that folder. Raises T2TwinError without one."""
    if source.is_dir():
        tables = [
            path
            for path in source.iterdir()
            if path.suffix.lower() in SUFFIXES and not path.name.startswith(".")
        ]
        if not tables:
            raise T2TwinError(
                f"{source} contains no CSV or Parquet file; expected a folder with the table of "
                "pairs and its images"
            )
        if len(tables) > 1:
            raise T2TwinError(
                f"{source} holds {len(tables)} CSV and Parquet files; name the one with the pairs"
            )
        source = tables[0]
    if not source.is_file() or source.suffix.lower() not in SUFFIXES:
        raise T2TwinError(
            f"{source} is not a table of pairs; expected a .csv or .parquet file, or its folder"
        )
    return source


def read_table(path: Path) -> tuple[pa.Table, list[str]]:
    """The table, and the place of each row for messages: "line 2" of CSV, "row 1" of Parquet.

    The separator of CSV is the one of comma, semicolon and tab that is most frequent in the first
    line. Raises T2TwinError for a file that cannot be read, is too large, or has no rows.
    """
    is_csv = path.suffix.lower() == ".csv"
    try:
        if is_csv:
            table, places = read_csv(read_file(path), TEXTS)
        else:
            table = _read_parquet(path)
            places = row_labels(table)
    except (*ERRORS, OSError) as error:
        # Messages of the Parquet reader are not for users.
        reason = f" ({error})" if is_csv else ""
        raise T2TwinError(f"{path} cannot be read as a table of pairs{reason}") from error
    if not len(table):
        raise T2TwinError(f"{path} contains no pairs")
    check_names(table.column_names, (), path, others=True)
    return table, places


def _read_parquet(path: Path) -> pa.Table:
    """A Parquet file. Raises T2TwinError if its decoded rows are larger than MAX_PARQUET_BYTES."""
    with open_regular(path, MAX_PARQUET_BYTES) as stream, pq.ParquetFile(stream) as file:
        batches, size = [], 0
        for batch in file.iter_batches(BATCH_ROWS):
            size += batch.nbytes
            if size > MAX_PARQUET_BYTES:
                raise T2TwinError(
                    f"{path} holds more than {MAX_PARQUET_BYTES / 1e6:,.0f} MB of rows, the most "
                    "allowed; use a CSV file and separate files of images"
                )
            batches.append(batch)
        return pa.Table.from_batches(batches, file.schema_arrow)
