"""Shapes given by a formula, where the pressing surface must be known exactly."""

from collections.abc import Callable

import numpy as np
import trimesh

from t2twin.primitives_cad.shape import NOTHING_MM, HeightMap, Shape

REACH_MM = 14.0
PITCH_MM = 0.05


def formula(
    heights: Callable[[np.ndarray, np.ndarray], np.ndarray],
    name: str = "formula",
    pitch_mm: float = PITCH_MM,
    reach_mm: float = REACH_MM,
) -> Shape:
    """A shape whose pressing surface is heights(x, y), mm, <= 0; its mesh is not used."""
    axis = np.linspace(-reach_mm, reach_mm, round(2 * reach_mm / pitch_mm) + 1)
    surface = heights(*np.meshgrid(axis, axis)).astype(np.float32)
    return Shape(name, trimesh.Trimesh(), HeightMap(surface, axis, axis), spacing_mm=(1.4, 1.4))


def block(width_mm: float, length_mm: float) -> Shape:
    return formula(
        lambda x, y: np.where(
            (np.abs(x) <= width_mm / 2) & (np.abs(y) <= length_mm / 2), 0.0, NOTHING_MM
        ),
        f"block of {width_mm:g} x {length_mm:g} mm",
    )


def punch(radius_mm: float) -> Shape:
    return formula(
        lambda x, y: np.where(np.hypot(x, y) <= radius_mm, 0.0, NOTHING_MM),
        f"punch of {radius_mm:g} mm",
    )
