"""Plans the presses of a recipe, divided into shards. All follow from the seed.

A press on the protocol's grid is fixed by its index. Any other press is sampled: its attempt 0 may
miss the shape's features, then the next attempt is another sample of the same press.
In a recipe with motion, sampled presses start paths, on which the shape slides or twists. Each
further touch of a path continues the one before, at equal steps.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from msgspec import UNSET

from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.catalogue import PRIMITIVES
from t2twin.primitives_cad.shape import RANDOM_PREFIX, SUFFIXES, Shape
from t2twin.sim.contact.types import FORCE_RANGE_N, PressCommand
from t2twin.sim.optical.units import log_uniform
from t2twin.sim.sampling import protocol
from t2twin.sim.sampling.recipe import NAMED, RANDOM, ForceRange, Motion, Part, Place, Recipe, Split

# Random streams of one seed: presses, forces on a grid, units, noise of their background frames,
# kinds of the paths, their motions, friction of the shapes.
PRESS_STREAM, FORCE_STREAM, UNIT_STREAM, FRAME_STREAM = 11, 12, 13, 14
PATH_STREAM, MOTION_STREAM, FRICTION_STREAM = 15, 16, 17

SEEDS_PER_RECIPE = 1_000_000_000  # numbers of a recipe's random shapes start at its seed times this
MAX_SHAPE_SEED = 9_000_000_000  # their numbers stay below the largest of all shapes
PRESSES_PER_SHARD = 500  # approximately: some 40 MB, made in half a minute
MAX_ATTEMPTS = 20  # samples of a press until it touches the shape's features and settles

STAND_INS = 8
"""Random shapes that replace one that cannot be touched: one in ten thousand is a sliver that some
newtons push in to its base plate."""

FIRST_STAND_IN, STAND_IN_STEP = 500_000_000, 50_000_000  # offset of its number, step to the next


@dataclass(frozen=True)
class MotionPath:
    """A path of a shape: the touch `index` of the shape and the next `steps`, 0 if it is still."""

    index: int
    kind: Literal["still", "slide", "twist"] = "still"
    steps: int = 0


Attempt = tuple[tuple[PressCommand, ...], np.random.Generator, int | None]
"""Commands of a press and of the touches of its path, random numbers of the sensors' noise, and the
number of the attempt. A press of 0 N has no contact. The number is None for a press on the grid."""


@dataclass(frozen=True)
class Batch:
    """The presses of one shard."""

    path: str  # below the dataset's folder
    split: Split
    part: int
    shapes: tuple[str, ...]  # their names or files
    numbers: tuple[int, ...]  # of the shapes in the part
    indices: tuple[int, ...] | None  # of the presses on the grid, None elsewhere
    presses: int  # of a shape

    @property
    def pairs(self) -> int:
        return self.presses * len(self.shapes)

    def paths(self, recipe: Recipe, number: int) -> tuple[MotionPath, ...]:
        """The paths of a shape of the shard. number: of the shape in the part."""
        if self.indices is not None:
            return tuple(map(MotionPath, self.indices))
        if not recipe.motion:
            return tuple(map(MotionPath, range(self.presses)))
        return sample_paths(recipe.motion, self.presses, (recipe.seed, self.part), number)


def file_stem(shape: str) -> str:
    return shape.replace("/", "-")


def shard_path(split: str, shape: str) -> str:
    """Path of a shard of one shape below the dataset's folder."""
    return f"{split}/{file_stem(shape)}.parquet"


def name_of(source: str) -> str:
    """Name of a shape in the dataset: a file's stem, or the name."""
    return Path(source).stem if Path(source).suffix.lower() in SUFFIXES else source


def plan(recipe: Recipe, names: tuple[str, ...] = catalogue.NAMES) -> list[Batch]:
    """All shards of a recipe. names: restricts the primitives and tools, and orders the grids.

    Raises T2TwinError for a folder without solids, files of one name, and too small a val_share.
    """
    batches = [
        batch
        for number, part in enumerate(recipe.parts)
        for batch in _part_batches(recipe, number, part, names)
    ]
    known: dict[str, str] = {}
    for source in (source for batch in batches for source in batch.shapes):
        name = name_of(source)
        other = known.setdefault(name, source)
        if Path(other) != Path(source):
            raise T2TwinError(f"{other} and {source} would both be the shape {name!r}; rename one")
    # those on the grid first, in the order of the names
    last = len(names)
    return sorted(batches, key=lambda b: last if b.indices is None else names.index(b.shapes[0]))


def solids_in(folder: str) -> tuple[str, ...]:
    """The files of solids in a recipe's folder, sorted. Raises T2TwinError without any."""
    files = Path(folder).glob("*")
    found = sorted(str(path) for path in files if path.suffix.lower() in SUFFIXES)
    if not found:
        allowed = f"{', '.join(NAMED)}, or a folder with {', '.join(SUFFIXES)} files"
        raise T2TwinError(f"{folder} contains no solids; shapes must be {allowed}")
    return tuple(found)


