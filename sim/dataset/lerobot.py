"""Converts a dataset to LeRobot's format v3.0 (https://huggingface.co/docs/lerobot).

    DIR/meta/info.json                              features, and the episodes of each split
    DIR/meta/stats.json                             statistics of the features
    DIR/meta/tasks.parquet                          the tasks
    DIR/meta/episodes/chunk-000/file-000.parquet    length, place and statistics of each episode
    DIR/meta/t2twin.json                            the dataset's info.json
    DIR/data/chunk-000/file-000.parquet             the frames
    DIR/README.md                                   the card

An episode is a press, or a press and the further touches of its path. A frame is one pair. Images
stay PNG files, so that no video codec changes them.

The features, without those of columns that lack a value in some row; ROLE is source or target:

    observation.images.ROLE             the image of a gel camera
    observation.images.ROLE_background  the background frame of its unit
    observation.ROLE_depth_map_um, ...  the contact maps of a gel camera
    observation.ROLE_counts             the counts of a taxel array
    observation.ROLE_dense_counts       the dense counts
    observation.ROLE_pressure_kpa, ...  pressure and shear on the cover at their places
    observation.ROLE_contact            depth and force, with motion also friction, shear forces,
                                        torque and share of slip
    action                              the commanded pose and force
    ROLE_settled, ...                   flags of the contact solver
    press_index, ROLE_unit, ...         columns index, unit and markers
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain, groupby
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.files import new_folder, write_json
from t2twin.core.images import decode_png
from t2twin.core.progress import Progress
from t2twin.core.templates import render
from t2twin.sim.dataset.card import CARD
from t2twin.sim.dataset.columns import (
    BACKGROUND,
    COUNTS,
    IMAGE,
    IMAGE_TYPE,
    PATH,
    UNIT,
    columns_of,
    schema_of,
    with_features,
)
from t2twin.sim.dataset.info import SPLITS, DatasetInfo
from t2twin.sim.dataset.store import (
    BATCH_ROWS,
    INFO,
    iter_shards,
    read_info,
    row_writer,
    write_whole,
)
from t2twin.sim.sensors.defaults import ROLES

VERSION = "v3.0"  # LeRobot's version of the format
FRAMES_PER_SECOND = 30  # nominal (assumed): the simulated touches are quasi-static
FILES_PER_CHUNK = 1000  # LeRobot's default number of files of a folder
LEVELS = 256  # gray levels of an image

FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
DATA, EPISODES = f"data/{FILE}", f"meta/episodes/{FILE}"
"""Paths of the files of frames, one for each shard, and of episodes."""

EPISODE_NUMBERS = (
    "episode_index", "length", "data/chunk_index", "data/file_index", "dataset_from_index",
    "dataset_to_index", "meta/episodes/chunk_index", "meta/episodes/file_index",
)  # fmt: skip
"""Columns of whole numbers of the file of episodes."""

QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
"""Quantiles of LeRobot's statistics, by name."""

Statistics = dict[str, Any]
"""min, max, mean, std and QUANTILES as nested lists; count as a list of one number."""

Row = dict[str, Any]


def convert_to_lerobot(folder: str | Path, out: str | Path) -> dict[str, Any]:
    """Convert a dataset to LeRobot's format; returns the content of meta/info.json.

    folder: of the dataset. out: folder to write, new or empty. Counts and images are exact, other
    values are rounded to float32. The same dataset gives the same bytes.
    Raises T2TwinError for a folder without a complete dataset, a damaged shard, and an output
    folder that is not empty or cannot be written. Then nothing is written.
    """
    folder = arguments.path(folder, "folder")
    out = arguments.path(out, "out").absolute()
    info = read_info(folder)
    if not any(info.pairs.values()):
        raise T2TwinError(f"the dataset in {folder} has no pairs; expected at least one")
    with new_folder(out) as temporary:
        return _convert(folder, temporary, info)


