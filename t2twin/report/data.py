"""A dataset in memory, without images, which are read individually; pictures of its pairs.

Shape letters: P pairs of all splits, N taxels, R rows and C columns of an image.
"""

from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
import pandas as pd

from t2twin.core.draw import Panel, panels_image, tactile_panel
from t2twin.core.errors import T2TwinError
from t2twin.core.images import decode_png
from t2twin.report.page import printable
from t2twin.sim.dataset.columns import CONTACT, COUNTS, IMAGE, POSE, column
from t2twin.sim.dataset.info import SPLITS, DatasetInfo, SensorInfo
from t2twin.sim.dataset.store import iter_images, lists, read_info, read_split, split_shards
from t2twin.sim.taxels.layout import Layout
from t2twin.sim.taxels.phi import PX_PER_MM, TACTILE_SHAPE, Phi
from t2twin.sim.taxels.reading import expected_reading

COLUMNS = ("shape", "family", "index", *POSE)
"""Columns of the table, besides those of the contacts."""

SATURATED_SHARE = 0.999
"""Share of full scale above which a count is saturated (assumed: ten times the noise)."""

MIN_CONTACT_SHARE = 0.0025
"""Smallest count of a touched taxel, share of full scale (assumed)."""

AT_REST_STDS = 10.0
"""Smallest count of a touched taxel over its mean at rest, standard deviations of the noise
(assumed: 0.6 % of the samples without contact have one)."""

ROUNDING_COUNTS = 0.5
MAX_LISTED_FORCES = 6

MAX_NAMES = 60
"""Maximum number of names that are sampled in their order (assumed: the number of images)."""


@dataclass(frozen=True)
class Array:
    """A taxel array of a dataset.

    info: its record. phi: of its taxels. counts: (P, N), in the order of Dataset.table.
    """

    info: SensorInfo
    phi: Phi
    counts: np.ndarray

    @property
    def layout(self) -> Layout:
        """The taxels, with default pads if theirs are unknown."""
        return self.info.taxels

    @property
    def full_scale(self) -> int:
        """Count at which a taxel saturates."""
        assert self.info.full_scale_counts is not None
        return self.info.full_scale_counts

    @property
    def saturated(self) -> np.ndarray:
        """(P, N) bool: saturated counts; the mean of noisy, clipped ones is below full scale."""
        return self.counts >= SATURATED_SHARE * self.full_scale

    @property
    def largest(self) -> np.ndarray:
        """(P,) largest count of each pair."""
        return self.counts.max(axis=1)

    @property
    def touched(self) -> np.ndarray:
        """(P,) bool: pairs in which a taxel exceeds MIN_CONTACT_SHARE of full scale, and its
        readings at rest if their noise is known."""
        least = np.full(self.counts.shape[1], MIN_CONTACT_SHARE * self.full_scale)
        flaws = self.info.imperfections
        if flaws is not None:
            mean, std = expected_reading(flaws, self.info.reading, np.zeros_like(least))
            std = np.hypot(std, flaws.drift_counts if flaws.drift_share else 0.0)
            least = np.maximum(least, mean + AT_REST_STDS * std + ROUNDING_COUNTS)
        return np.any(self.counts >= least, axis=1)


