"""What a shard must hold, checked where it is read: whatever else is there was damaged or made by
something else."""

import numpy as np
import pyarrow as pa

from t2twin.sim.dataset.columns import FIELD
from t2twin.sim.dataset.info import DatasetInfo, Shard

ALWAYS = ("shape", "family", "split", "index", "taxels")
"""Columns that have a value in every row; imported pairs may know nothing of the rest."""


def check_table(
    table: pa.Table, columns: list[str], schema: pa.Schema, shard: Shard, info: DatasetInfo
) -> None:
    """Raises ValueError, with what is wrong, for a shard's table that is not as it was written.

    columns: those that were asked for. schema: the dataset's. shard, info: what info.json says of
    the shard and of the dataset.
    """
    for name in columns:
        if name not in table.column_names:
            raise ValueError(f"it lacks the column {name}")
        kind, wanted = table.schema.field(name).type, schema.field(name).type
        if kind != wanted:
            raise ValueError(f"its column {name} holds {kind} and must hold {wanted}")
        if name in ALWAYS and table[name].null_count:
            raise ValueError(f"its column {name} has empty rows")
        if pa.types.is_floating(kind) and not np.isfinite(table[name].drop_null()).all():
            raise ValueError(f"its column {name} has values that are not finite")
    if table.num_rows != shard.pairs:
        raise ValueError(f"it has {table.num_rows} rows instead of {shard.pairs}")
    for name, places in (("taxels", info.layout_x_mm), (FIELD, info.field_x_mm or ())):
        if name in columns:
            _check_counts(table[name], name, len(places), info.full_scale_counts)


def _check_counts(column: pa.ChunkedArray, name: str, places: int, full_scale: int) -> None:
    rows = column.combine_chunks()
    lengths = set(rows.value_lengths().to_pylist())
    if lengths - {places}:
        named = name if name == "taxels" else f"places of its {name}"
        raise ValueError(f"it has rows of {min(lengths - {places})} {named} instead of {places}")
    counts = rows.flatten()
    if counts.null_count:
        raise ValueError(f"it has {name} without a count")
    most = counts.to_numpy().max(initial=0)
    if most > full_scale:
        raise ValueError(f"it has a count of {most}, over the full scale of {full_scale}")
