"""CSV read into frozen dataclasses, a row each; whatever does not fit becomes one sentence."""

from dataclasses import MISSING, fields
from pathlib import Path
from typing import TypeVar

from t2twin.primitives_cad.errors import T2TwinError
from t2twin.sim.csv_table import ERRORS, read_csv
from t2twin.sim.typed_json import convert

Record = TypeVar("Record")


def read_rows(path: Path, kind: type[Record], what: str) -> tuple[Record, ...]:
    """The rows of a CSV file, in its order.

    kind: a dataclass, whose fields are columns; those without a default must be there. Other
    columns are left out, and so are empty cells. what: the file is, for messages.
    Raises T2TwinError that names the file and, where it can, the line and the column.
    """
    try:
        table, places = read_csv(path.read_bytes())
    except (*ERRORS, OSError) as error:
        raise T2TwinError(f"{path} cannot be read as {what}'s CSV ({error})") from error
    for field in fields(kind):  # pyright: ignore[reportArgumentType]
        if field.default is MISSING and field.name not in table.column_names:
            raise T2TwinError(
                f"{path} has no column {field.name}; its columns are "
                f"{', '.join(table.column_names)}"
            )
    # A row's empty cells are left out, as a key of JSON may be.
    rows = [
        {name: value for name, value in row.items() if value is not None}
        for row in table.to_pylist()
    ]
    sources = (f"{path}, {place}" for place in places)
    return tuple(convert(row, kind, at) for row, at in zip(rows, sources, strict=True))
