"""Converts a dataset to LeRobot's format v3.0 (https://huggingface.co/docs/lerobot).

An episode is a press, or a press and the further touches of its path. A frame is one pair. Images
stay PNG files, so that no video codec changes them. `features_of` lists the features.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
import pandas as pd
import pyarrow as pa

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.files import new_folder, write_json
from t2twin.core.images import decode_png
from t2twin.core.progress import Progress
from t2twin.core.templates import render
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
from t2twin.sim.dataset.info import SPLITS, CameraInfo, DatasetInfo
from t2twin.sim.dataset.store import (
    CARD,
    INFO,
    iter_shards,
    lists,
    read_info,
    table_writer,
    write_whole,
)
from t2twin.sim.sensors.defaults import ROLES

VERSION = "v3.0"  # LeRobot's version of the format
FRAMES_PER_SECOND = 30  # nominal (assumed): the simulated touches are quasi-static
FILES_PER_CHUNK = 1000  # LeRobot's default number of files of a folder
LEVELS = 256  # gray levels of an image

FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
# Paths of the files of frames, one for each shard, and of episodes
DATA, EPISODES = f"data/{FILE}", f"meta/episodes/{FILE}"
EPISODE_NUMBERS = (  # columns of whole numbers of the file of episodes
    "episode_index", "length", "data/chunk_index", "data/file_index", "dataset_from_index",
    "dataset_to_index", "meta/episodes/chunk_index", "meta/episodes/file_index",
)  # fmt: skip

# Quantiles of LeRobot's statistics, by name
QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}


def convert_to_lerobot(folder: str | Path, out: str | Path) -> dict[str, Any]:
    """Convert a dataset to LeRobot's format; returns the content of meta/info.json.

    folder: of the dataset. out: folder to write, new or empty. Counts and images are exact, other
    values are rounded to float32. The same dataset gives the same bytes.
    Raises T2TwinError for a folder without a complete dataset, a damaged shard, and an output
    folder that is not empty or cannot be written. Then nothing is written.
    """
    folder = arguments.path(folder, "folder")
    info = read_info(folder)
    if not any(info.pairs.values()):
        raise T2TwinError(f"the dataset in {folder} has no pairs; expected at least one")
    with new_folder(arguments.path(out, "out").absolute()) as temporary:
        return _convert(folder, temporary, info)


def _convert(folder: Path, out: Path, info: DatasetInfo) -> dict[str, Any]:
    """Write all files; returns the content of meta/info.json."""
    schema = schema_of(info.values, info.recipe)
    scalars = [field.name for field in schema if not pa.types.is_nested(field.type)]
    present = set(schema.names)
    for _, table in _tables(folder, info, scalars):
        present -= {name for name in scalars if table[name].null_count}
    features = features_of(info, present)

    def parts() -> Iterator[Part]:
        for split, table in _tables(folder, info):
            path_of = table[PATH if PATH in table.column_names else "index"]
            keys = zip(table["shape"].to_pylist(), path_of.to_pylist(), strict=True)
            lengths = ((shape, len([*rows])) for (shape, _), rows in groupby(keys))
            episodes = [(f"press{' and move' * (n > 1)} {shape}", n) for shape, n in lengths]
            yield Part(split, {each.name: each.values(table) for each in features}, episodes)

    content = write_lerobot(out, features, parts(), sum(info.pairs.values()))
    write_whole(out / "meta" / "t2twin.json", (folder / INFO).read_bytes())
    card = render("sim/dataset/lerobot_card.md", info=info, content=content)
    write_whole(out / CARD, card.encode())
    return content


class Part(NamedTuple):
    """The frames of one file."""

    split: str
    columns: dict[str, Any]  # of each feature: encoded images, or (frames, components)
    episodes: list[tuple[str, int]]  # task and number of frames of each


def write_lerobot(
    out: Path, features: Sequence["Feature"], parts: Iterable[Part], total: int,
    rate_hz: float = FRAMES_PER_SECOND,
) -> dict[str, Any]:  # fmt: skip
    """Write frames, `total` in number, at a rate; returns the content of meta/info.json."""
    features = [*features, *INDICES]
    tasks: dict[str, int] = {}
    splits: dict[str, str] = {}
    totals: dict[str, list[np.ndarray]] = {feature.name: [] for feature in features}
    tables, episodes, frames = [], 0, 0
    with Progress(total=total, unit="frame", desc="convert") as bar:
        for file, part in enumerate(parts):
            before = episodes, frames
            rows = _write_frames(out, file, part, features, before, tasks, totals, rate_hz)
            tables.append(pa.Table.from_pylist(rows))
            first = splits.get(part.split, f"{episodes}:").split(":")[0]
            episodes, frames = episodes + len(rows), rows[-1]["dataset_to_index"]
            splits[part.split] = f"{first}:{episodes}"
            bar.update(frames - before[1])
    with table_writer(
        out / EPISODES.format(chunk_index=0, file_index=0), tables[0].schema, []
    ) as write:
        write(pa.concat_tables(tables))
    path = out / "meta" / "tasks.parquet"  # LeRobot reads the tasks as the index of a table
    numbers = pd.DataFrame({"task_index": [*tasks.values()]}, pd.Index([*tasks], name="task"))
    write_whole(path, numbers.to_parquet(None))
    statistics = {
        each.name: statistics_of(each, np.concatenate(totals[each.name]), frames)
        for each in features
    }
    write_json(out / "meta" / "stats.json", statistics)
    content = {
        "codebase_version": VERSION,
        "robot_type": "t2twin",
        "total_episodes": episodes,
        "total_frames": frames,
        "total_tasks": len(tasks),
        "chunks_size": FILES_PER_CHUNK,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": rate_hz,
        "splits": splits,
        "data_path": DATA,
        "video_path": None,
        "features": {
            each.name: {
                "dtype": each.dtype,
                "shape": list(each.shape),
                "names": each.names and list(each.names),
            }
            for each in features
        },
    }
    write_json(out / "meta" / "info.json", content)
    return content


def _tables(
    folder: Path, info: DatasetInfo, columns: list[str] | None = None
) -> Iterator[tuple[str, pa.Table]]:
    """The split and the table of each shard."""
    for split in SPLITS:
        if info.pairs[split]:
            for table in iter_shards(folder, split, columns):
                yield split, table


def _write_frames(
    out: Path, file: int, part: Part, features: list["Feature"], before: tuple[int, int],
    tasks: dict[str, int], totals: dict[str, list[np.ndarray]], rate_hz: float,
) -> list[dict[str, Any]]:  # fmt: skip
    """Write the frames of a file; returns the rows of its episodes.

    before: numbers of the episodes and of the frames in earlier files. tasks, totals: extended.
    """
    place = dict(zip(("chunk_index", "file_index"), divmod(file, FILES_PER_CHUNK), strict=True))
    episodes, indices, start = [], [], before[1]
    for task, length in part.episodes:
        number, episode = tasks.setdefault(task, len(tasks)), before[0] + len(episodes)
        indices += [(n / rate_hz, n, episode, start + n, number) for n in range(length)]
        numbers = episode, length, *place.values(), start, start + length, 0, 0
        episodes.append({"tasks": [task], **dict(zip(EPISODE_NUMBERS, numbers, strict=True))})
        start += length
    columns = dict(part.columns)
    for each, values in zip(INDICES, zip(*indices, strict=True), strict=True):
        columns[each.name] = np.array(values, each.dtype)[:, None]
    for each in features:
        for episode in episodes:
            ends = (episode[f"dataset_{end}_index"] - before[1] for end in ("from", "to"))
            samples = columns[each.name][slice(*ends)]
            if each.dtype == IMAGE:  # the number of pixels of each gray level and channel
                counts = (histogram_of(image["bytes"].as_py()) for image in samples)
                samples = sum(counts, start=np.zeros((1, 1)))
                totals[each.name] = [np.sum([*totals[each.name], samples], axis=0)]
            else:
                samples = samples.astype(np.float32)
                totals[each.name].append(samples)
            found = statistics_of(each, samples, episode["length"])
            episode |= {f"stats/{each.name}/{key}": value for key, value in found.items()}
    schema = with_features(pa.schema([(each.name, each.arrow_type) for each in features]))
    repeated = [f"{name}.bytes" for name in schema.names if name.endswith(BACKGROUND)]
    with table_writer(out / DATA.format(**place), schema, repeated) as write:
        stored = [each.stored(columns[each.name]) for each in features]
        write(pa.Table.from_arrays(stored, schema=schema))
    return episodes


@dataclass(frozen=True)
class Feature:
    """A feature of LeRobot."""

    name: str
    dtype: str  # "image", "float32", "int64" or "bool"
    shape: tuple[int, ...]  # (rows, columns, 3) of an image, else (components,)
    names: tuple[str, ...] | None  # of the axes of an image or of the components, if any
    # the dataset's, one image or list, or one scalar per component; none for the indices
    columns: tuple[str, ...] = ()

    @property
    def arrow_type(self) -> pa.DataType:
        """The type of its column."""
        if self.dtype == IMAGE:
            return IMAGE_TYPE
        kind = pa.type_for_alias(self.dtype)
        return kind if self.shape == (1,) else pa.list_(kind, *self.shape)

    def values(self, table: pa.Table) -> Any:
        """Its values in a dataset's table: a column of images, or (rows, components)."""
        first = table[self.columns[0]]
        if self.dtype == IMAGE:
            return first
        if pa.types.is_list(first.type):
            return lists(table, self.columns[0]).astype(self.dtype)
        return np.stack([table[name] for name in self.columns], axis=1).astype(self.dtype)

    def stored(self, values: Any) -> Any:
        """Values as the column that is written."""
        if self.dtype == IMAGE:
            return values
        flat = pa.array(values.ravel())
        return flat if self.shape == (1,) else pa.FixedSizeListArray.from_arrays(flat, *self.shape)


