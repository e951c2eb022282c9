"""Makes a shard. A sampled press is repeated until it touches the shape and settles."""

import os
import pickle
import platform
import resource
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from t2twin.core.arguments import MAX_SEED
from t2twin.core.errors import T2TwinError
from t2twin.core.images import encode_png
from t2twin.core.machine import trim_memory
from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.shape import Shape
from t2twin.sim.contact.elastomer import Friction
from t2twin.sim.contact.pin_layout import OffPadError
from t2twin.sim.contact.types import PressCommand
from t2twin.sim.dataset.columns import BACKGROUND, MARKERS, UNIT, Sample, columns_of, schema_of
from t2twin.sim.dataset.info import Shard, versions
from t2twin.sim.dataset.store import write_shard
from t2twin.sim.optical.markers import Markers
from t2twin.sim.optical.units import log_uniform
from t2twin.sim.sampling.plan import (
    FRAME_STREAM,
    MAX_ATTEMPTS,
    UNIT_STREAM,
    Attempt,
    Batch,
    load_shape,
    name_of,
    path_attempts,
    sample_friction,
)
from t2twin.sim.sampling.recipe import Recipe
from t2twin.sim.sensors.defaults import ROLES
from t2twin.sim.sensors.pair import SensorPair
from t2twin.sim.slide import slide_to
from t2twin.sim.touch import Touch

# Random streams of a seed, of the units: markers, artifacts, and which are the fixed one.
MARKER_STREAM, ARTIFACT_STREAM, FIXED_STREAM = 18, 21, 22

MARKER_PITCHES_MM = (1.0, 2.5)  # range of the markers' pitches (assumed)
MARKER_SHARES = (0.25, 0.45)  # range of the markers' diameters over their pitch (assumed)
MAX_JITTER_SHARE = 0.3  # largest jitter over the free distance (assumed)

Make = Callable[[Batch], tuple[Shard, "Tally"]]  # make_shard for one dataset


class Tally:
    """What is counted of a shard, or of many: processor time, rejected attempts, notes, memory."""

    def __init__(self) -> None:
        self.seconds = 0.0  # processor time
        self.rejected: Counter[str] = Counter()  # attempts by reason
        self.notes: Counter[str] = Counter()  # pairs by the notes of their touch
        self.peaks: dict[str, int] = {}  # peak memory of the processes by name, bytes

    def add(self, other: "Tally") -> None:
        """Add the counts of a later shard."""
        self.seconds += other.seconds
        self.rejected.update(other.rejected)
        self.notes.update(other.notes)
        self.peaks |= other.peaks

    def add_peak_memory(self) -> None:
        """Add the peak memory of this process."""
        unit = 1 if sys.platform == "darwin" else 1024  # of getrusage, bytes
        self.peaks[process_name()] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def process_name() -> str:
    """A name of this process that is unique in a cluster."""
    return f"{platform.node()}:{os.getpid()}"


@lru_cache(maxsize=1)
def _read_make(file: str) -> "Make":
    """What makes the shards of a run. Raises T2TwinError without it, and where versions differ."""
    try:
        (make, needed), installed = pickle.loads(Path(file).read_bytes()), versions()
    except OSError as error:
        raise T2TwinError(
            f"the worker {process_name()} cannot read {file}; use a folder that all workers share"
        ) from error
    for name, version in needed.items():
        if installed[name] != version:
            raise T2TwinError(
                f"the worker {process_name()} has {name} {installed[name]} and the dataset "
                f"{version}; all must have the same"
            )
    return make


def make_shard_in_worker(file: str, batch: Batch) -> tuple[Shard, Tally]:
    """As make_shard, in another process. file: of a pickled Make and the versions that it needs."""
    return _read_make(file)(batch)


def make_shard(
    recipe: Recipe, sensors: SensorPair, folder: Path, cache: Path | None, batch: Batch
) -> tuple[Shard, Tally]:
    """Press, render, encode and write the pairs of a shard. cache: as for catalogue.load.

    Raises T2TwinError as press_until_accepted does, and where the file cannot be written.
    """
    tally, start = Tally(), time.process_time()
    values: dict[str, str] = {role: getattr(sensors, role).VALUE for role in ROLES}
    columns = [(each.full_name, each.value, each.role) for each in columns_of(values, recipe)]

    def rows() -> Iterator[dict[str, Any]]:
        for sample in _samples(recipe, sensors, cache, batch, tally):
            tally.notes.update(sample.touch.notes)
            yield {name: value(sample, role) for name, value, role in columns}

    digest = write_shard(folder / batch.path, rows(), schema_of(values, recipe))
    trim_memory()
    tally.seconds = time.process_time() - start
    tally.add_peak_memory()
    return Shard(digest, batch.pairs), tally


def _samples(
    recipe: Recipe, own: SensorPair, cache: Path | None, batch: Batch, tally: Tally
) -> Iterator[Sample]:
    """The touches of a shard, shape by shape, path by path."""
    ranges = {name: sensor.FRICTION for name, sensor in own.by_name.items()}
    present, sensors, units, part = None, own, {}, batch.part
    for source, number in zip(batch.shapes, batch.numbers, strict=True):
        shape = load_shape(recipe.parts[part], source, cache)
        first, friction = 0, {}
        if recipe.motion:
            friction = sample_friction(recipe.motion, ranges, (recipe.seed, part), number)
        for path in batch.paths(recipe, number):
            unit = number if recipe.light.each == "shape" else number * batch.presses + path.index
            unit = 0 if recipe.light.kind == "fixed" else unit
            if unit != present:
                present, (sensors, units) = unit, _unit(part, unit, recipe, own)
            attempts = path_attempts(recipe, part, name_of(source), number, path, first)
            laws = {name: Friction(value) for name, value in friction.items()}
            press = partial(_touches, sensors, laws)
            touches, accepted = press_until_accepted(attempts, shape, press, tally.rejected)
            first = accepted - accepted % MAX_ATTEMPTS  # no earlier stand-in can be touched
            for index, touch in enumerate(touches, start=path.index):
                yield Sample(touch, index, batch.split, path.index, friction, units)


