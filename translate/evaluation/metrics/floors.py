"""Error floors, and the taxels that the DIGIT's image shows.

Taxels are divided by their position: under the DIGIT's view, within one pitch of it, and beyond.
The noise floor is the difference of two readings of one press. The layout floor is the error of a
layout's counts after interpolation from the taxels of another layout.

Shape letters: P pairs, N taxels of a layout, M taxels of the layout of training.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from t2twin.sim.cyskin.layout import Layout
from t2twin.sim.cyskin.phi import barycentric
from t2twin.sim.cyskin.reading import expected_reading, read
from t2twin.sim.dataset.info import DatasetInfo
from t2twin.sim.digit.camera.pinhole import DIGIT_CAMERA, Camera
from t2twin.translate.data.pairs import DataInfo

NOISE_FLOOR, LAYOUT_FLOOR = "noise-floor", "layout-floor"
"""Names of their rows."""

GROUPS = ("under", "near", "beyond")
"""Groups of taxels: under the view; outside, within one pitch; farther."""

SLACK = 1e-6
"""Tolerance of positions for rounding, fraction of a pitch."""

OUTSIDE_PARTS = 0.01
"""Largest distance of a taxel outside its triangle of trained taxels, in barycentric coordinates
(assumed: layouts.OUTSIDE_MM for a triangle 1 mm high)."""

SEED = 1
"""Seed of the second readings; the noise of datasets has other seeds."""


@dataclass(frozen=True)
class FieldOfView:
    """The DIGIT's field of view relative to a taxel layout.

    half_width_mm, half_height_mm: of the rectangle that the image shows. pitch_mm: median distance
    of a taxel to its nearest neighbor. groups: (N,) bool by the names in GROUPS.
    """

    half_width_mm: float
    half_height_mm: float
    pitch_mm: float
    groups: dict[str, np.ndarray]


def view_on(x_mm: np.ndarray, y_mm: np.ndarray, camera: Camera = DIGIT_CAMERA) -> FieldOfView:
    """Groups the taxels of a layout by their distance from the rectangle of the image.

    x_mm, y_mm: (N,), N > 1, mm, sensor frame. camera: by default the twin's.
    """
    half_width, half_height = camera.seen_half_extent_mm()
    points = np.column_stack([x_mm, y_mm])
    pitch = float(np.median(KDTree(points).query(points, k=2)[0][:, 1]))
    distance_mm = np.hypot(
        np.maximum(np.abs(points[:, 0]) - half_width, 0.0),
        np.maximum(np.abs(points[:, 1]) - half_height, 0.0),
    )
    near = distance_mm <= pitch * (1.0 + SLACK)
    masks = (distance_mm == 0.0, near & (distance_mm > 0.0), ~near)
    return FieldOfView(half_width, half_height, pitch, dict(zip(GROUPS, masks, strict=True)))


def representable(trained: DataInfo, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
    """Projection of a layout's counts onto those that another layout's images can represent.

    x_mm, y_mm: (N,) taxels inside the trained layout's hull, mm. Returns (N, N): multiplied by true
    counts, it is the least-squares approximation by interpolations of any M trained taxels.
    """
    points = np.column_stack([trained.x_mm, trained.y_mm])
    weights = barycentric(points, np.column_stack([x_mm, y_mm]), OUTSIDE_PARTS).toarray()
    return weights @ np.linalg.pinv(weights)


def second_reading(counts: np.ndarray, info: DatasetInfo, seed: int = SEED) -> np.ndarray | None:
    """A second reading of each press, with the imperfections of the dataset.

    counts: (P, N), the readings of the dataset. info: its info.json. Returns (P, N) float32, or
    None for a dataset without known imperfections, such as imported pairs.

    A dataset has no noiseless counts. Two readings of each stored one are simulated, as if it were
    noiseless, and their difference is added to it. The result differs from the stored reading like
    two independent readings of one press: by sqrt(2) of the noise of one. A predictor of noiseless
    counts would differ by the noise once. Permanent imperfections, such as gains, cancel. Counts
    without contact are subtracted first, as the second reading adds them again.
    """
    if info.parameters is None:
        return None
    skin = info.parameters.cyskin
    layout = Layout(
        info.layout,
        np.array(info.layout_x_mm),
        np.array(info.layout_y_mm),
        np.array(skin.pad_diameter_mm),
    )
    at_rest, _ = expected_reading(skin.imperfections, np.zeros(layout.size))
    rng = np.random.default_rng(seed)
    repeated = np.empty(counts.shape, np.float32)
    for row, stored in enumerate(counts.astype(float)):
        touched = np.maximum(stored - at_rest, 0.0)
        one, two = (read(touched, layout, skin.imperfections, rng).astype(float) for _ in range(2))
        repeated[row] = stored + (two - one)
    return repeated