INDICES = (  # features that LeRobot requires
    Feature("timestamp", "float32", (1,), None),
    *(
        Feature(name, "int64", (1,), None)
        for name in ("frame_index", "episode_index", "index", "task_index")
    ),
)


def features_of(info: DatasetInfo, present: set[str]) -> list[Feature]:
    """The features of a dataset. present: names of the columns with a value in every row.

    The type of a column decides. An image is observation.images.ROLE, a background frame
    observation.images.ROLE_background; a list, such as the counts, is observation.ROLE_counts; a
    flag and an index keep their names. Numbers of a sensor, such as depth and force, are components
    of observation.ROLE_contact; those of the press belong to action.
    """
    features: list[Feature] = []
    components: dict[str, list[str]] = {f"observation.{role}_contact": [] for role in ROLES}
    components["action"] = []
    for stored in columns_of(info.values, info.recipe):
        name, role, kind = stored.full_name, stored.role, stored.type
        if name not in present:
            continue
        if kind == IMAGE_TYPE:
            shape = cast(CameraInfo, info.sensors[role]).image_shape
            feature = role if stored.name == IMAGE else name
            axes = ("height", "width", "channels")
            features.append(Feature(f"observation.images.{feature}", IMAGE, shape, axes, (name,)))
        elif stored.size is not None:
            size = stored.size(info.sensors[role])
            is_counts = stored.name == COUNTS
            names = tuple(f"taxel_{n}" for n in range(size)) if is_counts else None
            features.append(Feature(f"observation.{name}", "float32", (size,), names, (name,)))
        elif pa.types.is_floating(kind):
            components[f"observation.{role}_contact" if role else "action"].append(name)
        elif pa.types.is_boolean(kind):
            features.append(Feature(name, "bool", (1,), None, (name,)))
        elif name == "index" or stored.name == UNIT:
            own = "press_index" if name == "index" else name
            features.append(Feature(own, "int64", (1,), None, (name,)))
    for feature, own in components.items():
        names = tuple(name.removeprefix("source_").removeprefix("target_") for name in own)
        features.append(Feature(feature, "float32", (len(own),), names, tuple(own)))
    return [each for each in features if each.columns]


