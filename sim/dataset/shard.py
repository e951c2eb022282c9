"""Makes one shard of a dataset, row by row."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.core.images import encode_png
from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.shape import Shape
from t2twin.sim.cyskin.field import field_counts, field_layout
from t2twin.sim.dataset.columns import ExtraColumns, row, schema_of
from t2twin.sim.dataset.rejection_sampling import sample_until_contact
from t2twin.sim.dataset.store import write_shard
from t2twin.sim.dataset.timing import Stopwatch, peak_memory, process_name
from t2twin.sim.digit.calibration import Calibration
from t2twin.sim.digit.randomization.unit import sample_unit
from t2twin.sim.sensors import Sample, SensorPair
from t2twin.sim.world.plan import Batch
from t2twin.sim.world.presses import (
    FRAME_STREAM,
    MAX_ATTEMPTS,
    UNIT_STREAM,
    PressSample,
    grid_presses,
)
from t2twin.sim.world.recipe import Part, Recipe


@dataclass(frozen=True)
class ShardContext:
    """What all shards of a dataset are made with. cache: as for catalogue.load."""

    recipe: Recipe
    sensors: SensorPair
    folder: str
    cache: str | None


@dataclass(frozen=True)
class ShardResult:
    """A shard that was made: its sha256, the time it took, and by which process.

    peak_memory: the most that the process has held up to now, bytes. redrawn: how many presses were
    drawn again, as nothing touched, the base plate did, or they did not settle.
    """

    sha256: str
    watch: Stopwatch
    process: str
    peak_memory: int
    redrawn: dict[str, int] = field(default_factory=dict)


def make_shard(batch: Batch, making: ShardContext, progress: Callable[[], object]) -> ShardResult:
    """Press, look, feel and write. Calls progress after each pair.

    Raises T2TwinError where a press of the grid did not settle, one that is drawn cannot be drawn
    so that it touches, or the shard cannot be written.
    """
    shard = _Shard(batch, making, progress)
    start = time.process_time()
    digest = write_shard(Path(making.folder) / batch.path, shard.rows(), schema_of(making.recipe))
    # Rows are made while the shard is being written; what is left of its time is the writing.
    watch = shard.watch
    watch.seconds["writing"] += time.process_time() - start - watch.total
    return ShardResult(digest, watch, process_name(), peak_memory(), shard.redrawn)


def family_of(shape: str) -> str:
    """The tool of `pliers/teeth`, the primitive family of `square-2`, `random` of `random-17`."""
    return shape.split("/")[0] if "/" in shape else shape.rpartition("-")[0] or shape


class _Shard:
    """One shard in the making."""

    def __init__(self, batch: Batch, making: ShardContext, progress: Callable[[], object]) -> None:
        self.batch, self.recipe, self.progress = batch, making.recipe, progress
        self.sensors, self.cache = making.sensors, making.cache
        self.part: Part = making.recipe.parts[batch.part]
        self.watch = Stopwatch()
        self.redrawn: dict[str, int] = {}
        light = making.recipe.light
        self._center = (
            Calibration.load(light.calibration)
            if light.kind == "drawn" and light.calibration is not None
            else None
        )
        self._lit: tuple[int, SensorPair] | None = None
        self._untouched: tuple[int, bytes] | None = None
        self._refused: dict[int, int] = {}
        """Attempts that a shape's presses need not make again, as none touched."""

    def rows(self) -> Iterator[dict[str, Any]]:
        batch = self.batch
        for source, number in zip(batch.shapes, batch.numbers, strict=True):
            with self.watch.running("shape"):
                shape = catalogue.load(source, self.cache)
            if batch.indices is not None:
                presses = grid_presses(self.part, source, batch.indices, self.recipe.seed)
                for drawn in presses:
                    yield self._row(shape, drawn, number, self._grid_sample(shape, drawn, number))
                    self.progress()
            else:
                for press in range(batch.presses):
                    yield self._drawn_row(shape, number, press)
                    self.progress()

    def _grid_sample(self, shape: Shape, drawn: PressSample, number: int) -> Sample:
        sample = self._press(shape, drawn, number)
        if not (sample.digit.settled and sample.cyskin.settled):
            raise T2TwinError(
                f"press {drawn.index} of {shape.name} did not settle; take a finer or coarser grid"
            )
        return sample

    def _drawn_row(self, shape: Shape, number: int, press: int) -> dict[str, Any]:
        """A press that is drawn, and again as long as it touches nothing that was meant."""
        touch = sample_until_contact(
            self.part,
            shape,
            number,
            press,
            (self.recipe.seed, self.batch.part),
            partial(self._press, number=number),
            self._again,
            self._refused.get(number, 0),
        )
        self._refused[number] = touch.attempt - touch.attempt % MAX_ATTEMPTS
        return self._row(touch.shape, touch.drawn, number, touch.sample)

    def _again(self, why: str) -> None:
        self.redrawn[why] = self.redrawn.get(why, 0) + 1

    def _press(self, shape: Shape, drawn: PressSample, number: int) -> Sample:
        sensors = self._sensors(drawn, number)
        return sensors.press(shape, drawn.command, drawn.rng, self.watch.running)

    def _sensors(self, drawn: PressSample, number: int) -> SensorPair:
        """Those of a press: another DIGIT for each shape or press, where light is drawn."""
        light = self.recipe.light
        if light.kind == "fixed":
            return self.sensors
        number_of_unit = self._unit(drawn, number)
        if self._lit is None or self._lit[0] != number_of_unit:
            seed = (self.recipe.seed, UNIT_STREAM, self.batch.part, number_of_unit)
            with self.watch.running("light"):
                unit = sample_unit(np.random.default_rng(seed), light.draw, self._center)
                digit = self.sensors.digit.with_unit(unit)
            self._lit = (number_of_unit, replace(self.sensors, digit=digit))
        return self._lit[1]

    def _unit(self, drawn: PressSample, number: int) -> int:
        """Which of the part's DIGITs takes a press."""
        light = self.recipe.light
        if light.kind == "fixed":
            return 0
        return number if light.each == "shape" else number * self.batch.presses + drawn.index

    def _row(
        self, shape: Shape, drawn: PressSample, number: int, sample: Sample | None
    ) -> dict[str, Any]:
        family, split = family_of(shape.name), self.batch.split
        sensors = self._sensors(drawn, number)
        if sample is None:
            with self.watch.running("picture"):
                image = sensors.digit.untouched(drawn.rng)
            counts = sensors.cyskin.untouched(drawn.rng)
        else:
            image, counts = sample.image, sample.counts
        with self.watch.running("encoding"):
            picture = encode_png(image)
        more = self._more(sensors, drawn, number, sample)
        return row(drawn.command, sample, counts, picture, drawn.index, family, split, more)

    def _more(
        self, sensors: SensorPair, drawn: PressSample, number: int, sample: Sample | None
    ) -> ExtraColumns | None:
        """What a pair of most worlds holds besides."""
        recipe = self.recipe
        if not recipe.has_more:
            return None
        unit, counts = self._unit(drawn, number), None
        if recipe.field:
            with self.watch.running("field"):
                counts = (
                    np.zeros(field_layout(sensors.cyskin.cover).size, np.uint16)
                    if sample is None
                    else field_counts(sample.cyskin)
                )
        untouched = self._untouched_frame(sensors, unit) if recipe.untouched_frames else None
        return ExtraColumns(unit, counts, untouched)

    def _untouched_frame(self, sensors: SensorPair, unit: int) -> bytes:
        """The picture of a DIGIT untouched, one for all its presses, as PNG bytes."""
        if self._untouched is None or self._untouched[0] != unit:
            seed = (self.recipe.seed, FRAME_STREAM, self.batch.part, unit)
            with self.watch.running("encoding"):
                frame = encode_png(sensors.digit.untouched(np.random.default_rng(seed)))
            self._untouched = (unit, frame)
        return self._untouched[1]
