"""A dataset in memory: tables of its pairs, without images, which are read individually.

Shape letters: P pairs of all splits, N taxels, R rows and C columns of an image.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from t2twin.core.errors import T2TwinError
from t2twin.core.images import decode_png
from t2twin.sim.dataset.info import SPLITS, DatasetInfo
from t2twin.sim.dataset.store import read_info, read_split, split_shards, taxels
from t2twin.sim.taxels.layout import PAD_DIAMETER_MM
from t2twin.sim.taxels.phi import Phi
from t2twin.translate.data.pairs import DataInfo, load_info

COLUMNS = [
    "shape", "family", "index", "x_mm", "y_mm", "yaw_rad", "force_n", "taxels",
    "digit_depth_mm", "digit_force_n", "digit_settled", "digit_bottomed",
    "cyskin_depth_mm", "cyskin_force_n", "cyskin_settled", "cyskin_bottomed",
]  # fmt: skip
"""Columns of the tables."""

SATURATED_SHARE = 0.999
"""Share of full scale above which a count is saturated (assumed: ten times the noise)."""


@dataclass(frozen=True)
class Dataset:
    """A dataset for a report.

    data: folder. info: content of info.json. layout: taxels for phi. tables: COLUMNS of every split
    with pairs.
    """

    data: Path
    info: DatasetInfo
    layout: DataInfo
    phi: Phi
    tables: dict[str, pa.Table]

    def image(self, split: str, row: int) -> np.ndarray:
        """The DIGIT image of a row, (R, C, 3) uint8; simulated images are (320, 240, 3)."""
        path, place = self._shard(split, row)
        with pq.ParquetFile(self.data / path) as shard:
            for group in range(shard.num_row_groups):
                rows = shard.metadata.row_group(group).num_rows
                if place < rows:
                    images = shard.read_row_group(group, columns=["image"])["image"]
                    return decode_png(images[place].as_py()["bytes"])
                place -= rows
        raise AssertionError("the row is in a row group of its shard")

    def _shard(self, split: str, row: int) -> tuple[str, int]:
        """Path of the shard that contains a row of a split, and the row's index in it."""
        for path in split_shards(self.info, split):
            pairs = self.info.shards[path].pairs
            if row < pairs:
                return path, row
            row -= pairs
        raise AssertionError("the row is in a shard of its split")

    def row(self, split: str, row: int) -> dict[str, Any]:
        """Values of a row by column."""
        return self.tables[split].slice(row, 1).to_pylist()[0]

    def column(self, name: str) -> np.ndarray:
        """(P,) a column of all splits; missing numbers are NaN."""
        return np.concatenate([table[name].to_numpy() for table in self.tables.values()])

    @property
    def shapes(self) -> np.ndarray:
        """(P,) shape of each pair, in the order of `column`."""
        return self._names("shape")

    @property
    def families(self) -> np.ndarray:
        """(P,) family of each pair, in the order of `column`."""
        return self._names("family")

    def _names(self, column: str) -> np.ndarray:
        return np.concatenate([table[column].to_pylist() for table in self.tables.values()])

    @property
    def forces_n(self) -> np.ndarray:
        """(k,) unique commanded forces, N, ascending, rounded to 0.01 N; 0 without contact.

        Unknown forces are omitted.
        """
        force_n = self.column("force_n").astype(float)
        return np.unique(force_n[np.isfinite(force_n)].round(2))

    @property
    def places(self) -> list[tuple[str, int]]:
        """Split and row of every pair, in the order of `column`."""
        return [(split, row) for split, table in self.tables.items() for row in range(len(table))]

    @property
    def counts(self) -> np.ndarray:
        """(P, N) counts, in the order of `column`."""
        return np.concatenate([taxels(table) for table in self.tables.values()])

    @property
    def saturated(self) -> np.ndarray:
        """(P, N) bool: saturated counts; the mean of noisy, clipped ones is below full scale."""
        return self.counts >= SATURATED_SHARE * self.layout.full_scale_counts

    @property
    def pad_diameter_mm(self) -> np.ndarray:
        """(N,) pad diameters; those of the default layout if the dataset has none."""
        parameters = self.info.parameters
        pads = parameters.cyskin.pad_diameter_mm if parameters else self.info.pad_diameter_mm
        return np.full(self.layout.x_mm.size, PAD_DIAMETER_MM) if pads is None else np.array(pads)


def read_dataset(data: Path) -> Dataset:
    """Reads a dataset. Raises T2TwinError if it is missing, unfinished or empty."""
    info, layout = read_info(data), load_info(data)
    with_pairs = {split for split in SPLITS if info.pairs[split]}
    if not with_pairs:
        raise T2TwinError(f"the dataset in {data} has no pairs")
    return Dataset(
        data=data,
        info=info,
        layout=layout,
        phi=Phi(layout.x_mm, layout.y_mm),
        tables={s: read_split(data, s, COLUMNS) for s in SPLITS if s in with_pairs},
    )
