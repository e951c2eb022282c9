"""Random shapes: compositions of one to four features, sampled from a seed.

All distributions are assumed. They cover the edges, faces, ends, ribs and tips of everyday objects
from 0.5 mm to beyond both sensors. The height of a composition is the maximum over its features.
"""

from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal, cast, get_args

import numpy as np

from t2twin.core.jit import compiled
from t2twin.primitives_cad.height_map import REACH_MM
from t2twin.primitives_cad.primitive_parameters import PLATE_THICKNESS_MM
from t2twin.primitives_cad.shape import NOTHING_MM, RANDOM_PREFIX, HeightMap, Shape

# of the height map (assumed: two pixels of a DIGIT, a fifth of the narrowest feature)
PITCH_MM = 0.1
# below the highest point (assumed: more than a press, a tilt and a lower feature)
BASE_DEPTH_MM = 8.0
SPACING_MM = (1.5, 1.5)  # of the protocol's grid, as on the tools (Grella et al. 2023)
STREAM = 1_701  # separates these random numbers from others with the same seed
MAX_TRIES = 100  # compositions sampled until one can be pressed; about one in sixty cannot
MIN_AREA_MM2 = 0.1  # least area of a shape's features near the press axis, mm2
NEAR_MM = 6.0  # largest distance of that area from the press axis along x and y, mm

Outline = Literal["bar", "half-plane", "disc", "ring", "polygon"]
Profile = Literal["flat", "rounded", "rod", "wedge"]
Teeth = Literal["none", "pointed", "square"]

NUMBERS, NUMBER_SHARES = (1, 2, 3, 4), (0.38, 0.34, 0.18, 0.1)  # of features
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

# Names by the numbers with which the compiled loops know them.
OUTLINES, PROFILES, TEETH = get_args(Outline), get_args(Profile), get_args(Teeth)
_BAR, _HALF_PLANE, _DISC, _RING, _POLYGON = range(5)
_, _ROUNDED, _ROD, _WEDGE = range(4)
_POINTED = 1

MAX_SIDES = 8


@dataclass(frozen=True)
class Feature:
    """One feature, in the shape frame; a bar extends along its own y, a half-plane along its x."""

    outline: Outline
    profile: Profile
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
    teeth: Teeth = "none"
    teeth_pitch_mm: float = 1.0
    teeth_depth_mm: float = 0.0


@dataclass(frozen=True)
class Composition:
    """What a random shape consists of."""

    features: tuple[Feature, ...]
    cuts: tuple[tuple[float, float], ...]  # planes' directions, rad, and distances, mm
    holes: tuple[tuple[float, float, float], ...]  # x, y and radius, mm
    tilt: tuple[float, float]  # slope along x and y, mm per mm


