"""Samples the features of random shapes.

All distributions are assumed. They cover the edges, faces, ends, ribs and tips of everyday objects
from 0.5 mm to beyond the size of both sensors, without modeling any particular object.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

Outline = Literal["bar", "half-plane", "disc", "ring", "polygon"]
Profile = Literal["flat", "rounded", "rod", "wedge"]
Teeth = Literal["none", "pointed", "square"]

NUMBERS, NUMBER_SHARES = (1, 2, 3, 4), (0.38, 0.34, 0.18, 0.1)
"""Numbers of features of a shape, and their probabilities."""

KIND_SHARES = {
    "bar": 0.42,
    "bent-bar": 0.08,
    "arc": 0.07,
    "half-plane": 0.13,
    "disc": 0.12,
    "ring": 0.06,
    "polygon": 0.07,
    "hollow-polygon": 0.05,
}
"""Probability of each kind of feature. An arc is a strongly bent bar."""

PROFILE_SHARES: dict[str, dict[Profile, float]] = {
    "bar": {"flat": 0.36, "rounded": 0.3, "rod": 0.2, "wedge": 0.14},
    "bent-bar": {"flat": 0.4, "rounded": 0.35, "rod": 0.15, "wedge": 0.1},
    "arc": {"flat": 0.4, "rounded": 0.35, "rod": 0.15, "wedge": 0.1},
    "half-plane": {"flat": 0.55, "rounded": 0.45},
    "disc": {"flat": 0.36, "rounded": 0.24, "rod": 0.3, "wedge": 0.1},
    "ring": {"flat": 0.45, "rounded": 0.35, "rod": 0.2},
    "polygon": {"flat": 0.5, "rounded": 0.35, "wedge": 0.15},
    "hollow-polygon": {"flat": 0.6, "rounded": 0.4},
}
"""Probability of each profile: flat, rounded edges, entirely round (a rod; of a disc: a ball), or
sharp (a roof; of a disc: a cone; of a polygon: a pyramid)."""

HALF_WIDTH_MM = (0.4, 8.0)
LENGTH_MM = (3.0, 200.0)
DISC_RADIUS_MM = (0.4, 20.0)
RING_RADIUS_MM = (1.0, 26.0)
RING_HALF_WALL_MM = (0.25, 3.5)
POLYGON_RADIUS_MM = (0.8, 20.0)
WALL_MM = (0.5, 5.0)
BEND_RADIUS_MM = (12.0, 120.0)
ARC_RADIUS_MM = (2.0, 30.0)
"""Ranges of sizes, mm, sampled log-uniformly. Lengths of bars are from end to end."""

ARC_ANGLE_RAD = (0.6, 5.2)
"""Angle of an arc, rad, uniform."""

ROUNDING_SHARE = (0.15, 1.0)
"""Radius of a rounded edge over half the feature's width, uniform."""

LARGEST_ROUNDING_MM = 4.0
"""Largest radius of a rounded edge, mm."""

ROD_RADIUS_SHARE = (1.0, 3.0)
"""Radius of a rod's or a ball's curvature over half its width, log-uniform."""

WEDGE_SLOPE = (0.15, 1.5)
"""Slope of the sides of a roof, mm per mm, log-uniform."""

SIDES = (3, 4, 5, 6, 8)
IRREGULARITY = 0.25
"""Numbers of a polygon's sides, and the relative standard deviation of their distances from the
center; half of the polygons are regular."""

TEETH_SHARE, TEETH_PITCH_MM, TEETH_DEPTH_MM = 0.13, (0.7, 4.5), (0.2, 1.5)
"""Share of serrated bars and half-planes, pitch of their teeth (log-uniform, mm) and depth of the
cuts (uniform, mm)."""

CUT_SHARE, HOLE_SHARE, HOLE_RADIUS_MM = 0.2, 0.15, (0.5, 6.0)
"""Share of shapes cut by a plane, share with a round hole, and the hole's radius (log-uniform, mm).
"""

FIRST_OFFSET_MM, OTHERS_OFFSET_MM, CUT_OFFSET_MM = 1.5, 6.0, 3.0
"""Standard deviations along x and y of the distance from the press axis, mm: of the first feature,
of the others, and of cuts and holes."""

SAME_HEIGHT_SHARE, MAX_LOWER_MM = 0.4, 1.2
"""Share of further features as high as the first, and by how much the others are lower at most
(uniform, mm)."""

