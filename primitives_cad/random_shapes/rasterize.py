"""Rasterizes the heights of a composition on a grid of points.

The profile of a feature is a function of the distance of a point from the outline. The height of
the composition is the maximum over its features.
"""

import numpy as np

from t2twin.core.jit import compiled
from t2twin.primitives_cad.random_shapes.features import Composition, Feature
from t2twin.primitives_cad.shape import NOTHING_MM

OUTLINES = ("bar", "half-plane", "disc", "ring", "polygon")
PROFILES = ("flat", "rounded", "rod", "wedge")
TEETH = ("none", "pointed", "square")
_BAR, _HALF_PLANE, _DISC, _RING, _POLYGON = range(5)
_, _ROUNDED, _ROD, _WEDGE = range(4)
_POINTED = 1

MAX_SIDES = 8


def heights_mm(composition: Composition, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
    """Heights over the points of two axes, (ny, nx) float32, mm; NOTHING_MM without a feature.

    x_mm, y_mm: rising, with the same spacing. The highest point is not yet at 0.
    """
    features = composition.features
    values = np.array([_values(feature) for feature in features])
    sides = np.full((len(features), MAX_SIDES, 3), np.nan)
    for n, feature in enumerate(features):
        for k, (angle, apart) in enumerate(feature.sides):
            sides[n, k] = np.cos(angle), np.sin(angle), apart
    cuts = [(np.cos(angle), np.sin(angle), apart) for angle, apart in composition.cuts]
    heights = np.full((y_mm.size, x_mm.size), NOTHING_MM, np.float32)
    _rasterize(
        values,
        sides,
        np.array(cuts, dtype=float).reshape(-1, 3),
        np.array(composition.holes, dtype=float).reshape(-1, 3),
        *composition.tilt,
        x_mm,
        y_mm,
        heights,
    )
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
        OUTLINES.index(feature.outline),
        PROFILES.index(feature.profile),
        feature.x_mm,
        feature.y_mm,
        float(np.cos(feature.turn_rad)),
        float(np.sin(feature.turn_rad)),
        half_width,
        feature.half_length_mm,
        feature.radius_mm,
        feature.wall_mm,
        feature.curve,
        feature.lower_mm,
        TEETH.index(feature.teeth),
        feature.teeth_pitch_mm,
        feature.teeth_depth_mm,
        reach,
    )


@compiled(inline="always")
def _inner(outline, u, v, half_width, half_length, radius, wall, sides):
    """Distances of a point of the feature's frame inside the outline and inside the long sides, and
    its position along the feature, mm."""
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