def _convert(folder: Path, out: Path, info: DatasetInfo) -> dict[str, Any]:
    """Write all files; returns the content of meta/info.json."""
    features = [*features_of(info, _present(folder, info)), *INDICES]
    totals = {feature.name: FeatureStatistics(feature) for feature in features}
    kinds = [("tasks", pa.list_(pa.string())), *((name, pa.int64()) for name in EPISODE_NUMBERS)]
    for name, each in totals.items():
        kinds += [(f"stats/{name}/{key}", kind) for key, kind in each.types().items()]
    tasks: dict[str, int] = {}
    splits: dict[str, str] = {}
    episodes = 0
    with row_writer(
        out / EPISODES.format(chunk_index=0, file_index=0), pa.schema(kinds), []
    ) as write_episode:
        for split, row in _episodes(folder, out, info, features, totals, tasks):
            write_episode(row)
            episodes += 1
            first = splits.get(split, f"{episodes - 1}:").split(":")[0]
            splits[split] = f"{first}:{episodes}"
    path = out / "meta" / "tasks.parquet"  # LeRobot reads the tasks as the index of a table
    table = pd.DataFrame({"task_index": [*tasks.values()]}, pd.Index([*tasks], name="task"))
    write_whole(path, table.to_parquet(None))
    write_json(out / "meta" / "stats.json", {name: each.total() for name, each in totals.items()})
    write_whole(out / "meta" / "t2twin.json", (folder / INFO).read_bytes())
    content = {
        "codebase_version": VERSION,
        "robot_type": "t2twin",
        "total_episodes": episodes,
        "total_frames": sum(info.pairs.values()),
        "total_tasks": len(tasks),
        "chunks_size": FILES_PER_CHUNK,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": FRAMES_PER_SECOND,
        "splits": splits,
        "data_path": DATA,
        "video_path": None,
        "features": {each.name: each.description() for each in features},
    }
    write_json(out / "meta" / "info.json", content)
    card = render("sim/dataset/lerobot_card.md", info=info, content=content)
    write_whole(out / CARD, card.encode())
    return content


def _present(folder: Path, info: DatasetInfo) -> set[str]:
    """Names of the columns with a value in every row."""
    schema = schema_of(info.values, info.recipe)
    scalars = [field.name for field in schema if not pa.types.is_nested(field.type)]
    present = set(schema.names)
    for _, table in _tables(folder, info, scalars):
        present -= {name for name in scalars if table[name].null_count}
    return present


def _tables(
    folder: Path, info: DatasetInfo, columns: list[str] | None = None
) -> Iterator[tuple[str, pa.Table]]:
    """The split and the table of each shard."""
    for split in SPLITS:
        if info.pairs[split]:
            for table in iter_shards(folder, split, columns):
                yield split, table


def _episodes(
    folder: Path,
    out: Path,
    info: DatasetInfo,
    features: list["Feature"],
    totals: dict[str, "FeatureStatistics"],
    tasks: dict[str, int],
) -> Iterator[tuple[str, Row]]:
    """Write the frames; yields the split and the row of each episode.

    totals, tasks: the statistics and the numbers of the tasks, to which the episodes are added.
    """
    schema = with_features(pa.schema([(each.name, each.arrow_type) for each in features]))
    repeated = [f"{name}.bytes" for name in schema.names if name.endswith(BACKGROUND)]
    frames = episodes = 0
    with Progress(total=sum(info.pairs.values()), unit="pair", desc="convert") as bar:
        for file, (split, table) in enumerate(_tables(folder, info)):
            chunk_index, file_index = divmod(file, FILES_PER_CHUNK)
            path = out / DATA.format(chunk_index=chunk_index, file_index=file_index)
            with row_writer(path, schema, repeated) as write:
                batches = (batch.to_pylist() for batch in table.to_batches(BATCH_ROWS))
                for (shape, _), rows in groupby(chain.from_iterable(batches), _path_of):
                    own = list(rows)
                    task = f"{'press' if len(own) == 1 else 'press and move'} {shape}"
                    number = tasks.setdefault(task, len(tasks))
                    indices = (
                        (n / FRAMES_PER_SECOND, n, episodes, frames + n, number)
                        for n in range(len(own))
                    )
                    names = [each.name for each in INDICES]
                    content = [
                        {each.name: each.value(row) for each in features if each.columns}
                        | dict(zip(names, values, strict=True))
                        for row, values in zip(own, indices, strict=True)
                    ]
                    for frame in content:
                        write(frame)
                    ends = (
                        episodes, len(own), chunk_index, file_index, frames, frames + len(own), 0, 0
                    )  # fmt: skip
                    episode: Row = dict(zip(EPISODE_NUMBERS, ends, strict=True))
                    for name, each in totals.items():
                        found = each.add([frame[name] for frame in content])
                        episode |= {f"stats/{name}/{key}": value for key, value in found.items()}
                    yield split, {"tasks": [task], **episode}
                    episodes, frames = episodes + 1, frames + len(own)
                    bar.update(len(own))