PARALLEL_SHARE = 0.4
"""Share of further features parallel to the first, as ribs and jaws are."""

TILT_SHARE, MAX_TILT_DEG = 0.35, 3.0
"""Share of tilted shapes, and their largest tilt (uniform, degrees)."""


@dataclass(frozen=True)
class Feature:
    """One feature, in the shape frame.

    x_mm, y_mm, turn_rad: pose of the feature's frame. A bar extends along its y, a half-plane along
    its x. half_width_mm: half the width of a bar or of a ring's wall, a disc's radius, the least
    distance of a polygon's sides from its center; inf for a half-plane. half_length_mm: half a
    bar's length. radius_mm: of the center line of a ring or a bent bar; 0 for a straight bar.
    sides: (n, 2) directions (rad) and distances (mm) of a polygon's sides from its center.
    wall_mm: of a hollow polygon; 0 for a full one. curve: radius of a rounded edge or a rod, mm, or
    slope of a roof. lower_mm: depth of the feature's top below the shape's.
    """

    outline: Outline
    profile: Profile
    x_mm: float
    y_mm: float
    turn_rad: float
    half_width_mm: float
    half_length_mm: float = 0.0
    radius_mm: float = 0.0
    sides: tuple[tuple[float, float], ...] = ()
    wall_mm: float = 0.0
    curve: float = 0.0
    lower_mm: float = 0.0
    teeth: Teeth = "none"
    teeth_pitch_mm: float = 1.0
    teeth_depth_mm: float = 0.0


@dataclass(frozen=True)
class Composition:
    """The features, cuts, holes and tilt of a random shape.

    cuts: (direction rad, distance mm) of planes; the part beyond the distance is removed. holes:
    (x, y, radius), mm. tilt: slope along x and y, mm per mm.
    """

    features: tuple[Feature, ...]
    cuts: tuple[tuple[float, float], ...]
    holes: tuple[tuple[float, float, float], ...]
    tilt: tuple[float, float]


def sample_composition(rng: np.random.Generator) -> Composition:
    """Sample the composition of a random shape."""
    count = int(rng.choice(NUMBERS, p=NUMBER_SHARES))
    features: list[Feature] = []
    for _ in range(count):
        features.append(_sample_feature(rng, features[0] if features else None))
    cuts, holes = [], []
    if rng.random() < CUT_SHARE:
        cuts.append((_turn(rng), float(rng.normal(0.0, CUT_OFFSET_MM))))
    if rng.random() < HOLE_SHARE:
        x, y = rng.normal(0.0, CUT_OFFSET_MM, 2)
        holes.append((float(x), float(y), _log_uniform(rng, HOLE_RADIUS_MM)))
    slope, direction = 0.0, _turn(rng)
    if rng.random() < TILT_SHARE:
        slope = float(np.tan(np.radians(rng.uniform(0.0, MAX_TILT_DEG))))
    tilt = (slope * float(np.cos(direction)), slope * float(np.sin(direction)))
    return Composition(tuple(features), tuple(cuts), tuple(holes), tilt)


def _sample_feature(rng: np.random.Generator, first: Feature | None) -> Feature:
    kind = str(rng.choice(list(KIND_SHARES), p=list(KIND_SHARES.values())))
    shares = PROFILE_SHARES[kind]
    profile: Profile = rng.choice(list(shares), p=list(shares.values()))
    offset = FIRST_OFFSET_MM if first is None else OTHERS_OFFSET_MM
    x, y = rng.normal(0.0, offset, 2)
    turn = _turn(rng)
    if first is not None and rng.random() < PARALLEL_SHARE:
        turn = first.turn_rad
    lower = 0.0
    if first is not None and rng.random() >= SAME_HEIGHT_SHARE:
        lower = float(rng.uniform(0.0, MAX_LOWER_MM))
    sizes = _sample_sizes(rng, kind)
    x, y = _sample_position(rng, sizes, float(x), float(y), turn)
    curve = _sample_curve(rng, profile, float(sizes["half_width_mm"]), float(sizes["wall_mm"]))
    teeth: Teeth = "none"
    if kind in ("bar", "bent-bar", "half-plane") and rng.random() < TEETH_SHARE:
        teeth = "pointed" if rng.random() < 0.6 else "square"
    return Feature(
        **sizes,
        profile=str(profile),  # pyright: ignore[reportArgumentType]
        x_mm=x,
        y_mm=y,
        turn_rad=turn,
        curve=curve,
        lower_mm=lower,
        teeth=teeth,
        teeth_pitch_mm=_log_uniform(rng, TEETH_PITCH_MM),
        teeth_depth_mm=float(rng.uniform(*TEETH_DEPTH_MM)),
    )


