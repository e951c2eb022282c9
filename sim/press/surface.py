"""The pressed surface between the grid's points: the elastic surface, made to fit the shape."""

import numpy as np
from scipy.interpolate import RectBivariateSpline

from primitives_cad.shape import Shape
from sim.press.elastomer import Elastomer
from sim.press.footprint import heights_at
from sim.records import Contact, Press


def surface_on(
    contact: Contact,
    shape: Shape,
    command: Press,
    elastomer: Elastomer,
    x_mm: np.ndarray,
    y_mm: np.ndarray,
) -> np.ndarray:
    """The contact's surface deflection on other axes, (y, x) float32, mm.

    Between its grid points the contact's surface is a bicubic spline. Under the shape it lies on
    the shape exactly, so that edges finer than the grid stay sharp: no surface may reach into the
    solid, hence the larger of the two.
    """
    spline = RectBivariateSpline(contact.y_mm, contact.x_mm, contact.surface_mm)
    inside_y = np.clip(y_mm, contact.y_mm[0], contact.y_mm[-1])
    inside_x = np.clip(x_mm, contact.x_mm[0], contact.x_mm[-1])
    elastic = spline(inside_y, inside_x)
    rest = elastomer.rest_surface_mm(*np.meshgrid(x_mm, y_mm))
    standing = contact.shape_depth_mm + rest + heights_at(shape.surface, command, x_mm, y_mm)
    return np.maximum(elastic, standing).astype(np.float32)
