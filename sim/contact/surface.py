"""The pressed surface between the grid's points: the elastic surface, made to fit the shape."""

from functools import lru_cache

import numpy as np

from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.footprint import raise_to_shape
from t2twin.sim.contact.grid import grown
from t2twin.sim.contact.splines import on_lines
from t2twin.sim.contact.types import Contact

NEAR_CELLS = 3
"""Cells of the contact's grid around the touched ones in which the shape is looked up."""


def surface_on(contact: Contact, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
    """The contact's surface deflection on other axes, (y, x) float32, mm.

    Between its grid points the contact's surface is a bicubic spline. Under the shape it lies on
    the shape exactly, so that edges finer than the grid stay sharp: no surface may reach into the
    solid, hence the larger of the two.
    """
    surface = on_lines(contact.surface_mm, contact.y_mm, contact.x_mm, y_mm, x_mm)
    axes = x_mm.tobytes(), y_mm.tobytes()
    near = (
        grown(contact.pressure_kpa > 0, NEAR_CELLS),
        _nearest(contact.y_mm.tobytes(), axes[1]),
        _nearest(contact.x_mm.tobytes(), axes[0]),
    )
    apex = _rest(contact.elastomer, *axes) + np.float32(contact.shape_depth_mm)
    raise_to_shape(surface, contact.shape.surface, contact.command, x_mm, y_mm, apex, near)
    return surface


@lru_cache(maxsize=8)
def _nearest(places: bytes, between: bytes) -> np.ndarray:
    """(n,) int64 the nearest of equally spaced places to each of others; both float64."""
    at = np.frombuffer(places)
    steps = np.rint((np.frombuffer(between) - at[0]) / (at[1] - at[0]))
    return np.clip(steps, 0, at.size - 1).astype(np.int64)


@lru_cache(maxsize=8)
def _rest(elastomer: Elastomer, x_mm: bytes, y_mm: bytes) -> np.ndarray:
    """(y, x) float32 untouched surface over axes of float64, mm."""
    x, y = np.meshgrid(np.frombuffer(x_mm), np.frombuffer(y_mm))
    return elastomer.rest_surface_mm(x, y).astype(np.float32)
