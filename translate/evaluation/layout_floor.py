"""What another layout's tactile images cannot say of a layout's taxels.

Shape letters: N taxels of the new layout, M taxels of the trained one.
"""

import numpy as np

from t2twin.translate.data.pairs import DataInfo
from t2twin.translate.phi import barycentric

LAYOUT_FLOOR = "layout-floor"
"""The row's name among the models."""

OUTSIDE_PARTS = 0.01
"""How far a taxel may lie outside its triangle of trained taxels, in barycentric parts (assumed):
what layouts.OUTSIDE_MM is of a triangle 1 mm high."""


def seen_through(trained: DataInfo, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
    """The part of a new layout's counts that the trained layout's tactile images can hold.

    x_mm, y_mm: (N,) taxels inside the trained layout's hull, mm. Returns (N, N): times true counts
    it is the nearest, by least squares, that the interpolation of any M trained taxels takes at
    the new ones.
    """
    points = np.column_stack([trained.x_mm, trained.y_mm])
    weights = barycentric(points, np.column_stack([x_mm, y_mm]), OUTSIDE_PARTS).toarray()
    return weights @ np.linalg.pinv(weights)
