"""Surfaces of the gel for images: of a contact, and of a pressed ball in closed form."""

from functools import lru_cache

import numpy as np

from t2twin.core.jit import compiled
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.grid import dilated
from t2twin.sim.contact.heights import raise_to_shape
from t2twin.sim.contact.types import Contact
from t2twin.sim.optical.camera import optical_grid
from t2twin.sim.optical.compiled import at_place
from t2twin.sim.splines import on_lines

NEAR_CELLS = 3  # cells around the loaded ones in which `surface_on` samples the shape

BACKWARD_STEPS, BACKWARD_MM = 40, 1e-4
"""Limit on the fixed-point steps to the place from which a point of the surface has come, and the
change, mm, at which they end. They are half steps where full steps do not halve the change. Behind
a shape that has slid far the surface is stretched to twice its length, where full steps oscillate.
"""

BALL_HOLD = 0.8
"""Fraction of a ball's contact radius inside which the gel follows the ball (assumed); the skirt
starts there with the same slope."""
BALL_SKIRT = 1.0  # length of the skirt, in parts of the one of equal slope (assumed)


def surface_on(contact: Contact, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
    """A contact's surface deflection on other axes, (y, x) float32, mm.

    Between the contact's grid points the surface is a bicubic spline. Under the shape it is raised
    to the shape, which no surface may penetrate, so that edges finer than the grid stay sharp. The
    surface of a contact that has moved is lowered and displaced by the shear.
    """
    surface = on_lines(contact.surface_mm, contact.y_mm, contact.x_mm, y_mm, x_mm)
    axes = x_mm.tobytes(), y_mm.tobytes()
    near = (
        dilated(contact.pressure_kpa > 0, NEAR_CELLS),
        _nearest_cells(contact.y_mm.tobytes(), axes[1]),
        _nearest_cells(contact.x_mm.tobytes(), axes[0]),
    )
    apex = _rest_surface(contact.elastomer, *axes) + np.float32(contact.shape_depth_mm)
    shape = contact.command.tilted(contact.shape).surface
    raise_to_shape(surface, shape, contact.command, x_mm, y_mm, apex, near, contact.shift)
    if contact.motion is None:
        return surface
    sheared = np.ascontiguousarray(contact.sheared_mm, np.float32)
    came = np.empty_like(sheared)
    _displacement_at_arrival(sheared, contact.pitch_mm, came)
    moved = np.empty_like(surface)
    coarse = float(contact.x_mm[0]), float(contact.y_mm[0]), contact.pitch_mm
    _resample(surface, came, *coarse, x_mm, y_mm, moved)
    return moved


@compiled(nogil=True)
def _displacement_at_arrival(sheared, pitch, came):
    """Write the displacement along x, along y and into the sensor, mm, of the points that have come
    to each grid point."""
    for i in range(sheared.shape[1]):
        for j in range(sheared.shape[2]):
            x, y = np.float64(sheared[0, i, j]), np.float64(sheared[1, i, j])
            share, last = 1.0, np.inf
            for _ in range(BACKWARD_STEPS):
                row, column = i - y / pitch, j - x / pitch
                dx = share * (at_place(sheared[0], row, column) - x)
                dy = share * (at_place(sheared[1], row, column) - y)
                x, y = x + dx, y + dy
                change = abs(dx) + abs(dy)
                if change < BACKWARD_MM:
                    break
                if change > last / 2:
                    share = 0.5
                last = change
            came[0, i, j], came[1, i, j] = x, y
            came[2, i, j] = at_place(sheared[2], i - y / pitch, j - x / pitch)


@compiled(nogil=True)
def _resample(surface, came, first_x, first_y, pitch, x_mm, y_mm, moved):
    """Write the surface, lowered by the shear, where its points have come from. came: (3, rows,
    columns) their displacement, on the grid of the contact."""
    per_mm, last = np.float32(1.0 / (x_mm[1] - x_mm[0])), came.shape[2] - 1
    first, across = np.empty(x_mm.size, np.int64), np.empty(x_mm.size, np.float32)
    for j in range(x_mm.size):
        column = min(max((x_mm[j] - first_x) / pitch, 0.0), float(last))
        first[j] = min(int(column), last - 1)
        across[j] = column - first[j]
    line = np.empty((3, came.shape[2]), np.float32)
    for i in range(y_mm.size):
        row = min(max((y_mm[i] - first_y) / pitch, 0.0), came.shape[1] - 1.0)
        above = min(int(row), came.shape[1] - 2)
        down = np.float32(row - above)
        for k in range(3):
            for n in range(came.shape[2]):
                upper = came[k, above, n]
                line[k, n] = upper + down * (came[k, above + 1, n] - upper)
        for j in range(x_mm.size):
            n, share = first[j], across[j]
            x = line[0, n] + share * (line[0, n + 1] - line[0, n])
            y = line[1, n] + share * (line[1, n + 1] - line[1, n])
            into = line[2, n] + share * (line[2, n + 1] - line[2, n])
            moved[i, j] = at_place(surface, i - y * per_mm, j - x * per_mm) + into


@lru_cache(maxsize=8)
def _nearest_cells(centers: bytes, places: bytes) -> np.ndarray:
    """(n,) int64 index of the nearest of equally spaced centers to each place; both float64."""
    at = np.frombuffer(centers)
    steps = np.rint((np.frombuffer(places) - at[0]) / (at[1] - at[0]))
    return np.clip(steps, 0, at.size - 1).astype(np.int64)


@lru_cache(maxsize=8)
def _rest_surface(elastomer: Elastomer, x_mm: bytes, y_mm: bytes) -> np.ndarray:
    """(y, x) float32 undeformed surface over axes of float64, mm."""
    x, y = np.meshgrid(np.frombuffer(x_mm), np.frombuffer(y_mm))
    return elastomer.rest_surface_mm(x, y).astype(np.float32)


def ball_surface(
    gel: Elastomer, x_mm: float, y_mm: float, depth_mm: float, radius_mm: float = 2.35, hold: float
    = BALL_HOLD, skirt: float = BALL_SKIRT,
) -> np.ndarray:  # fmt: skip
    """Approximate deflection by a ball pressed depth_mm deep, mm, on optical_grid(gel).

    The ball's profile within hold times the contact radius, and an exponential skirt outside,
    skirt times as long as one of equal slope.
    """
    x, y = np.meshgrid(*optical_grid(gel))
    distance = np.hypot(x - x_mm, y - y_mm)
    chord = np.sqrt(radius_mm**2 - max(radius_mm - depth_mm, 0.0) ** 2)
    held_mm = hold * chord
    height = np.sqrt(radius_mm**2 - held_mm**2)
    edge_mm = depth_mm - radius_mm + height
    skirt_mm = skirt * edge_mm * height / held_mm
    inside = depth_mm - radius_mm + np.sqrt(np.maximum(radius_mm**2 - distance**2, 0.0))
    outside = edge_mm * np.exp(-np.maximum(distance - held_mm, 0.0) / skirt_mm)
    return np.where(distance < held_mm, inside, outside)
