"""The presses of a part of a recipe: index, place, force, motion. All follow from the seed.

A press on the protocol's grid is fixed by its index. Any other press is sampled: its attempt 0 may
miss the shape's features, then the next attempt is another sample of the same press.
In a recipe with motion, sampled presses start paths, on which the shape slides or twists. Each
further touch of a path continues the one before, at equal steps.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from msgspec import UNSET, structs

from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.shape import RANDOM_PREFIX
from t2twin.sim.contact.types import FORCE_RANGE_N, PressCommand
from t2twin.sim.optical.units import log_uniform
from t2twin.sim.sampling import protocol
from t2twin.sim.sampling.recipe import RANDOM, ForceRange, Motion, Part, Place, Recipe

PRESS_STREAM, FORCE_STREAM, UNIT_STREAM, FRAME_STREAM = 11, 12, 13, 14
"""Random streams of one seed: presses, forces on a grid, units, noise of their background
frames."""

PATH_STREAM, MOTION_STREAM, FRICTION_STREAM = 15, 16, 17
"""Random streams of one seed: kinds of the paths, their motions, friction of the shapes."""

SEEDS_PER_RECIPE = 1_000_000_000
"""Numbers of the random shapes of a recipe: they start at its seed times this."""

MAX_SHAPE_SEED = 9_000_000_000
"""Largest seed of a recipe of random shapes: their numbers stay below the largest of all shapes."""

MAX_ATTEMPTS = 20
"""Samples of a press until it touches the shape's features and settles."""

STAND_INS = 8
"""Random shapes that replace one that cannot be touched. About one random shape in ten thousand is
a sliver that a force of some newtons pushes in to its base plate wherever it stands."""

FIRST_STAND_IN, STAND_IN_STEP = 500_000_000, 50_000_000
"""Offset of the number of a shape's first stand-in, and the step to each further one."""


@dataclass(frozen=True)
class MotionPath:
    """A path of a shape. index: of its press among the shape's touches; the next `steps`
    touches belong to it as well, 0 for a still press."""

    index: int
    kind: Literal["still", "slide", "twist"] = "still"
    steps: int = 0


@dataclass(frozen=True)
class PressSample:
    """One press of a part, or one attempt at it.

    index: its number among the shape's presses. command: of 0 N without contact. rng: generator of
    the sensors' noise. attempt: None for a press on the grid, which is not sampled. further: the
    touches of its path after it.
    """

    index: int
    command: PressCommand
    rng: np.random.Generator
    attempt: int | None
    further: tuple[PressCommand, ...] = ()


def random_name(seed: int, number: int) -> str:
    """Name of the number-th random shape of a recipe."""
    return f"{RANDOM_PREFIX}{seed * SEEDS_PER_RECIPE + number}"


def max_attempts(part: Part) -> int:
    """The largest number of attempts at a sampled press: those of its shape and all stand-ins."""
    return MAX_ATTEMPTS * (1 + STAND_INS) if part.shapes == RANDOM else MAX_ATTEMPTS


def name_at(name: str, attempt: int) -> str:
    """The shape of an attempt: the planned one, or one of its stand-ins."""
    which = attempt // MAX_ATTEMPTS
    if which == 0:
        return name
    number = int(name.removeprefix(RANDOM_PREFIX)) + FIRST_STAND_IN + (which - 1) * STAND_IN_STEP
    return f"{RANDOM_PREFIX}{number}"


def planned_name(name: str) -> str:
    """The planned random shape of a pressed one: itself, or the one that it replaces."""
    recipe, number = divmod(int(name.removeprefix(RANDOM_PREFIX)), SEEDS_PER_RECIPE)
    if number >= FIRST_STAND_IN:
        number = (number - FIRST_STAND_IN) % STAND_IN_STEP
    return random_name(recipe, number)


def grid_indices(part: Part, name: str) -> tuple[int, ...]:
    """Indices of a shape's presses on the grid, rising: all forces of a list at each grid press."""
    assert isinstance(part.scale, str)  # a number is of files, which have no grid
    grid = protocol.indices(name, protocol.scale_of(part.scale))
    forces = len(part.force_n) if isinstance(part.force_n, tuple) else 1
    return tuple(index * forces + which for index in grid for which in range(forces))


def press_attempts(
    part: Part, name: str, number: int, index: int, seed: tuple[int, int], first: int = 0
) -> Iterator[PressSample]:
    """The attempts at one press, in their order; one on the grid, else max_attempts(part).

    name, number: the planned shape and its number in the part. index: of the press among the
    shape's. seed: the recipe's seed and the part's number. first: attempt to start with.
    """
    if part.place == "grid":
        yield _grid_press(part, name, index, seed[0])
        return
    for attempt in range(first, max_attempts(part)):
        yield sample_press(part, name, number, index, seed, attempt)


def path_attempts(
    recipe: Recipe, part: int, name: str, number: int, path: MotionPath, first: int = 0
) -> Iterator[PressSample]:
    """The attempts at a path, in their order. A path with motion has contact.

    part: its number in the recipe. name, number, first: as for press_attempts.
    """
    seed, own = (recipe.seed, part), recipe.parts[part]
    if not path.steps:
        yield from press_attempts(own, name, number, path.index, seed, first)
        return
    assert recipe.motion
    own = structs.replace(own, background_share=0.0)
    for each in press_attempts(own, name, number, path.index, seed, first):
        assert each.attempt is not None
        further = sample_commands(recipe.motion, path, each.command, seed, number, each.attempt)
        yield replace(each, further=further)