def _path_of(row: Row) -> tuple[str, int]:
    """What the rows of an episode have in common."""
    return row["shape"], row[PATH] if PATH in row else row["index"]


@dataclass(frozen=True)
class Feature:
    """A feature of LeRobot.

    dtype: "image", "float32", "int64" or "bool". shape: (rows, columns, 3) of an image, else
    (components,). names: of the axes of an image or of the components, if they have names. columns:
    the dataset's, either one image or list, or one scalar per component; none for the indices.
    """

    name: str
    dtype: str
    shape: tuple[int, ...]
    names: tuple[str, ...] | None
    columns: tuple[str, ...] = ()

    @property
    def arrow_type(self) -> pa.DataType:
        """The type of its column."""
        if self.dtype == IMAGE:
            return IMAGE_TYPE
        kind = pa.type_for_alias(self.dtype)
        return kind if self.shape == (1,) else pa.list_(kind, *self.shape)

    def value(self, row: dict[str, Any]) -> Any:
        """Its value in a dataset's row: {bytes, path}, (components,) float32, or a scalar."""
        first = row[self.columns[0]]
        if self.dtype == IMAGE:
            return first
        values = first if isinstance(first, list) else [row[name] for name in self.columns]
        return values[0] if self.shape == (1,) else np.array(values, self.dtype)

    def description(self) -> dict[str, Any]:
        """Its entry in meta/info.json."""
        names = None if self.names is None else list(self.names)
        return {"dtype": self.dtype, "shape": list(self.shape), "names": names}


INDICES = (
    Feature("timestamp", "float32", (1,), None),
    *(
        Feature(name, "int64", (1,), None)
        for name in ("frame_index", "episode_index", "index", "task_index")
    ),
)
"""Features that LeRobot requires."""


def features_of(info: DatasetInfo, present: set[str]) -> list[Feature]:
    """The features of a dataset. present: names of the columns with a value in every row.

    The type of a column decides: an image, a list and a flag are a feature each; numbers of a
    sensor are components of its contact, those of the press of the action.
    """
    features: list[Feature] = []
    components: dict[str, list[str]] = {f"observation.{role}_contact": [] for role in ROLES}
    components["action"] = []
    for stored in columns_of(info.values, info.recipe):
        name, role, kind = stored.name, stored.role, stored.column.type
        if name not in present:
            continue
        if kind == IMAGE_TYPE:
            shape = info.sensors[role].image_shape
            assert shape is not None
            feature = role if stored.column.name == IMAGE else name
            axes = ("height", "width", "channels")
            features.append(Feature(f"observation.images.{feature}", IMAGE, shape, axes, (name,)))
        elif stored.column.size is not None:
            size = stored.column.size(info.sensors[role])
            is_counts = stored.column.name == COUNTS
            names = tuple(f"taxel_{n}" for n in range(size)) if is_counts else None
            features.append(Feature(f"observation.{name}", "float32", (size,), names, (name,)))
        elif pa.types.is_floating(kind):
            components[f"observation.{role}_contact" if role else "action"].append(name)
        elif pa.types.is_boolean(kind):
            features.append(Feature(name, "bool", (1,), None, (name,)))
        elif name == "index" or stored.column.name == UNIT:
            own = "press_index" if name == "index" else name
            features.append(Feature(own, "int64", (1,), None, (name,)))
    for feature, own in components.items():
        names = tuple(name.removeprefix("source_").removeprefix("target_") for name in own)
        features.append(Feature(feature, "float32", (len(own),), names, tuple(own)))
    return [each for each in features if each.columns]