def load_shape(part: Part, source: str, cache_dir: str | Path | None = None) -> Shape:
    """A shape of a part by its name or file. cache_dir and errors: as for catalogue.load."""
    if part.shapes in NAMED:
        return catalogue.load(source, cache_dir)
    return catalogue.load(source, cache_dir, part.solid_scale, bool(part.center))


def _part_batches(
    recipe: Recipe, number: int, part: Part, names: tuple[str, ...]
) -> Iterator[Batch]:
    shapes = _shapes(recipe, number, names)
    if part.place == "grid":
        for place, name in enumerate(shapes):
            # all forces of a list at each grid press
            grid = protocol.indices(name, protocol.SCALES[str(part.scale)])
            forces = len(part.force_n) if isinstance(part.force_n, tuple) else 1
            own = tuple(index * forces + which for index in grid for which in range(forces))
            split = _split(part, name, place, len(shapes))
            path = shard_path(split, name)
            yield Batch(path, split, number, (name,), (place,), own, len(own))
        return
    assert part.presses is not None
    shapes_per_shard = max(1, round(PRESSES_PER_SHARD / part.presses))
    by_split: dict[Split, list[int]] = {}
    for place, name in enumerate(shapes):
        by_split.setdefault(_split(part, name, place, len(shapes)), []).append(place)
    if part.val_share and "val" not in by_split:
        raise T2TwinError(
            f"val_share of the part of {part.shapes} shapes is {part.val_share:g}, which is less "
            "than half a shape; expected a larger share, or more shapes"
        )
    for split, places in by_split.items():
        for nth, start in enumerate(range(0, len(places), shapes_per_shard)):
            mine = tuple(places[start : start + shapes_per_shard])
            path, own = f"{split}/part-{number}-{nth:05d}.parquet", (shapes[n] for n in mine)
            yield Batch(path, split, number, tuple(own), mine, None, part.presses)


def _shapes(recipe: Recipe, number: int, names: tuple[str, ...]) -> tuple[str, ...]:
    """Names or files of the shapes of a part, by its number."""
    part = recipe.parts[number]
    if part.shapes == RANDOM:
        assert part.count is not None
        if recipe.seed > MAX_SHAPE_SEED:
            raise T2TwinError(f"seed is {recipe.seed}; it must be at most {MAX_SHAPE_SEED}")
        # No two parts share a shape, since their splits may differ.
        before = sum(earlier.count or 0 for earlier in recipe.parts[:number])
        first = recipe.seed * SEEDS_PER_RECIPE + before
        return tuple(f"{RANDOM_PREFIX}{first + place}" for place in range(part.count))
    if part.shapes in ("primitives", "tools"):
        of = PRIMITIVES if part.shapes == "primitives" else catalogue.OBJECTS
        return tuple(name for name in of if name in names)
    return solids_in(part.shapes)


def _split(part: Part, name: str, place: int, shapes: int) -> Split:
    if part.split == "by-version":
        return catalogue.split(name)  # pyright: ignore[reportReturnType]
    is_last = place >= shapes - round(part.val_share * shapes)
    return "val" if is_last else part.split


def max_attempts(part: Part) -> int:
    """The largest number of attempts at a sampled press: those of its shape and all stand-ins."""
    return MAX_ATTEMPTS * (1 + STAND_INS) if part.shapes == RANDOM else MAX_ATTEMPTS


def path_attempts(
    recipe: Recipe, part: int, name: str, number: int, path: MotionPath, first: int = 0
) -> Iterator[Attempt]:
    """The attempts at a press and its path; one on the grid, else max_attempts of the part.

    number: of the shape in the part.
    """
    own = recipe.parts[part]
    if own.place == "grid":
        place, forces = catalogue.NAMES.index(name), own.force_n
        listed = forces if isinstance(forces, tuple) else (forces,)
        at, which = divmod(path.index, len(listed))
        rng = np.random.default_rng((recipe.seed, FORCE_STREAM, place, path.index))
        force_n = sample_force(rng, listed[which])
        command = protocol.press_of(name, catalogue.properties(name)["spacing_mm"], at)
        rng = np.random.default_rng((recipe.seed, place, path.index))
        yield (replace(command, force_n=force_n),), rng, None
        return
    for attempt in range(first, max_attempts(own)):
        yield sample_press(recipe, part, name, number, path, attempt)