def sample_press(
    part: Part, name: str, number: int, index: int, seed: tuple[int, int], attempt: int
) -> PressSample:
    """One attempt at a press that is not on the grid; see press_attempts.

    From attempt MAX_ATTEMPTS on a random shape is replaced by a stand-in (name_at).
    """
    rng = np.random.default_rng((*seed, PRESS_STREAM, number, index, attempt))
    assert isinstance(part.place, Place)
    if part.place.normal_mm is not None:
        x, y = part.place.normal_mm * rng.standard_normal(2)
    else:
        assert part.place.uniform_mm is not None
        x, y = rng.uniform(-part.place.uniform_mm, part.place.uniform_mm, 2)
    yaw = rng.uniform(0.0, 2.0 * np.pi)
    force = sample_force(rng, part.force_n)
    if rng.random() < part.background_share:
        force = 0.0
    tilt = sample_tilt(rng, part.place)
    command = PressCommand(name_at(name, attempt), float(x), float(y), float(yaw), force, *tilt)
    return PressSample(index, command, rng, attempt)


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


def _grid_press(part: Part, name: str, index: int, seed: int) -> PressSample:
    """A press of the protocol with the part's force, or one of its forces (grid_indices)."""
    place = catalogue.NAMES.index(name)
    forces = part.force_n if isinstance(part.force_n, tuple) else (part.force_n,)
    at, which = divmod(index, len(forces))
    command = protocol.press_of(name, catalogue.spacing_mm(name), at)
    force = forces[which]
    if isinstance(force, ForceRange):
        force = sample_force(np.random.default_rng((seed, FORCE_STREAM, place, index)), force)
    command = replace(command, force_n=float(force))
    return PressSample(index, command, np.random.default_rng((seed, place, index)), None)


def sample_force(rng: np.random.Generator, forces: float | tuple[float, ...] | ForceRange) -> float:
    """A force, N: a constant, one of a list, or log-uniform in a range."""
    if isinstance(forces, tuple):
        return float(forces[int(rng.integers(len(forces)))])
    if not isinstance(forces, ForceRange):
        return float(forces)
    while True:
        force = float(np.exp(rng.uniform(np.log(forces.low), np.log(forces.high))))
        if not any(first <= force <= last for first, last in forces.leave_out):
            return force


def sample_paths(
    motion: Motion, touches: int, seed: tuple[int, int], number: int
) -> tuple[MotionPath, ...]:
    """The paths of a shape; the last one ends with its last touch.

    touches: number of the shape's touches. seed: the recipe's seed and the part's number. number:
    of the shape in the part.
    """
    rng = np.random.default_rng((*seed, PATH_STREAM, number))
    paths, index = [], 0
    while index < touches:
        at = rng.random()
        kind = "slide" if at < motion.still + motion.slide else "twist"
        steps = int(rng.integers(motion.steps[0], motion.steps[1], endpoint=True))
        steps = min(steps, touches - index - 1)
        path = (
            MotionPath(index) if at < motion.still or not steps else MotionPath(index, kind, steps)
        )
        paths.append(path)
        index += 1 + path.steps
    return tuple(paths)


def sample_commands(
    motion: Motion,
    path: MotionPath,
    start: PressCommand,
    seed: tuple[int, int],
    number: int,
    attempt: int,
) -> tuple[PressCommand, ...]:
    """The touches of a path after its press; the pose and the force change by equal steps.

    start: the press. attempt: its number. The force stays within FORCE_RANGE_N.
    """
    rng = np.random.default_rng((*seed, MOTION_STREAM, number, path.index, attempt))
    dx_mm = dy_mm = turn_rad = 0.0
    if path.kind == "slide":
        length, angle = log_uniform(rng, motion.slide_mm), rng.uniform(0.0, 2.0 * np.pi)
        dx_mm, dy_mm = float(length * np.cos(angle)), float(length * np.sin(angle))
    elif path.kind == "twist":
        turn_rad = float(np.deg2rad(log_uniform(rng, motion.twist_deg)) * rng.choice((-1, 1)))
    end_n = np.clip(start.force_n * log_uniform(rng, motion.force_change), *FORCE_RANGE_N)
    commands = []
    for step in range(1, path.steps + 1):
        share = step / path.steps
        commands.append(
            replace(
                start,
                x_mm=start.x_mm + share * dx_mm,
                y_mm=start.y_mm + share * dy_mm,
                yaw_rad=start.yaw_rad + share * turn_rad,
                force_n=float(start.force_n + share * (end_n - start.force_n)),
            )
        )
    return tuple(commands)


def sample_friction(
    motion: Motion, ranges: Mapping[str, str], seed: tuple[int, int], number: int
) -> dict[str, float]:
    """Coefficients of friction of a shape, by sensor.

    ranges: name of the motion's range of each sensor. seed, number: as for sample_paths.
    """
    rng = np.random.default_rng((*seed, FRICTION_STREAM, number))
    return {
        sensor: float(log_uniform(rng, getattr(motion, name))) for sensor, name in ranges.items()
    }
