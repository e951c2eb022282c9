"""Which taxels the DIGIT's picture can know of: under its view, within a pitch of it, beyond.

What another layout's tactile images cannot say of a layout's taxels.

Shape letters: N taxels of the new layout, M taxels of the trained one.

What cannot be known because the CySkin is noisy: the same press read twice.

Shape letters: P pairs, N taxels.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from t2twin.sim.cyskin.layout import Layout
from t2twin.sim.cyskin.phi import barycentric
from t2twin.sim.cyskin.reading import read
from t2twin.sim.dataset.info import DatasetInfo
from t2twin.sim.digit.camera.pinhole import DIGIT_CAMERA, Camera
from t2twin.translate.data.pairs import DataInfo

GROUPS = ("under", "near", "beyond")
"""Under the view; outside, within one pitch of it; farther."""

SLACK = 1e-6
"""Parts of a pitch that positions may be rounded by."""


@dataclass(frozen=True)
class FieldOfView:
    """The DIGIT's view on a taxel layout.

    half_width_mm, half_height_mm: of the rectangle that the picture shows. pitch_mm: the layout's,
    the median distance to a taxel's nearest neighbor. groups: by the names in GROUPS, (N,) bool.
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


NOISE_FLOOR = "noise-floor"
"""The row's name among the models."""

SEED = 1
"""Seed of the second readings; the dataset's own noise is drawn otherwise."""


def second_reading(counts: np.ndarray, info: DatasetInfo, seed: int = SEED) -> np.ndarray | None:
    """Each press read once more, with the imperfections that the dataset was made with.

    counts: (P, N), the dataset's readings. info: its info.json. Returns (P, N) float32, or None
    for a dataset that does not name its imperfections, as an imported one.

    A dataset holds no noiseless counts. So two readings are drawn of each stored one, as if it were
    noiseless, and their difference is added to it: what comes out differs from the stored
    reading as two independent readings of one press do, by sqrt(2) of one reading's noise. A
    predictor of the noiseless counts would be off by the noise once. Flaws that an array has for
    good, such as its gains, are in both readings and cancel.
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
    rng = np.random.default_rng(seed)
    again = np.empty(counts.shape, np.float32)
    for row, stored in enumerate(counts.astype(float)):
        one, two = (read(stored, layout, skin.imperfections, rng).astype(float) for _ in range(2))
        again[row] = stored + (two - one)
    return again