def sample_press(
    recipe: Recipe, part: int, name: str, number: int, path: MotionPath, attempt: int
) -> Attempt:
    """One attempt at a press that is not on the grid, and at its path, which has contact.

    Later attempts are at stand-ins of the shape.
    """
    own, seed = recipe.parts[part], (recipe.seed, part)
    rng = np.random.default_rng((*seed, PRESS_STREAM, number, path.index, attempt))
    place, which = own.place, attempt // MAX_ATTEMPTS
    assert isinstance(place, Place)
    if place.normal_mm is not None:
        x, y = place.normal_mm * rng.standard_normal(2)
    else:
        assert place.uniform_mm is not None
        x, y = rng.uniform(-place.uniform_mm, place.uniform_mm, 2)
    yaw = rng.uniform(0.0, 2.0 * np.pi)
    force = sample_force(rng, own.force_n)
    if rng.random() < own.background_share and not path.steps:
        force = 0.0
    tilt = sample_tilt(rng, place)
    if which:
        stand_in = int(name.removeprefix(RANDOM_PREFIX)) + FIRST_STAND_IN
        name = f"{RANDOM_PREFIX}{stand_in + (which - 1) * STAND_IN_STEP}"
    command = PressCommand(name, float(x), float(y), float(yaw), force, *tilt)
    further = ()
    if path.steps:
        assert recipe.motion
        further = sample_commands(recipe.motion, path, command, seed, number, attempt)
    return (command, *further), rng, attempt


def sample_tilt(rng: np.random.Generator, place: Place) -> tuple[float, float]:
    """A tilt about x and y, rad, with a uniform angle to the press axis in a uniform direction."""
    if place.tilt_deg is UNSET:
        return 0.0, 0.0
    angle = np.deg2rad(rng.uniform(*place.tilt_range_deg))
    towards = rng.uniform(0.0, 2.0 * np.pi)
    # The axis is (sin y cos x, -sin x, cos y cos x) after a tilt by x and y.
    about_x = np.arcsin(np.sin(angle) * np.sin(towards))
    about_y = np.arctan2(np.sin(angle) * np.cos(towards), np.cos(angle))
    return float(about_x), float(about_y)


def sample_force(rng: np.random.Generator, forces: float | tuple[float, ...] | ForceRange) -> float:
    """A force, N: a constant, one of a list, or log-uniform in a range."""
    if isinstance(forces, tuple):
        return float(forces[int(rng.integers(len(forces)))])
    if not isinstance(forces, ForceRange):
        return float(forces)
    while True:
        force = float(log_uniform(rng, (forces.low, forces.high)))
        if not any(first <= force <= last for first, last in forces.leave_out):
            return force


def sample_paths(
    motion: Motion, touches: int, seed: tuple[int, int], number: int
) -> tuple[MotionPath, ...]:
    """The paths of a shape of so many touches; seed, number: as for press_attempts."""
    rng = np.random.default_rng((*seed, PATH_STREAM, number))
    paths, index = [], 0
    while index < touches:
        at = rng.random()
        kind = "slide" if at < motion.still + motion.slide else "twist"
        steps = int(rng.integers(motion.steps[0], motion.steps[1], endpoint=True))
        steps = min(steps, touches - index - 1)
        is_still = at < motion.still or not steps
        paths.append(MotionPath(index) if is_still else MotionPath(index, kind, steps))
        index += 1 + paths[-1].steps
    return tuple(paths)


def sample_commands(
    motion: Motion, path: MotionPath, start: PressCommand, seed: tuple[int, int], number: int,
    attempt: int,
) -> tuple[PressCommand, ...]:  # fmt: skip
    """The touches of a path after its press: equal steps of the pose and the force."""
    rng = np.random.default_rng((*seed, MOTION_STREAM, number, path.index, attempt))
    dx_mm = dy_mm = turn_rad = 0.0
    if path.kind == "slide":
        length, angle = log_uniform(rng, motion.slide_mm), rng.uniform(0.0, 2.0 * np.pi)
        dx_mm, dy_mm = float(length * np.cos(angle)), float(length * np.sin(angle))
    elif path.kind == "twist":
        turn_rad = float(np.deg2rad(log_uniform(rng, motion.twist_deg)) * rng.choice((-1, 1)))
    end_n = np.clip(start.force_n * log_uniform(rng, motion.force_change), *FORCE_RANGE_N)
    return tuple(
        replace(
            start,
            x_mm=start.x_mm + share * dx_mm,
            y_mm=start.y_mm + share * dy_mm,
            yaw_rad=start.yaw_rad + share * turn_rad,
            force_n=float(start.force_n + share * (end_n - start.force_n)),
        )
        for share in (step / path.steps for step in range(1, path.steps + 1))
    )


def sample_friction(
    motion: Motion, ranges: Mapping[str, str], seed: tuple[int, int], number: int
) -> dict[str, float]:
    """Coefficients of friction of a shape by sensor. ranges: names of the motion's ranges."""
    rng = np.random.default_rng((*seed, FRICTION_STREAM, number))
    return {each: float(log_uniform(rng, getattr(motion, name))) for each, name in ranges.items()}