def random_shape(seed: int) -> Shape:
    """The random shape of a seed; its solid is made at the first use."""
    composition, surface = sample(seed)
    tilt_deg = float(np.degrees(np.arctan(np.hypot(*composition.tilt))))
    return Shape(
        name=f"{RANDOM_PREFIX}{seed}",
        solid=partial(solid_under, surface),
        surface=surface,
        spacing_mm=SPACING_MM,
        parameters={"features": float(len(composition.features)), "tilt_deg": tilt_deg},
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
    profile = str(rng.choice(list(shares), p=list(shares.values())))
    x, y = rng.normal(0.0, FIRST_OFFSET_MM if first is None else OTHERS_OFFSET_MM, 2)
    turn = _turn(rng)
    if first is not None and rng.random() < PARALLEL_SHARE:
        turn = first.turn_rad
    lower = 0.0
    if first is not None and rng.random() >= SAME_HEIGHT_SHARE:
        lower = float(rng.uniform(0.0, MAX_LOWER_MM))
    feature = _sample_sizes(rng, kind, profile)
    x, y = _sample_position(rng, feature, float(x), float(y), turn)
    curve = _sample_curve(rng, profile, feature.wall_mm / 2 or feature.half_width_mm)
    teeth: Teeth = "none"
    if kind in ("bar", "bent-bar", "half-plane") and rng.random() < TEETH_SHARE:
        teeth = "pointed" if rng.random() < 0.6 else "square"
    pitch_mm, depth_mm = _log_uniform(rng, TEETH_PITCH_MM), float(rng.uniform(*TEETH_DEPTH_MM))
    return replace(
        feature, x_mm=x, y_mm=y, turn_rad=turn, curve=curve, lower_mm=lower,
        teeth=teeth, teeth_pitch_mm=pitch_mm, teeth_depth_mm=depth_mm,
    )  # fmt: skip


def _sample_sizes(rng: np.random.Generator, kind: str, profile: str) -> Feature:
    """Sample the sizes of a feature of a kind, at the origin."""

    def sized(outline: Outline, half_width_mm: float, **sizes: Any) -> Feature:
        return Feature(outline, cast(Profile, profile), 0.0, 0.0, 0.0, half_width_mm, **sizes)

    if kind == "half-plane":
        return sized("half-plane", float("inf"))
    if kind == "disc":
        return sized("disc", _log_uniform(rng, DISC_RADIUS_MM))
    if kind == "ring":
        radius = _log_uniform(rng, RING_RADIUS_MM)
        wall = min(_log_uniform(rng, RING_HALF_WALL_MM), 0.8 * radius)
        return sized("ring", wall, radius_mm=radius)
    if kind in ("polygon", "hollow-polygon"):
        reach = _log_uniform(rng, POLYGON_RADIUS_MM)
        number = int(rng.choice(SIDES))
        spread = IRREGULARITY if rng.random() < 0.5 else 0.0
        apart = reach * np.exp(spread * rng.standard_normal(number))
        angles = 2 * np.pi * np.arange(number) / number
        sides = tuple((float(a), float(d)) for a, d in zip(angles, apart, strict=True))
        wall = _log_uniform(rng, WALL_MM) if kind == "hollow-polygon" else 0.0
        nearest = float(apart.min())
        return sized("polygon", nearest, sides=sides, wall_mm=0.0 if wall >= nearest else wall)
    half_width = _log_uniform(rng, HALF_WIDTH_MM)
    radius, length = 0.0, _log_uniform(rng, LENGTH_MM)
    if kind == "bent-bar":
        radius = max(_log_uniform(rng, BEND_RADIUS_MM), 1.5 * half_width)
    elif kind == "arc":
        radius = max(_log_uniform(rng, ARC_RADIUS_MM), 1.5 * half_width)
        length = radius * float(rng.uniform(*ARC_ANGLE_RAD))
    half_length = max(length, 2 * half_width) / 2
    return sized("bar", half_width, half_length_mm=half_length, radius_mm=radius)


def _sample_position(
    rng: np.random.Generator, feature: Feature, x: float, y: float, turn: float
) -> tuple[float, float]:
    """Sample a position of a feature such that some part of it, as a bar's end, is near (x, y)."""
    along = float(rng.uniform(-0.9, 0.9))
    if feature.outline == "ring" and rng.random() < 0.7:
        return x - feature.radius_mm * np.cos(turn), y - feature.radius_mm * np.sin(turn)
    if feature.outline == "bar" and feature.radius_mm == 0.0:
        shift = along * feature.half_length_mm
        return x - shift * -np.sin(turn), y - shift * np.cos(turn)
    if feature.outline in ("disc", "polygon") and rng.random() < 0.5:
        shift = along * feature.half_width_mm
        return x - shift * np.cos(turn), y - shift * np.sin(turn)
    return x, y


def _sample_curve(rng: np.random.Generator, profile: str, half_width: float) -> float:
    """Sample the radius of a rounded edge or a rod, mm, or the slope of a roof."""
    if profile == "rounded" and np.isfinite(half_width):
        return min(half_width * float(rng.uniform(*ROUNDING_SHARE)), LARGEST_ROUNDING_MM)
    if profile == "rounded":
        return LARGEST_ROUNDING_MM * float(rng.uniform(0.05, 1.0))
    if profile == "rod":
        return half_width * _log_uniform(rng, ROD_RADIUS_SHARE)
    return _log_uniform(rng, WEDGE_SLOPE) if profile == "wedge" else 0.0


def _turn(rng: np.random.Generator) -> float:
    return float(rng.uniform(0.0, 2.0 * np.pi))


def _log_uniform(rng: np.random.Generator, limits: tuple[float, float]) -> float:
    low, high = np.log(limits[0]), np.log(limits[1])
    return float(np.exp(rng.uniform(low, high)))


def heights_mm(composition: Composition, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
    """Heights over two axes of one spacing, (ny, nx) float32, mm; the highest is not yet at 0."""
    features = composition.features
    values = np.array([_values(feature) for feature in features])
    sides = np.full((len(features), MAX_SIDES, 3), np.nan)
    for n, feature in enumerate(features):
        for k, (angle, apart) in enumerate(feature.sides):
            sides[n, k] = np.cos(angle), np.sin(angle), apart
    cuts = [(np.cos(angle), np.sin(angle), apart) for angle, apart in composition.cuts]
    heights = np.full((y_mm.size, x_mm.size), NOTHING_MM, np.float32)
    removed = (np.array(each, float).reshape(-1, 3) for each in (cuts, composition.holes))
    _rasterize(values, sides, *removed, *composition.tilt, x_mm, y_mm, heights)
    return heights


def _values(feature: Feature) -> tuple[float, ...]:
    """The numbers that represent a feature, in the order of `_rasterize`."""
    half_width = min(feature.half_width_mm, 1e6)
    if feature.outline == "polygon":
        # the farthest point at which neighboring sides meet
        angles, one = np.array(feature.sides).T
        turn, other = np.diff(angles, append=angles[0] + 2 * np.pi), np.roll(one, -1)
        square = (one**2 + other**2 - 2 * one * other * np.cos(turn)) / np.sin(turn) ** 2
        reach = 1.001 * float(np.sqrt(square.max()))
        half_width = feature.wall_mm / 2 if feature.wall_mm else half_width
    elif feature.outline == "bar":
        reach = float(np.hypot(feature.half_length_mm, feature.half_width_mm))
    else:
        reach = feature.radius_mm + half_width
    return (
        OUTLINES.index(feature.outline), PROFILES.index(feature.profile),
        feature.x_mm, feature.y_mm, np.cos(feature.turn_rad), np.sin(feature.turn_rad),
        half_width, feature.half_length_mm, feature.radius_mm,
        feature.wall_mm, feature.curve, feature.lower_mm,
        TEETH.index(feature.teeth), feature.teeth_pitch_mm, feature.teeth_depth_mm, reach,
    )  # fmt: skip


@compiled(inline="always")
def _inner(outline, u, v, half_width, half_length, radius, wall, sides):
    """Distances of a point inside the outline and the long sides; its place along the feature."""
    if outline == _HALF_PLANE:
        return u, u, v
    if outline == _DISC:
        inner = half_width - np.hypot(u, v)
        return inner, inner, 0.0
    if outline == _RING:
        inner = half_width - abs(np.hypot(u, v) - radius)
        return inner, inner, 0.0
    if outline == _POLYGON:
        inner = np.inf
        for k in range(sides.shape[0]):
            if np.isnan(sides[k, 2]):
                break
            inner = min(inner, sides[k, 2] - sides[k, 0] * u - sides[k, 1] * v)
        if wall > 0.0:
            inner = min(inner, wall - inner)
        return inner, inner, 0.0
    across, along = u, v
    if radius > 0.0:
        # bent about a point next to its center
        far = np.hypot(u - radius, v)
        if abs(far - radius) >= half_width:
            return -1.0, -1.0, 0.0
        across, along = radius - far, radius * np.arctan2(v, radius - u)
    sideways = half_width - abs(across)
    return min(sideways, half_length - abs(along)), sideways, along


@compiled(inline="always")
def _profile(profile, inner, sideways, half_width, curve):
    """Depth of a feature's surface below its top at a point, mm."""
    if profile == _ROUNDED and inner < curve:
        rest = curve - inner
        return curve - np.sqrt(curve * curve - rest * rest)
    if profile == _ROD:
        offset = half_width - sideways
        return curve - np.sqrt(max(curve * curve - offset * offset, 0.0))
    if profile == _WEDGE:
        return (half_width - sideways) * curve
    return 0.0


@compiled(inline="always")
def _toothed(teeth, along, pitch, depth):
    """Depth of the teeth at a position along a feature, mm."""
    part = along / pitch - np.floor(along / pitch)
    if teeth == _POINTED:
        return depth * abs(2.0 * part - 1.0)
    return depth if part < 0.5 else 0.0


@compiled(inline="always")
def _is_left(x, y, cuts, holes):
    """Whether no cut and no hole removes a point."""
    for n in range(cuts.shape[0]):
        if cuts[n, 0] * x + cuts[n, 1] * y > cuts[n, 2]:
            return False
    for n in range(holes.shape[0]):
        if np.hypot(x - holes[n, 0], y - holes[n, 1]) < holes[n, 2]:
            return False
    return True


@compiled(
    "void(f8[:, ::1], f8[:, :, ::1], f8[:, ::1], f8[:, ::1], f8, f8, f8[::1], f8[::1], f4[:, ::1])",
    nogil=True,
)
def _rasterize(values, sides, cuts, holes, tilt_x, tilt_y, x_mm, y_mm, heights):
    """Raise heights, (ny, nx), to all features."""
    pitch = x_mm[1] - x_mm[0]
    for n in range(values.shape[0]):
        outline, profile = int(values[n, 0]), int(values[n, 1])
        middle_x, middle_y, cos, sin = values[n, 2], values[n, 3], values[n, 4], values[n, 5]
        half_width, half_length, radius = values[n, 6], values[n, 7], values[n, 8]
        wall, curve, lower = values[n, 9], values[n, 10], values[n, 11]
        teeth, tooth_pitch, tooth_depth = int(values[n, 12]), values[n, 13], values[n, 14]
        reach = values[n, 15]
        for i in range(y_mm.size):
            dy = y_mm[i] - middle_y
            if abs(dy) > reach:
                continue
            half = np.sqrt(reach * reach - dy * dy)
            first = max(int(np.ceil((middle_x - half - x_mm[0]) / pitch)), 0)
            last = min(int(np.floor((middle_x + half - x_mm[0]) / pitch)), x_mm.size - 1)
            if outline == _BAR and radius == 0.0 and abs(cos) > 1e-9:
                # only the part of the row between the long sides
                at, wide = sin * dy / cos, half_width / abs(cos)
                first = max(first, int(np.ceil((middle_x - at - wide - x_mm[0]) / pitch)))
                last = min(last, int(np.floor((middle_x - at + wide - x_mm[0]) / pitch)))
            for j in range(first, last + 1):
                dx = x_mm[j] - middle_x
                u, v = cos * dx + sin * dy, cos * dy - sin * dx
                inner, sideways, along = _inner(
                    outline, u, v, half_width, half_length, radius, wall, sides[n]
                )
                if inner < 0.0:
                    continue
                below = lower + _profile(profile, inner, sideways, half_width, curve)
                if teeth:
                    below += _toothed(teeth, along, tooth_pitch, tooth_depth)
                height = np.float32(-below + tilt_x * x_mm[j] + tilt_y * y_mm[i])
                if height > heights[i, j] and _is_left(x_mm[j], y_mm[i], cuts, holes):
                    heights[i, j] = height
