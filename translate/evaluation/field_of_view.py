"""Which taxels the DIGIT's picture can know of: under its view, within a pitch of it, beyond."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from t2twin.sim.digit.camera import DIGIT_CAMERA, Camera

GROUPS = ("under", "near", "beyond")
"""Under the view; outside, within one pitch of it; farther."""

SLACK = 1e-6
"""Parts of a pitch that positions may be rounded by."""


@dataclass(frozen=True)
class FieldOfView:
    """The DIGIT's view on a taxel layout.

    half_width_mm, half_height_mm: of the rectangle that the picture shows. pitch_mm: the layout's,
    the median distance to a taxel's nearest neighbour. groups: by the names in GROUPS, (N,) bool.
    """

    half_width_mm: float
    half_height_mm: float
    pitch_mm: float
    groups: dict[str, np.ndarray]


def view_on(x_mm: np.ndarray, y_mm: np.ndarray, camera: Camera = DIGIT_CAMERA) -> FieldOfView:
    """Sorts the taxels of a layout by their distance from the picture's rectangle.

    x_mm, y_mm: (N,), N > 1, mm, sensor frame. camera: the twin's own unless given.
    """
    half_width, half_height = camera.seen_half_extent_mm()
    points = np.column_stack([x_mm, y_mm])
    pitch = float(np.median(KDTree(points).query(points, k=2)[0][:, 1]))
    off_mm = np.hypot(
        np.maximum(np.abs(points[:, 0]) - half_width, 0.0),
        np.maximum(np.abs(points[:, 1]) - half_height, 0.0),
    )
    near = off_mm <= pitch * (1.0 + SLACK)
    masks = (off_mm == 0.0, near & (off_mm > 0.0), ~near)
    return FieldOfView(half_width, half_height, pitch, dict(zip(GROUPS, masks, strict=True)))
