"""Motion in a world: paths on which a pressed shape slides or twists, and its friction.

A path starts with a press. Each further touch continues the one before, at equal steps.
"""

from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta, Struct

from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.types import FORCE_RANGE_N, PressCommand
from t2twin.sim.digit.randomization.ranges import log_uniform

PATH_STREAM, MOTION_STREAM, FRICTION_STREAM = 15, 16, 17
"""Random streams of one seed: kinds of the paths, their motions, friction of the shapes."""

SHARE_TOLERANCE = 1e-6
"""Largest difference of the shares' sum from 1: rounding."""

Share = Annotated[float, Meta(ge=0.0, le=1.0)]
Length = Annotated[float, Meta(ge=0.01, le=25.0)]
Turn = Annotated[float, Meta(ge=0.1, le=180.0)]
Steps = Annotated[int, Meta(ge=1, le=100)]
Ratio = Annotated[float, Meta(ge=0.1, le=10.0)]
Friction = Annotated[float, Meta(ge=0.01, le=5.0)]


class Motion(Struct, frozen=True, forbid_unknown_fields=True):
    """Distribution of the paths of sampled presses. Presses on the grid stay still.

    still, slide, twist: shares of the paths, whose sum is 1. The others are ranges, low and high.
    slide_mm: length of a slide, in any direction. twist_deg: angle of a twist, either way. steps:
    touches of a path after its press. force_change: force at the end over the force at the start.
    gel_friction, cover_friction: coefficients of friction, sampled for each shape. All are sampled
    uniformly in the logarithm, steps uniformly. markers: share of the DIGIT units that have markers
    (t2twin.sim.digit.markers), on grids of sampled pitch and diameter. The defaults of friction are
    those of t2twin.sim.contact.sliding; the others are assumed.
    """

    still: Share = 0.4
    slide: Share = 0.4
    twist: Share = 0.2
    slide_mm: tuple[Length, Length] = (0.1, 4.0)
    twist_deg: tuple[Turn, Turn] = (1.0, 20.0)
    steps: tuple[Steps, Steps] = (1, 4)
    force_change: tuple[Ratio, Ratio] = (0.7, 1.4)
    gel_friction: tuple[Friction, Friction] = (0.4, 1.5)
    cover_friction: tuple[Friction, Friction] = (0.5, 1.5)
    markers: Share = 0.0

    def __post_init__(self) -> None:
        if abs(self.still + self.slide + self.twist - 1.0) > SHARE_TOLERANCE:
            raise T2TwinError(
                f"still, slide and twist of motion are {self.still:g}, {self.slide:g} and "
                f"{self.twist:g}; expected shares whose sum is 1"
            )
        for name in self.__struct_fields__[3:-1]:
            low, high = getattr(self, name)
            if low > high:
                raise T2TwinError(f"{name} of motion is [{low:g}, {high:g}]; expected low first")


@dataclass(frozen=True)
class MotionPath:
    """A path of a shape. index: of its press among the shape's touches; the next `steps`
    touches belong to it as well, 0 for a still press."""

    index: int
    kind: Literal["still", "slide", "twist"] = "still"
    steps: int = 0


def sample_paths(
    motion: Motion, touches: int, seed: tuple[int, int], number: int
) -> tuple[MotionPath, ...]:
    """The paths of a shape; the last one ends with its last touch.

    touches: number of the shape's touches. seed: the world's seed and the part's number. number:
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


def sample_friction(motion: Motion, seed: tuple[int, int], number: int) -> dict[str, float]:
    """Coefficients of friction of a shape, by sensor. seed, number: as for sample_paths."""
    rng = np.random.default_rng((*seed, FRICTION_STREAM, number))
    return {
        "digit": float(log_uniform(rng, motion.gel_friction)),
        "cyskin": float(log_uniform(rng, motion.cover_friction)),
    }