def vector_statistics(values: np.ndarray) -> Statistics:
    """Statistics over the frames. values: (frames, components)."""
    values = values.astype(np.float64)
    found = {
        "min": values.min(0),
        "max": values.max(0),
        "mean": values.mean(0),
        "std": values.std(0),
        **dict(zip(QUANTILES, np.quantile(values, list(QUANTILES.values()), axis=0), strict=True)),
    }
    return {name: value.tolist() for name, value in found.items()} | {"count": [len(values)]}


def image_statistics(histogram: np.ndarray, frames: int) -> Statistics:
    """Statistics of all pixels of some images, for gray levels from 0 to 1.

    histogram: (3, LEVELS) pixels of each channel and level. A quantile is the lowest level that so
    large a share of the pixels does not exceed.
    """
    levels = np.arange(LEVELS) / (LEVELS - 1)
    shares = histogram / histogram.sum(1, keepdims=True)
    mean = shares @ levels
    present = histogram > 0
    found = {
        "min": levels[present.argmax(1)],
        "max": levels[LEVELS - 1 - present[:, ::-1].argmax(1)],
        "mean": mean,
        "std": np.sqrt((shares * (levels - mean[:, None]) ** 2).sum(1)),
    }
    below = np.cumsum(histogram, axis=1)
    for name, share in QUANTILES.items():
        found[name] = levels[(below >= share * below[:, -1:]).argmax(1)]
    return {name: value.reshape(3, 1, 1).tolist() for name, value in found.items()} | {
        "count": [frames]
    }


@lru_cache(maxsize=2)  # the rows of an episode repeat their background frame
def histogram_of(png: bytes) -> np.ndarray:
    """(3, LEVELS) int64: pixels of a PNG image by channel and level.

    Raises T2TwinError as decode_png does.
    """
    pixels = decode_png(png).reshape(-1, 3)
    return np.stack([np.bincount(channel, minlength=LEVELS) for channel in pixels.T])


class FeatureStatistics:
    """Collects the statistics of a feature, episode by episode."""

    def __init__(self, feature: Feature) -> None:
        self._is_image = feature.dtype == IMAGE
        self._values: list[np.ndarray] = []  # of the episodes, (frames, components) float32
        self._histogram = np.zeros((3, LEVELS), np.int64)
        self._frames = 0

    def add(self, values: list[Any]) -> Statistics:
        """Add an episode; returns its own statistics. values: one of each frame."""
        if self._is_image:
            histogram = sum(histogram_of(value["bytes"]) for value in values)
            self._histogram += histogram
            self._frames += len(values)
            return image_statistics(np.asarray(histogram), len(values))
        self._values.append(np.array(values, np.float32).reshape(len(values), -1))
        return vector_statistics(self._values[-1])

    def total(self) -> Statistics:
        """The statistics of all frames."""
        if self._is_image:
            return image_statistics(self._histogram, self._frames)
        return vector_statistics(np.concatenate(self._values))

    def types(self) -> dict[str, pa.DataType]:
        """Column types of an episode's statistics."""
        numbers = pa.list_(pa.float32())
        kind = pa.list_(pa.list_(numbers)) if self._is_image else numbers
        return dict.fromkeys(("min", "max", "mean", "std", *QUANTILES), kind) | {
            "count": pa.list_(pa.int64())
        }