def press_until_accepted(
    attempts: Iterable[Attempt], shape: Shape, press: Callable[..., list[Touch]],
    rejected: Counter[str],
) -> tuple[list[Touch], int]:  # fmt: skip
    """The touches of the first accepted attempt at a path, and its number; counts rejected ones.

    press: makes a press and the touches of its path; the last one is rejected, or none.
    A press on the grid may bottom out. Raises T2TwinError where no attempt is accepted.
    """
    planned = shape.name
    for commands, rng, attempt in attempts:
        if commands[0].shape != shape.name:
            shape = catalogue.load(commands[0].shape)
        if attempt is None:
            touches = press(shape, commands, rng)
            if not all(contact.settled for contact in touches[0].contacts.values()):
                x_mm, y_mm = commands[0].x_mm, commands[0].y_mm
                raise T2TwinError(
                    f"the press of {planned} at x {x_mm:.2f} mm, y {y_mm:.2f} mm did not settle; "
                    "use another grid"
                )
            return touches, 0
        try:
            touches = press(shape, commands, rng)
        except OffPadError:
            reason = "off the pad"
        else:
            reason = rejection_reason(touches[-1])
            if reason is None:
                return touches, attempt
        rejected[reason] += 1
    raise T2TwinError(
        f"no attempt at a press touched {planned}; use places nearer to the middle of the shapes, "
        "or center = true in a part of files"
    )


def rejection_reason(touch: Touch) -> str | None:
    """Why a sampled press is rejected, None for an accepted one, such as a press of 0 N."""
    contacts = touch.contacts.values()
    if any(contact.bottomed for contact in contacts):
        return "on the base plate"
    if all(contact.settled for contact in contacts):
        return None
    smaller = any(contact.smaller_than_grid for contact in contacts)
    return "smaller than the grid" if smaller else "not settled"


def _touches(
    sensors: SensorPair, friction: dict[str, Friction], shape: Shape,
    commands: Sequence[PressCommand], rng: np.random.Generator,
) -> list[Touch]:  # fmt: skip
    """The touches of a path, up to the first rejected one. Raises OffPadError off a pad."""
    touch = sensors.press(shape, commands[0], rng)
    touches = [touch]
    for command in commands[1:]:
        sensors.check_over_pads(touch, command)
    for command in commands[1:]:
        if rejection_reason(touch):
            return touches
        touch = slide_to(sensors, touch, command, friction)
        touches.append(touch)
    read = touches[:1]
    for each in touches[1:]:
        read.append(sensors.with_readings(each, rng, before=read[-1]))
    return read


def _markers(rng: np.random.Generator, share: float) -> Markers | None:
    """Sampled markers of a unit. share: of the units that have markers."""
    if rng.random() >= share:
        return None
    pitch_mm = float(log_uniform(rng, MARKER_PITCHES_MM))
    diameter_mm = pitch_mm * rng.uniform(*MARKER_SHARES)
    jitter_mm = rng.uniform(0.0, MAX_JITTER_SHARE * (pitch_mm - diameter_mm) / 2)
    return Markers(pitch_mm, float(diameter_mm), float(jitter_mm), int(rng.integers(MAX_SEED)))


def _unit(
    part: int, number: int, recipe: Recipe, sensors: SensorPair
) -> tuple[SensorPair, dict[str, dict[str, Any]]]:
    """The sensors of a part's unit, with sampled light and markers, and its columns by role."""
    own: dict[str, Any] = {}
    columns: dict[str, dict[str, Any]] = {}
    for place, role in enumerate(ROLES):
        sensor = getattr(sensors, role)
        if not sensor.HAS_UNITS:
            continue
        rngs = {
            stream: np.random.default_rng(
                (recipe.seed, stream, part, number, *[place] * bool(place))
            )
            for stream in (UNIT_STREAM, ARTIFACT_STREAM, MARKER_STREAM, FRAME_STREAM)
        }
        columns[role] = {UNIT: number}
        is_fixed, share = recipe.light.kind == "fixed", recipe.light.fixed_share
        if share:
            rng = np.random.default_rng((recipe.seed, FIXED_STREAM, part, number))
            is_fixed = rng.random() < share
        if not is_fixed:
            light, artifacts = rngs[UNIT_STREAM], rngs[ARTIFACT_STREAM]
            draw = recipe.light.draw, recipe.light.artifacts or None
            sensor = sensor.sampled(light, artifacts, *draw)
        if recipe.motion:
            markers = _markers(rngs[MARKER_STREAM], recipe.motion.markers)
            sensor = replace(sensor, markers=markers)
            columns[role][MARKERS] = sensor.markers is not None
        if recipe.background_frames:
            png = encode_png(sensor.background_frame(rngs[FRAME_STREAM]))
            columns[role][BACKGROUND] = {"bytes": png, "path": f"background-{number}-{role}.png"}
        own[role] = sensor
    return replace(sensors, **own), columns