@lru_cache(maxsize=2)  # the rows of an episode repeat their background frame
def histogram_of(png: bytes) -> np.ndarray:
    """(LEVELS, 3): pixels of a PNG image by level and channel. Raises as decode_png does."""
    pixels = decode_png(png).reshape(-1, 3)
    return np.stack([np.bincount(channel, minlength=LEVELS) for channel in pixels.T], axis=1)


def statistics_of(feature: Feature, samples: np.ndarray, frames: int) -> dict[str, Any]:
    """LeRobot's statistics of samples as nested lists; of images over all pixels, 0 to 1, whose
    quantiles are the lowest levels that such a share of the pixels does not exceed."""
    shares = list(QUANTILES.values())
    if feature.dtype == IMAGE:
        values = np.repeat(np.arange(LEVELS)[:, None] / (LEVELS - 1), 3, axis=1)
        weights, shape = samples, (3, 1, 1)
        quantiles = np.quantile(values, shares, 0, weights=weights, method="inverted_cdf")
    else:
        values, weights, shape = samples.astype(np.float64), np.ones_like(samples), (-1,)
        quantiles = np.quantile(values, shares, 0)
    mean = np.average(values, 0, weights)
    found = {
        "min": values.min(0, initial=np.inf, where=weights > 0),
        "max": values.max(0, initial=-np.inf, where=weights > 0),
        "mean": mean,
        "std": np.sqrt(np.average((values - mean) ** 2, 0, weights)),
        **dict(zip(QUANTILES, quantiles, strict=True)),
    }
    return {name: each.reshape(shape).tolist() for name, each in found.items()} | {
        "count": [frames]
    }
