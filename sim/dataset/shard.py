"""Making one shard: all presses of one shape."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.errors import T2TwinError
from t2twin.primitives_cad.shape import Shape
from t2twin.sim.dataset import protocol
from t2twin.sim.dataset.png import encode_png
from t2twin.sim.dataset.store import row, shard_path, write_shard
from t2twin.sim.dataset.timing import Stopwatch, peak_memory, process_name
from t2twin.sim.sensors import SensorPair


@dataclass(frozen=True)
class Task:
    """One shard: a shape, the presses to make of it, and where it goes."""

    shape: str
    split: str
    indices: tuple[int, ...]
    seed: int
    folder: str
    cache: str | None

    @property
    def path(self) -> str:
        return shard_path(self.split, self.shape)


@dataclass(frozen=True)
class Made:
    """A shard that was made: its sha256, the time it took, and by which process.

    peak_memory: the most that the process has held up to now, bytes.
    """

    sha256: str
    watch: Stopwatch
    process: str
    peak_memory: int


def make_shard(task: Task, sensors: SensorPair, progress: Callable[[], object]) -> Made:
    """Press, look, feel and write. Calls progress after each pair.

    Raises T2TwinError where a press did not settle or the shard cannot be written.
    """
    watch = Stopwatch()
    with watch.running("shape"):
        shape = catalogue.load(task.shape, task.cache)
    before, start = watch.total, time.process_time()
    digest = write_shard(
        Path(task.folder) / task.path, _rows(task, shape, sensors, watch, progress)
    )
    # Rows are made while the shard is being written; what is left of its time is the writing.
    watch.seconds["writing"] += time.process_time() - start - (watch.total - before)
    return Made(digest, watch, process_name(), peak_memory())


def family_of(shape: str) -> str:
    """The tool of `pliers/teeth`, the primitive family of `square-2`."""
    return shape.split("/")[0] if "/" in shape else shape.rpartition("-")[0]


def _rows(
    task: Task, shape: Shape, sensors: SensorPair, watch: Stopwatch, progress: Callable[[], object]
) -> Iterator[dict[str, Any]]:
    family = family_of(task.shape)
    place = catalogue.NAMES.index(task.shape)
    for index in task.indices:
        rng = np.random.default_rng((task.seed, place, index))
        sample = sensors.press(shape, protocol.press_at(shape, index), rng, watch.running)
        if not (sample.digit.settled and sample.cyskin.settled):
            raise T2TwinError(
                f"press {index} of {task.shape} did not settle; take a finer or coarser grid"
            )
        with watch.running("encoding"):
            picture = encode_png(sample.image)
        yield row(sample, picture, index, family, task.split)
        progress()
