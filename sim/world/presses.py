"""The presses of a world's part: which, where, how hard. All of them follow from the seed."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.random_shapes import PREFIX
from t2twin.sim.contact.types import PressCommand
from t2twin.sim.world import protocol
from t2twin.sim.world.recipe import RANDOM, ForceRange, Part, Place

PRESS_STREAM, FORCE_STREAM, UNIT_STREAM, FRAME_STREAM = 11, 12, 13, 14
"""Keep the draws of presses, of forces on a grid, of DIGITs and of the noise in their untouched
frames apart, in one seed."""

SEEDS_A_WORLD = 1_000_000_000
"""Random shapes of a world are called by numbers from its seed times this on."""

MAX_SEED = 9_000_000_000
"""Largest seed of a world of random shapes: theirs stay below the largest of all."""

MAX_ATTEMPTS = 20
"""How often a press is drawn until it touches the shape's features and settles."""

STAND_INS = 8
"""Random shapes that are tried in the place of one that can't be touched: about one in ten thousand
is such a sliver that a force of some newtons pushes it in to its base plate wherever it stands."""

FIRST_STAND_IN, STAND_INS_APART = 500_000_000, 50_000_000
"""Numbers that a shape's first stand-in, and each further one, is ahead of it in its world."""


@dataclass(frozen=True)
class PressSample:
    """One press of a part. index: its number among the shape's. command: force 0 where nothing
    touches. rng: what its noise is drawn from."""

    index: int
    command: PressCommand
    rng: np.random.Generator

    @property
    def is_untouched(self) -> bool:
        return self.command.force_n == 0.0


def random_name(seed: int, number: int) -> str:
    """What the number-th random shape of a world is called."""
    return f"{PREFIX}{seed * SEEDS_A_WORLD + number}"


def attempts_of(part: Part) -> int:
    """How many draws a press of a part has: random shapes have stand-ins."""
    return MAX_ATTEMPTS * (1 + STAND_INS) if part.shapes == RANDOM else MAX_ATTEMPTS


def name_at(name: str, attempt: int) -> str:
    """What is pressed at an attempt: the shape, or one of its stand-ins."""
    which = attempt // MAX_ATTEMPTS
    if which == 0:
        return name
    number = int(name.removeprefix(PREFIX)) + FIRST_STAND_IN + (which - 1) * STAND_INS_APART
    return f"{PREFIX}{number}"


def planned_name(name: str) -> str:
    """The random shape that was planned where one of this name was pressed: itself, or the one it
    stands in for."""
    world, number = divmod(int(name.removeprefix(PREFIX)), SEEDS_A_WORLD)
    if number >= FIRST_STAND_IN:
        number = (number - FIRST_STAND_IN) % STAND_INS_APART
    return random_name(world, number)


def grid_presses(
    part: Part, name: str, indices: tuple[int, ...], seed: int
) -> Iterator[PressSample]:
    """The protocol's presses of a shape by these indices, with the part's force or forces.

    Of a list of forces an index counts the grid's presses, and the forces of each.
    """
    place, spacing = catalogue.NAMES.index(name), catalogue.spacing_mm(name)
    forces = part.force_n if isinstance(part.force_n, tuple) else (part.force_n,)
    for index in indices:
        at, which = divmod(index, len(forces))
        command = protocol.press_of(name, spacing, at)
        force = forces[which]
        if isinstance(force, ForceRange):
            force = sample_force(np.random.default_rng((seed, FORCE_STREAM, place, index)), force)
        if force != command.force_n:
            command = PressCommand(name, command.x_mm, command.y_mm, command.yaw_rad, float(force))
        yield PressSample(index, command, np.random.default_rng((seed, place, index)))


def grid_indices(part: Part, name: str) -> tuple[int, ...]:
    """Indices of a shape's presses on the grid, rising; see grid_presses."""
    at = protocol.indices(name, protocol.scale_of(part.scale))
    forces = len(part.force_n) if isinstance(part.force_n, tuple) else 1
    return tuple(index * forces + which for index in at for which in range(forces))


def sample_press(
    part: Part, name: str, number: int, press: int, seed: tuple[int, ...], attempt: int
) -> PressSample:
    """A press that is no grid's.

    name, number: the planned shape's, and its place in its part. press: its place among the
    shape's. seed: the world's seed and the part's number. attempt: how many draws were refused
    before; after MAX_ATTEMPTS of a random shape a stand-in is pressed (name_at).
    """
    rng = np.random.default_rng((*seed, PRESS_STREAM, number, press, attempt))
    assert isinstance(part.place, Place)
    if part.place.normal_mm is not None:
        x, y = part.place.normal_mm * rng.standard_normal(2)
    else:
        assert part.place.uniform_mm is not None
        x, y = rng.uniform(-part.place.uniform_mm, part.place.uniform_mm, 2)
    yaw = rng.uniform(0.0, 2.0 * np.pi)
    force = sample_force(rng, part.force_n)
    if rng.random() < part.untouched_share:
        force = 0.0
    command = PressCommand(name_at(name, attempt), float(x), float(y), float(yaw), force)
    return PressSample(press, command, rng)


def sample_force(rng: np.random.Generator, forces: float | tuple[float, ...] | ForceRange) -> float:
    """A force, N: the one there is, one of a list, or one of a range."""
    if isinstance(forces, tuple):
        return float(forces[int(rng.integers(len(forces)))])
    if not isinstance(forces, ForceRange):
        return float(forces)
    while True:
        force = float(np.exp(rng.uniform(np.log(forces.low), np.log(forces.high))))
        if not any(first <= force <= last for first, last in forces.leave_out):
            return force