@dataclass(frozen=True)
class Dataset:
    """A dataset for a report.

    data: folder. info: content of info.json. arrays: the taxel arrays by role. table: a row for
    each pair of all splits, in their order, with "split", COLUMNS and the contacts of the sensors.
    """

    data: Path
    info: DatasetInfo
    arrays: dict[str, Array]
    table: pd.DataFrame

    @property
    def cameras(self) -> dict[str, SensorInfo]:
        """The gel cameras by role."""
        return _of_value(self.info, IMAGE)

    @property
    def array(self) -> Array:
        """The taxel array, the target's first. Raises T2TwinError for a dataset without one."""
        return self.arrays[self.info.role_of(COUNTS)]

    def label(self, role: str) -> str:
        """Displayed name of a sensor, with its role if both sensors have the same name."""
        names = [printable(sensor.name) for sensor in self.info.sensors.values()]
        name = printable(self.info.sensors[role].name)
        return f"{name} ({role})" if names[0] == names[1] else name

    @property
    def camera_name(self) -> str:
        """Displayed name of the first gel camera. Raises T2TwinError for a dataset without one."""
        return self.label(self.info.role_of(IMAGE))

    @property
    def array_name(self) -> str:
        """Displayed name of `array`. Raises T2TwinError for a dataset without one."""
        return self.label(self.info.role_of(COUNTS))

    def column(self, name: str) -> np.ndarray:
        """(P,) a column, such as "shape"; missing numbers are NaN."""
        return self.table[name].to_numpy()

    def contact(self, role: str, name: str) -> np.ndarray:
        """(P,) a column of the contacts of a sensor."""
        return self.column(column(role, name))

    @property
    def splits(self) -> np.ndarray:
        """(P,) split of each pair."""
        return self.column("split")

    def pairs_of(self, split: str) -> np.ndarray:
        """Places in the table of the pairs of a split."""
        return np.flatnonzero(self.splits == split)

    @property
    def forces_n(self) -> np.ndarray:
        """(k,) unique commanded forces, N, ascending, rounded to 0.01 N; 0 without contact."""
        force_n = self.column("force_n").astype(float)
        return np.unique(force_n[np.isfinite(force_n)].round(2))

    @property
    def forces_text(self) -> str:
        """Forces as text: "8 N", "1, 2 and 8 N" or "0.52 to 11.9 N"."""
        touching = [f"{force:.3g}" for force in self.forces_n if force > 0]
        if not touching:
            return "none"
        if len(touching) > MAX_LISTED_FORCES:
            return f"{touching[0]} to {touching[-1]} N"
        return " and ".join(filter(None, (", ".join(touching[:-1]), touching[-1]))) + " N"

    @property
    def without_contact(self) -> np.ndarray:
        """(P,) bool: pairs in which no taxel is touched; without taxel arrays, of 0 N."""
        if not self.arrays:
            return self.column("force_n") == 0
        return ~np.any([array.touched for array in self.arrays.values()], axis=0)

    def image(self, place: int, role: str | None = None) -> np.ndarray:
        """The image of a pair, (R, C, 3) uint8. role: of the gel camera; None for the first."""
        name, split = column(role or self.info.role_of(IMAGE), IMAGE), self.splits[place]
        row = place - int(self.pairs_of(split)[0])
        for path in split_shards(self.info, split):
            pairs = self.info.shards[path].pairs
            if row < pairs:
                return decode_png(next(islice(iter_images(self.data, path, name), row, None)))
            row -= pairs
        raise AssertionError("the row is in a shard of its split")

    def picture(self, place: int, width_in: float) -> bytes:
        """PNG of the readings of both sensors, source first."""
        panels = []
        for role in self.info.sensors:
            title = self.label(role)
            if role in self.cameras:
                panels.append(Panel(title, self.image(place, role)))
                continue
            array = self.arrays[role]
            scale = "counts" if len(self.arrays) == 1 else f"counts of {title}"
            image = array.phi(array.counts[place])
            panels.append(tactile_panel(title, image, array.phi, array.layout, scale))
        return panels_image(panels, width_in)

    def sample_in_turn(self, name: str, number: int, seed: int = 0) -> list[int]:
        """Places of sampled pairs: one of each value of a column, then further ones of each.

        Of more than MAX_NAMES values, their order is random.
        """
        rng = np.random.default_rng(seed)
        groups = self.table.groupby(name, sort=False, dropna=False)
        orders = [rng.permutation(group.index) for _, group in groups]
        if len(orders) > MAX_NAMES:
            orders = [orders[i] for i in rng.permutation(len(orders))]
        deepest = max(map(len, orders))
        turns = [order[turn] for turn in range(deepest) for order in orders if turn < len(order)]
        return [int(place) for place in turns[:number]]


def read_dataset(data: Path) -> Dataset:
    """Reads a dataset. Raises T2TwinError as Phi, and if it is missing, unfinished or empty."""
    info = read_info(data)
    splits = [split for split in SPLITS if info.pairs[split]]
    if not splits:
        raise T2TwinError(f"the dataset in {data} has no pairs")
    names = [*COLUMNS, *(column(role, name) for role in info.sensors for name in CONTACT)]
    of_arrays = {role: column(role, COUNTS) for role in _of_value(info, COUNTS)}
    tables = [read_split(data, split, [*names, *of_arrays.values()]) for split in splits]
    frames = [
        table.select(names).to_pandas().assign(split=split)
        for split, table in zip(splits, tables, strict=True)
    ]
    arrays = {}
    for role, name in of_arrays.items():
        sensor = info.sensors[role]
        rows, columns, px_per_mm = sensor.tactile_image or (*TACTILE_SHAPE, PX_PER_MM)
        phi = Phi(np.array(sensor.x_mm), np.array(sensor.y_mm), (rows, columns), px_per_mm)
        arrays[role] = Array(sensor, phi, np.concatenate([lists(table, name) for table in tables]))
    return Dataset(data, info, arrays, pd.concat(frames, ignore_index=True))


def _of_value(info: DatasetInfo, value: str) -> dict[str, SensorInfo]:
    """The sensors of a value, by role."""
    return {role: sensor for role, sensor in info.sensors.items() if sensor.value == value}
