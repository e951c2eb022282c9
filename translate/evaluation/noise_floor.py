"""What cannot be known because the CySkin is noisy: the same press read twice.

Shape letters: P pairs, N taxels.
"""

import numpy as np

from t2twin.sim.cyskin.layout import Layout
from t2twin.sim.cyskin.reading import read
from t2twin.sim.dataset.info import DatasetInfo

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
