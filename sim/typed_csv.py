"""CSV read into frozen dataclasses, one row each; what does not fit raises one sentence."""

from dataclasses import MISSING, fields
from math import isfinite
from pathlib import Path
from typing import Any, TypeVar

from t2twin.primitives_cad.errors import T2TwinError
from t2twin.primitives_cad.reading import read_file
from t2twin.sim.column_names import check_names
from t2twin.sim.csv_table import ERRORS, read_csv
from t2twin.sim.typed_json import convert

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
