"""Plausible deflections of the gel in closed form, for calibrating and testing the optics alone.

The press engine gives the real ones; these need no contact solver.
"""

import numpy as np

from t2twin.sim.digit.camera.pinhole import optical_grid

SKIRT_MM = 0.6
"""Length over which the gel rises again beside a shape, mm (assumed: a fraction of its layer)."""
BALL_HOLD = 0.8
"""Part of a ball's contact radius inside which the gel follows the ball exactly (assumed; the
gel leaves it where the skirt takes over with the same slope)."""
BALL_SKIRT = 1.0
"""Length of that skirt over the one of equal slope (assumed)."""


def ball(
    x_mm: float,
    y_mm: float,
    depth_mm: float,
    radius_mm: float = 2.35,
    hold: float = BALL_HOLD,
    skirt: float = BALL_SKIRT,
) -> np.ndarray:
    """Deflection, mm, on optical_grid() under a ball pressed depth_mm deep.

    The ball's own profile within hold of the contact, and an exponential skirt outside, skirt
    times as long as one of equal slope.
    """
    x, y = np.meshgrid(*optical_grid())
    distance = np.hypot(x - x_mm, y - y_mm)
    chord = np.sqrt(radius_mm**2 - max(radius_mm - depth_mm, 0.0) ** 2)
    held_mm = hold * chord
    height = np.sqrt(radius_mm**2 - held_mm**2)
    edge_mm = depth_mm - radius_mm + height
    skirt_mm = skirt * edge_mm * height / held_mm
    under = depth_mm - radius_mm + np.sqrt(np.maximum(radius_mm**2 - distance**2, 0.0))
    beside = edge_mm * np.exp(-np.maximum(distance - held_mm, 0.0) / skirt_mm)
    return np.where(distance < held_mm, under, beside)


def block(
    x_mm: float,
    y_mm: float,
    depth_mm: float,
    width_mm: float,
    length_mm: float,
    yaw_rad: float = 0.0,
) -> np.ndarray:
    """The same under a flat rectangle, width along x and length along y at yaw 0."""
    x, y = np.meshgrid(*optical_grid())
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    along = (x - x_mm) * cos + (y - y_mm) * sin
    across = (y - y_mm) * cos - (x - x_mm) * sin
    beyond = np.stack([np.abs(along) - width_mm / 2, np.abs(across) - length_mm / 2])
    return _flat(np.hypot(*np.maximum(beyond, 0.0)), depth_mm)


def ring(x_mm: float, y_mm: float, depth_mm: float, inner_mm: float, outer_mm: float) -> np.ndarray:
    """The same under a flat ring of the given inner and outer radius."""
    x, y = np.meshgrid(*optical_grid())
    distance = np.hypot(x - x_mm, y - y_mm)
    away = np.maximum(np.maximum(inner_mm - distance, distance - outer_mm), 0.0)
    return _flat(away, depth_mm)


def _flat(away_mm: np.ndarray, depth_mm: float) -> np.ndarray:
    return depth_mm * np.exp(-away_mm / SKIRT_MM)
