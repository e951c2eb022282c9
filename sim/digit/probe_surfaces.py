"""Approximate deflections of the gel in closed form, for calibrating and testing the optics.

They need no contact solver.
"""

import numpy as np

from t2twin.sim.digit.camera.pinhole import optical_grid

SKIRT_MM = 0.6
"""Decay length of the deflection outside a shape, mm (assumed: a fraction of the layer)."""
BALL_HOLD = 0.8
"""Fraction of a ball's contact radius inside which the gel follows the ball (assumed); the skirt
starts there with the same slope."""
BALL_SKIRT = 1.0
"""Length of the skirt, in parts of the one of equal slope (assumed)."""


def ball(
    x_mm: float,
    y_mm: float,
    depth_mm: float,
    radius_mm: float = 2.35,
    hold: float = BALL_HOLD,
    skirt: float = BALL_SKIRT,
) -> np.ndarray:
    """Deflection by a ball pressed depth_mm deep, mm, on optical_grid().

    The ball's profile within hold times the contact radius, and an exponential skirt outside,
    skirt times as long as one of equal slope.
    """
    x, y = np.meshgrid(*optical_grid())
    distance = np.hypot(x - x_mm, y - y_mm)
    chord = np.sqrt(radius_mm**2 - max(radius_mm - depth_mm, 0.0) ** 2)
    held_mm = hold * chord
    height = np.sqrt(radius_mm**2 - held_mm**2)
    edge_mm = depth_mm - radius_mm + height
    skirt_mm = skirt * edge_mm * height / held_mm
    inside = depth_mm - radius_mm + np.sqrt(np.maximum(radius_mm**2 - distance**2, 0.0))
    outside = edge_mm * np.exp(-np.maximum(distance - held_mm, 0.0) / skirt_mm)
    return np.where(distance < held_mm, inside, outside)


def block(
    x_mm: float,
    y_mm: float,
    depth_mm: float,
    width_mm: float,
    length_mm: float,
    yaw_rad: float = 0.0,
) -> np.ndarray:
    """The same by a flat rectangle, width along x and length along y at yaw 0."""
    x, y = np.meshgrid(*optical_grid())
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    along = (x - x_mm) * cos + (y - y_mm) * sin
    across = (y - y_mm) * cos - (x - x_mm) * sin
    beyond = np.stack([np.abs(along) - width_mm / 2, np.abs(across) - length_mm / 2])
    return _flat(np.hypot(*np.maximum(beyond, 0.0)), depth_mm)


def ring(x_mm: float, y_mm: float, depth_mm: float, inner_mm: float, outer_mm: float) -> np.ndarray:
    """The same by a flat ring with these inner and outer radii."""
    x, y = np.meshgrid(*optical_grid())
    distance = np.hypot(x - x_mm, y - y_mm)
    outside = np.maximum(np.maximum(inner_mm - distance, distance - outer_mm), 0.0)
    return _flat(outside, depth_mm)


def _flat(distance_mm: np.ndarray, depth_mm: float) -> np.ndarray:
    return depth_mm * np.exp(-distance_mm / SKIRT_MM)
