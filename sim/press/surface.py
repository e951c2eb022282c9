"""The pressed surface between the grid's points: the elastic surface, made to fit the shape."""

from functools import lru_cache

import numpy as np

from t2twin.sim.press.elastomer import Elastomer
from t2twin.sim.press.footprint import heights_at
from t2twin.sim.press.grid import grown
from t2twin.sim.press.records import Contact
from t2twin.sim.press.spline import on_lines

NEAR_CELLS = 3
"""Cells of the contact's grid around the touched ones in which the shape is looked up."""


def surface_on(contact: Contact, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
    """The contact's surface deflection on other axes, (y, x) float32, mm.

    Between its grid points the contact's surface is a bicubic spline. Under the shape it lies on
    the shape exactly, so that edges finer than the grid stay sharp: no surface may reach into the
    solid, hence the larger of the two.
    """
    surface = on_lines(contact.surface_mm, contact.y_mm, contact.x_mm, y_mm, x_mm)
    touched = grown(contact.pressure_kpa > 0, NEAR_CELLS)
    near = (
        _between(y_mm, contact.y_mm[touched.any(axis=1)]),
        _between(x_mm, contact.x_mm[touched.any(axis=0)]),
    )
    heights = heights_at(contact.shape.surface, contact.command, x_mm[near[1]], y_mm[near[0]])
    rest = _rest(contact.elastomer, tuple(x_mm), tuple(y_mm))[near]
    standing = contact.shape_depth_mm + rest + heights
    surface[near] = np.maximum(surface[near], standing)
    return surface


def _between(axis_mm: np.ndarray, touched_mm: np.ndarray) -> slice:
    """The part of a rising axis from the first to the last touched place."""
    if not touched_mm.size:
        return slice(0, 0)
    first, last = np.searchsorted(axis_mm, touched_mm[[0, -1]])
    return slice(int(first), int(last))


@lru_cache(maxsize=8)
def _rest(elastomer: Elastomer, x_mm: tuple[float, ...], y_mm: tuple[float, ...]) -> np.ndarray:
    return elastomer.rest_surface_mm(*np.meshgrid(x_mm, y_mm))
