"""Random shapes: compositions of one to four features, sampled from a seed.

All distributions are assumed. They cover the edges, faces, ends, ribs and tips of everyday objects
from 0.5 mm to beyond both sensors. The height of a composition is the maximum over its features.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from t2twin.primitives_cad.height_map import REACH_MM
from t2twin.primitives_cad.shape import (
    NOTHING_MM,
    PLATE_THICKNESS_MM,
    RANDOM_PREFIX,
    HeightMap,
    Shape,
)

# of the height map (assumed: two pixels of a DIGIT, a fifth of the narrowest feature)
PITCH_MM = 0.1
# below the highest point (assumed: more than a press, a tilt and a lower feature)
BASE_DEPTH_MM = 8.0
SPACING_MM = (1.5, 1.5)  # of the protocol's grid, as on the tools (Grella et al. 2023)
STREAM = 1_701  # separates these random numbers from others with the same seed
MAX_TRIES = 100  # compositions sampled until one can be pressed; about one in sixty cannot
MIN_AREA_MM2 = 0.1  # least area of a shape's features near the press axis, mm2
NEAR_MM = 6.0  # largest distance of that area from the press axis along x and y, mm

NUMBERS, NUMBER_SHARES = (1, 2, 3, 4), (0.38, 0.34, 0.18, 0.1)  # of features
KINDS: dict[str, tuple[float, dict[str, float]]] = {
    "bar": (0.42, {"flat": 0.36, "rounded": 0.3, "rod": 0.2, "wedge": 0.14}),
    "bent-bar": (0.08, {"flat": 0.4, "rounded": 0.35, "rod": 0.15, "wedge": 0.1}),
    "arc": (0.07, {"flat": 0.4, "rounded": 0.35, "rod": 0.15, "wedge": 0.1}),
    "half-plane": (0.13, {"flat": 0.55, "rounded": 0.45}),
    "disc": (0.12, {"flat": 0.36, "rounded": 0.24, "rod": 0.3, "wedge": 0.1}),
    "ring": (0.06, {"flat": 0.45, "rounded": 0.35, "rod": 0.2}),
    "polygon": (0.07, {"flat": 0.5, "rounded": 0.35, "wedge": 0.15}),
    "hollow-polygon": (0.05, {"flat": 0.6, "rounded": 0.4}),
}
"""Probabilities of each kind of feature, of which an arc is a strongly bent bar, and of its
profiles: flat, rounded edges, entirely round (a rod; of a disc: a ball), or sharp (a roof; of a
disc: a cone; of a polygon: a pyramid)."""

# Ranges of sizes, sampled log-uniformly. Lengths of bars are from end to end.
HALF_WIDTH_MM = (0.4, 8.0)
LENGTH_MM = (3.0, 200.0)
DISC_RADIUS_MM = (0.4, 20.0)
RING_RADIUS_MM = (1.0, 26.0)
RING_HALF_WALL_MM = (0.25, 3.5)
POLYGON_RADIUS_MM = (0.8, 20.0)
WALL_MM = (0.5, 5.0)
BEND_RADIUS_MM = (12.0, 120.0)
ARC_RADIUS_MM = (2.0, 30.0)
ARC_ANGLE_RAD = (0.6, 5.2)  # angle of an arc, rad, uniform
ROUNDING_SHARE = (0.15, 1.0)  # radius of a rounded edge over half the feature's width, uniform
LARGEST_ROUNDING_MM = 4.0  # largest radius of a rounded edge, mm
ROD_RADIUS_SHARE = (1.0, 3.0)  # radius of curvature over half the width, log-uniform
WEDGE_SLOPE = (0.15, 1.5)  # slope of the sides of a roof, mm per mm, log-uniform
SIDES = (3, 4, 5, 6, 8)  # of a polygon
IRREGULARITY = 0.25  # deviation of the sides' distances over the mean; half are regular

# Serrated bars and half-planes: their share, pitch (log-uniform) and depth of the cuts (uniform).
TEETH_SHARE, TEETH_PITCH_MM, TEETH_DEPTH_MM = 0.13, (0.7, 4.5), (0.2, 1.5)
# Shares of shapes cut by a plane and with a round hole, and the hole's radius (log-uniform).
CUT_SHARE, HOLE_SHARE, HOLE_RADIUS_MM = 0.2, 0.15, (0.5, 6.0)
# Deviations along x and y from the press axis: of the first feature, the others, cuts and holes.
FIRST_OFFSET_MM, OTHERS_OFFSET_MM, CUT_OFFSET_MM = 1.5, 6.0, 3.0
# Share of further features as high as the first; the others are lower by at most this (uniform).
SAME_HEIGHT_SHARE, MAX_LOWER_MM = 0.4, 1.2
PARALLEL_SHARE = 0.4  # share of further features parallel to the first, as ribs and jaws are
TILT_SHARE, MAX_TILT_DEG = 0.35, 3.0  # share of tilted shapes, and their largest tilt (uniform)


@dataclass(frozen=True)
class Feature:
    """One feature, in the shape frame; a bar extends along its own y, a half-plane along its x."""

    outline: str  # bar, half-plane, disc, ring or polygon
    profile: str
    x_mm: float
    y_mm: float
    turn_rad: float
    half_width_mm: float  # or a disc's radius, a polygon's inner one; inf of a half-plane
    half_length_mm: float = 0.0  # of a bar
    radius_mm: float = 0.0  # of the center line of a ring or a bent bar; 0 for a straight bar
    sides: tuple[tuple[float, float], ...] = ()  # a polygon's: directions, rad, and distances, mm
    wall_mm: float = 0.0  # of a hollow polygon; 0 for a full one
    curve: float = 0.0  # radius of a rounded edge or a rod, mm, or slope of a roof
    lower_mm: float = 0.0  # depth of the top below the shape's
    teeth: str = "none"  # or pointed or square
    teeth_pitch_mm: float = 1.0
    teeth_depth_mm: float = 0.0

    @property
    def reach_mm(self) -> float:
        """A distance from its middle beyond which it has no point."""
        if self.outline == "polygon":
            apart = max(distance for _, distance in self.sides)
            return 2.0 * apart / float(np.sin(2.0 * np.pi / len(self.sides)))
        if self.outline == "bar":  # of a bent one the farthest corners are cut
            return float(np.hypot(self.half_length_mm, self.half_width_mm))
        return self.radius_mm + self.half_width_mm


Cut = tuple[float, float]
Hole = tuple[float, float, float]
Composition = tuple[Sequence[Feature], Sequence[Cut], Sequence[Hole], tuple[float, float]]
"""Features of a random shape; planes that cut it, by direction, rad, and distance, mm; holes, by x,
y and radius, mm; slope along x and y, mm per mm."""


def random_shape(seed: int) -> Shape:
    """The random shape of a seed; its solid is made at the first use."""
    (features, _, _, tilt), surface = sample(seed)
    tilt_deg = float(np.degrees(np.arctan(np.hypot(*tilt))))
    return Shape(
        name=f"{RANDOM_PREFIX}{seed}",
        solid=partial(solid_under, surface),
        surface=surface,
        spacing_mm=SPACING_MM,
        parameters={"features": float(len(features)), "tilt_deg": tilt_deg},
        base_mm=-BASE_DEPTH_MM,
        is_under_surface=True,
    )


def sample(seed: int) -> tuple[Composition, HeightMap]:
    """The first composition of the seed with an area near the press axis, and its surface."""
    half = round(REACH_MM / PITCH_MM)
    axis = np.arange(-half - 1, half + 2) * PITCH_MM
    inside = axis[1:-1]
    near = np.abs(inside) <= NEAR_MM
    rng = np.random.default_rng((STREAM, seed))
    for _ in range(MAX_TRIES):
        composition = sample_composition(rng)
        sampled = heights_mm(composition, inside, inside)
        top = sampled.max()
        if top == NOTHING_MM:  # cuts and holes leave nothing of the features
            continue
        high = sampled[np.ix_(near, near)] > top - BASE_DEPTH_MM / 2
        if high.sum() * PITCH_MM**2 >= MIN_AREA_MM2:
            heights = np.full((axis.size, axis.size), NOTHING_MM, np.float32)
            heights[1:-1, 1:-1] = np.maximum(sampled - top, -np.float32(BASE_DEPTH_MM))
            return composition, HeightMap(heights, axis, axis)
    raise AssertionError(f"{RANDOM_PREFIX}{seed}: no composition was found in {MAX_TRIES} tries")


def solid_under(surface: HeightMap) -> tuple[np.ndarray, np.ndarray]:
    """Vertices, mm, and faces of a closed mesh: the surface, two triangles a cell, on a plate."""
    is_solid = surface.heights_mm > NOTHING_MM / 2
    rows, columns = (np.flatnonzero(is_solid.any(axis=axis)) for axis in (1, 0))
    rows, columns = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    heights = surface.heights_mm[rows, columns].astype(float)
    x, y = np.meshgrid(surface.x_mm[columns], surface.y_mm[rows])
    top = np.column_stack([x.ravel(), y.ravel(), heights.ravel()])
    number = np.arange(heights.size).reshape(heights.shape)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    faces = [np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))]
    # the rim, counterclockwise seen from above, and its copy on the plate's underside
    rim = np.concatenate([number[0, :-1], number[:-1, -1], number[-1, :0:-1], number[:0:-1, 0]])
    floor = float(heights.min()) - PLATE_THICKNESS_MM
    below = np.column_stack([top[rim, :2], np.full(rim.size, floor)])
    under = len(top) + np.arange(rim.size)
    on, under_on = np.roll(rim, -1), np.roll(under, -1)
    middle = np.full(rim.size, len(top) + rim.size)
    for triangle in ((rim, under, under_on), (rim, under_on, on), (middle, under_on, under)):
        faces.append(np.column_stack(triangle))
    center = np.array([[*top[:, :2].mean(axis=0), floor]])
    return np.concatenate([top, below, center]), np.concatenate(faces)


def sample_composition(rng: np.random.Generator) -> Composition:
    """Sample the composition of a random shape."""
    count = int(rng.choice(NUMBERS, p=NUMBER_SHARES))
    features: list[Feature] = []
    for _ in range(count):
        features.append(_sample_feature(rng, features[0] if features else None))
    cuts: list[Cut] = []
    holes: list[Hole] = []
    if rng.random() < CUT_SHARE:
        cuts.append((float(rng.uniform(0.0, 2.0 * np.pi)), float(rng.normal(0.0, CUT_OFFSET_MM))))
    if rng.random() < HOLE_SHARE:
        x, y = rng.normal(0.0, CUT_OFFSET_MM, 2)
        holes.append((float(x), float(y), _log_uniform(rng, HOLE_RADIUS_MM)))
    slope, direction = 0.0, float(rng.uniform(0.0, 2.0 * np.pi))
    if rng.random() < TILT_SHARE:
        slope = float(np.tan(np.radians(rng.uniform(0.0, MAX_TILT_DEG))))
    tilt = (slope * float(np.cos(direction)), slope * float(np.sin(direction)))
    return features, cuts, holes, tilt


def _sample_feature(rng: np.random.Generator, first: Feature | None) -> Feature:
    kind = str(rng.choice(list(KINDS), p=[share for share, _ in KINDS.values()]))
    shares = KINDS[kind][1]
    profile = str(rng.choice(list(shares), p=list(shares.values())))
    x, y = rng.normal(0.0, FIRST_OFFSET_MM if first is None else OTHERS_OFFSET_MM, 2)
    turn = float(rng.uniform(0.0, 2.0 * np.pi))
    if first is not None and rng.random() < PARALLEL_SHARE:
        turn = first.turn_rad
    lower = 0.0
    if first is not None and rng.random() >= SAME_HEIGHT_SHARE:
        lower = float(rng.uniform(0.0, MAX_LOWER_MM))
    outline, half_width, sizes = _sample_sizes(rng, kind)
    # Moved such that some part of the feature, as a bar's end, is near (x, y).
    along, cos, sin = float(rng.uniform(-0.9, 0.9)), float(np.cos(turn)), float(np.sin(turn))
    if outline == "ring" and rng.random() < 0.7:
        x, y = x - sizes["radius_mm"] * cos, y - sizes["radius_mm"] * sin
    elif outline == "bar" and "radius_mm" not in sizes:
        shift = along * sizes["half_length_mm"]
        x, y = x + shift * sin, y - shift * cos
    elif outline in ("disc", "polygon") and rng.random() < 0.5:
        shift = along * half_width
        x, y = x - shift * cos, y - shift * sin
    curve, half = 0.0, sizes.get("wall_mm", 2.0 * half_width) / 2.0
    if profile == "rounded" and outline != "half-plane":
        curve = min(half * float(rng.uniform(*ROUNDING_SHARE)), LARGEST_ROUNDING_MM)
    elif profile == "rounded":
        curve = LARGEST_ROUNDING_MM * float(rng.uniform(0.05, 1.0))
    elif profile == "rod":
        curve = half * _log_uniform(rng, ROD_RADIUS_SHARE)
    elif profile == "wedge":
        curve = _log_uniform(rng, WEDGE_SLOPE)
    teeth = "none"
    if kind in ("bar", "bent-bar", "half-plane") and rng.random() < TEETH_SHARE:
        teeth = "pointed" if rng.random() < 0.6 else "square"
    pitch, depth = _log_uniform(rng, TEETH_PITCH_MM), float(rng.uniform(*TEETH_DEPTH_MM))
    return Feature(
        outline, profile, float(x), float(y), turn, half_width, **sizes, curve=curve,
        lower_mm=lower, teeth=teeth, teeth_pitch_mm=pitch, teeth_depth_mm=depth,
    )  # fmt: skip


def _sample_sizes(rng: np.random.Generator, kind: str) -> tuple[str, float, dict[str, Any]]:
    """Sample the outline of a kind, its half width, mm, and its other sizes."""
    if kind == "half-plane":
        return kind, float("inf"), {}
    if kind == "disc":
        return kind, _log_uniform(rng, DISC_RADIUS_MM), {}
    if kind == "ring":
        radius = _log_uniform(rng, RING_RADIUS_MM)
        half_wall = min(_log_uniform(rng, RING_HALF_WALL_MM), 0.8 * radius)
        return kind, half_wall, {"radius_mm": radius}
    if kind in ("polygon", "hollow-polygon"):
        reach = _log_uniform(rng, POLYGON_RADIUS_MM)
        number = int(rng.choice(SIDES))
        spread = IRREGULARITY if rng.random() < 0.5 else 0.0
        apart = reach * np.exp(spread * rng.standard_normal(number))
        angles = 2 * np.pi * np.arange(number) / number
        sizes: dict[str, Any] = {"sides": tuple(zip(angles.tolist(), apart.tolist(), strict=True))}
        if kind == "hollow-polygon" and (wall := _log_uniform(rng, WALL_MM)) < apart.min():
            sizes["wall_mm"] = wall
        return "polygon", float(apart.min()), sizes
    half_width, length = _log_uniform(rng, HALF_WIDTH_MM), _log_uniform(rng, LENGTH_MM)
    sizes = {}
    if kind == "bent-bar":
        sizes["radius_mm"] = max(_log_uniform(rng, BEND_RADIUS_MM), 1.5 * half_width)
    elif kind == "arc":
        sizes["radius_mm"] = max(_log_uniform(rng, ARC_RADIUS_MM), 1.5 * half_width)
        length = sizes["radius_mm"] * float(rng.uniform(*ARC_ANGLE_RAD))
    return "bar", half_width, {"half_length_mm": max(length, 2 * half_width) / 2, **sizes}


def _log_uniform(rng: np.random.Generator, limits: tuple[float, float]) -> float:
    low, high = np.log(limits[0]), np.log(limits[1])
    return float(np.exp(rng.uniform(low, high)))


def heights_mm(composition: Composition, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
    """Heights over two axes of one spacing, (ny, nx) float32, mm; the highest is not yet at 0."""
    heights = np.full((y_mm.size, x_mm.size), NOTHING_MM, np.float32)
    features, cuts, holes, tilt = composition
    for feature in features:
        rows, columns = (
            slice(*np.searchsorted(axis, (middle - feature.reach_mm, middle + feature.reach_mm)))
            for axis, middle in ((y_mm, feature.y_mm), (x_mm, feature.x_mm))
        )
        part, x, y = heights[rows, columns], x_mm[columns], y_mm[rows]
        at, below = _surface(feature, x - feature.x_mm, (y - feature.y_mm)[:, None])
        raised = -below + tilt[0] * x[at[1]] + tilt[1] * y[at[0]]
        part[at] = np.maximum(part[at], raised.astype(np.float32))
    x, y = x_mm, y_mm[:, None]
    for angle, apart in cuts:
        heights[np.cos(angle) * x + np.sin(angle) * y > apart] = NOTHING_MM
    for middle_x, middle_y, radius in holes:
        heights[np.hypot(x - middle_x, y - middle_y) < radius] = NOTHING_MM
    return heights


def _surface(
    feature: Feature, dx: np.ndarray, dy: np.ndarray
) -> tuple[tuple[np.ndarray, ...], np.ndarray]:
    """Rows and columns (n,) of a feature's points, and their depths (n,) below the shape's top, mm.

    dx, dy: (1, nx) and (ny, 1) from the feature's middle.
    """
    cos, sin = np.cos(feature.turn_rad), np.sin(feature.turn_rad)
    u, v = cos * dx + sin * dy, cos * dy - sin * dx
    half_width = feature.wall_mm / 2 or feature.half_width_mm
    radius, curve = feature.radius_mm, feature.curve
    match feature.outline:  # distances inside the outline, of a bar inside its long sides
        case "half-plane":
            sideways = u
        case "polygon":
            sideways = np.full(u.shape, np.inf)
            for angle, apart in feature.sides:
                sideways = np.minimum(sideways, apart - np.cos(angle) * u - np.sin(angle) * v)
            if feature.wall_mm:
                sideways = np.minimum(sideways, feature.wall_mm - sideways)
        case "bar":  # a bent one is bent about a point next to its center
            across = radius - np.hypot(u - radius, v) if radius else u
            sideways = half_width - np.abs(across)
        case _:  # a disc has no radius of a center line
            sideways = half_width - np.abs(np.hypot(u, v) - radius)
    at = np.nonzero(sideways >= 0.0)
    u, v, sideways = u[at], v[at], sideways[at]
    inner = sideways
    if feature.outline == "bar":
        along = radius * np.arctan2(v, radius - u) if radius else v
        inner = np.minimum(sideways, feature.half_length_mm - np.abs(along))
        keep = (inner >= 0.0) & (not radius or np.hypot(u, v) <= feature.reach_mm)
        at, v, sideways, inner = (
            (at[0][keep], at[1][keep]),
            along[keep],
            sideways[keep],
            inner[keep],
        )
    below = np.full(inner.shape, feature.lower_mm)
    if feature.profile == "rounded":
        rest = curve - np.minimum(inner, curve)
        below += np.where(rest > 0.0, curve - np.sqrt(curve * curve - rest * rest), 0.0)
    elif feature.profile == "rod":
        offset = half_width - sideways
        below += curve - np.sqrt(np.maximum(curve * curve - offset * offset, 0.0))
    elif feature.profile == "wedge":
        below += (half_width - sideways) * curve
    if feature.teeth != "none":
        part = v / feature.teeth_pitch_mm % 1.0
        is_pointed = feature.teeth == "pointed"
        below += feature.teeth_depth_mm * (np.abs(2.0 * part - 1.0) if is_pointed else part < 0.5)
    return at, below