def _sample_sizes(rng: np.random.Generator, kind: str) -> dict:
    """Sample the sizes of a feature of a kind, as fields of Feature."""
    sizes = {"outline": kind, "half_length_mm": 0.0, "radius_mm": 0.0, "sides": (), "wall_mm": 0.0}
    if kind == "half-plane":
        return sizes | {"half_width_mm": float("inf")}
    if kind == "disc":
        return sizes | {"half_width_mm": _log_uniform(rng, DISC_RADIUS_MM)}
    if kind == "ring":
        radius = _log_uniform(rng, RING_RADIUS_MM)
        wall = min(_log_uniform(rng, RING_HALF_WALL_MM), 0.8 * radius)
        return sizes | {"half_width_mm": wall, "radius_mm": radius}
    if kind in ("polygon", "hollow-polygon"):
        reach = _log_uniform(rng, POLYGON_RADIUS_MM)
        number = int(rng.choice(SIDES))
        spread = IRREGULARITY if rng.random() < 0.5 else 0.0
        apart = reach * np.exp(spread * rng.standard_normal(number))
        angles = 2 * np.pi * np.arange(number) / number
        sides = tuple((float(a), float(d)) for a, d in zip(angles, apart, strict=True))
        wall = _log_uniform(rng, WALL_MM) if kind == "hollow-polygon" else 0.0
        nearest = float(apart.min())
        return sizes | {
            "outline": "polygon",
            "half_width_mm": nearest,
            "sides": sides,
            "wall_mm": 0.0 if wall >= nearest else wall,
        }
    half_width = _log_uniform(rng, HALF_WIDTH_MM)
    radius, length = 0.0, _log_uniform(rng, LENGTH_MM)
    if kind == "bent-bar":
        radius = max(_log_uniform(rng, BEND_RADIUS_MM), 1.5 * half_width)
    elif kind == "arc":
        radius = max(_log_uniform(rng, ARC_RADIUS_MM), 1.5 * half_width)
        length = radius * float(rng.uniform(*ARC_ANGLE_RAD))
    return sizes | {
        "outline": "bar",
        "half_width_mm": half_width,
        "half_length_mm": max(length, 2 * half_width) / 2,
        "radius_mm": radius,
    }


def _sample_position(
    rng: np.random.Generator, sizes: dict, x: float, y: float, turn: float
) -> tuple[float, float]:
    """Sample the position of a feature's frame such that some part of it is near (x, y).

    A bar may end anywhere, and the wall of a ring may lie there instead of its center.
    """
    along = float(rng.uniform(-0.9, 0.9))
    if sizes["outline"] == "ring" and rng.random() < 0.7:
        return x - sizes["radius_mm"] * np.cos(turn), y - sizes["radius_mm"] * np.sin(turn)
    if sizes["outline"] == "bar" and sizes["radius_mm"] == 0.0:
        shift = along * sizes["half_length_mm"]
        return x - shift * -np.sin(turn), y - shift * np.cos(turn)
    if sizes["outline"] in ("disc", "polygon") and rng.random() < 0.5:
        shift = along * sizes["half_width_mm"]
        return x - shift * np.cos(turn), y - shift * np.sin(turn)
    return x, y


def _sample_curve(
    rng: np.random.Generator, profile: Profile, half_width: float, wall: float
) -> float:
    """Sample the radius of a rounded edge or a rod, mm, or the slope of a roof."""
    if wall:
        half_width = wall / 2
    if profile == "rounded":
        return (
            min(half_width * float(rng.uniform(*ROUNDING_SHARE)), LARGEST_ROUNDING_MM)
            if (np.isfinite(half_width))
            else LARGEST_ROUNDING_MM * float(rng.uniform(0.05, 1.0))
        )
    if profile == "rod":
        return half_width * _log_uniform(rng, ROD_RADIUS_SHARE)
    return _log_uniform(rng, WEDGE_SLOPE) if profile == "wedge" else 0.0


def _turn(rng: np.random.Generator) -> float:
    return float(rng.uniform(0.0, 2.0 * np.pi))


def _log_uniform(rng: np.random.Generator, limits: tuple[float, float]) -> float:
    low, high = np.log(limits[0]), np.log(limits[1])
    return float(np.exp(rng.uniform(low, high)))
