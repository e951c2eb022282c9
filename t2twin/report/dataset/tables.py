"""A dataset as the report draws it: tables of its pairs, pictures one by one.

Shape letters: P pairs of all splits, N taxels, R rows and C columns of a picture.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from t2twin.core.errors import T2TwinError
from t2twin.core.images import decode_png
from t2twin.sim.cyskin.layout import PAD_DIAMETER_MM
from t2twin.sim.cyskin.phi import Phi
from t2twin.sim.dataset.info import SPLITS, DatasetInfo
from t2twin.sim.dataset.store import read_info, read_split, split_shards, taxels
from t2twin.translate.data.pairs import DataInfo, load_info

COLUMNS = [
    "shape",
    "family",
    "index",
    "x_mm",
    "y_mm",
    "yaw_rad",
    "force_n",
    "taxels",
    *(
        f"{sensor}_{what}"
        for sensor in ("digit", "cyskin")
        for what in ("depth_mm", "force_n", "settled", "bottomed")
    ),
]
"""What the report reads of every pair; pictures are read one by one."""

SATURATED_SHARE = 0.999
"""Part of full scale above which a count is taken as saturated (assumed: ten times the noise)."""


@dataclass(frozen=True)
class Dataset:
    """A dataset as the report draws it.

    data: its folder. info: its info.json; layout: the part of it that phi needs. tables: COLUMNS
    of every split that has pairs.
    """

    data: Path
    info: DatasetInfo
    layout: DataInfo
    phi: Phi
    tables: dict[str, pa.Table]

    def image(self, split: str, row: int) -> np.ndarray:
        """The DIGIT picture of a split's row, read from its shard alone.

        (R, C, 3) uint8, of one size in the whole dataset; simulated ones are (320, 240, 3).
        """
        path, place = self._shard(split, row)
        with pq.ParquetFile(self.data / path) as shard:
            for group in range(shard.num_row_groups):
                rows = shard.metadata.row_group(group).num_rows
                if place < rows:
                    images = shard.read_row_group(group, columns=["image"])["image"]
                    return decode_png(images[place].as_py()["bytes"])
                place -= rows
        raise AssertionError("a row lies in one of its file's groups")

    def _shard(self, split: str, row: int) -> tuple[str, int]:
        """The shard that a split's row lies in, and its row there."""
        for path in split_shards(self.info, split):
            pairs = self.info.shards[path].pairs
            if row < pairs:
                return path, row
            row -= pairs
        raise AssertionError("a split's rows are those of its shards")

    def shape(self, split: str, row: int) -> str:
        """The shape's name of a split's row."""
        return self.tables[split]["shape"][row].as_py()

    def column(self, name: str) -> np.ndarray:
        """A column of all splits, one after another: (P,). Numbers that are empty are NaN."""
        return np.concatenate([table[name].to_numpy() for table in self.tables.values()])

    @property
    def shapes(self) -> np.ndarray:
        """Each pair's shape, in the order of `column`: (P,) names."""
        return self._names("shape")

    @property
    def families(self) -> np.ndarray:
        """Each pair's family, in the order of `column`: (P,) names."""
        return self._names("family")

    def _names(self, column: str) -> np.ndarray:
        return np.concatenate([table[column].to_pylist() for table in self.tables.values()])

    @property
    def forces_n(self) -> np.ndarray:
        """The forces that were commanded, to a hundredth and each once, (k,) N, rising; without
        those that are not known, and 0 for presses that touch nothing."""
        force_n = self.column("force_n").astype(float)
        return np.unique(force_n[np.isfinite(force_n)].round(2))

    @property
    def places(self) -> list[tuple[str, int]]:
        """Split and row of every pair, in the order of `column`."""
        return [(split, row) for split, table in self.tables.items() for row in range(len(table))]

    @property
    def counts(self) -> np.ndarray:
        """All taxels' counts, in the order of `column`: (P, N)."""
        return np.concatenate([taxels(table) for table in self.tables.values()])

    @property
    def saturated(self) -> np.ndarray:
        """(P, N), which counts are saturated: a mean of noisy readings that are cut off at full
        scale lies a little below it."""
        return self.counts >= SATURATED_SHARE * self.layout.full_scale_counts

    @property
    def pad_diameter_mm(self) -> np.ndarray:
        """(N,), the default layout's where the dataset does not say."""
        parameters = self.info.parameters
        pads = parameters.cyskin.pad_diameter_mm if parameters else self.info.pad_diameter_mm
        return np.full(self.layout.x_mm.size, PAD_DIAMETER_MM) if pads is None else np.array(pads)


def read_dataset(data: Path) -> Dataset:
    """Reads a dataset alone. Raises T2TwinError where it is missing, unfinished or empty."""
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
