"""Readings of a real array, with noise, wandering baselines and other imperfections."""

from dataclasses import dataclass, replace

import numpy as np

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.sim.cyskin.layout import Layout
from t2twin.sim.cyskin.taxels import FULL_SCALE_COUNTS

READINGS = 5
"""Readings averaged into a sample: 0.5 s (Grella et al. 2023) at about 10 Hz (measured on real
recordings)."""


@dataclass(frozen=True)
class Imperfections:
    """Deviations of an array from an ideal one. Zero disables a term.

    white_counts: standard deviation of the noise of each reading, counts. Half of the real readings
        without contact lie within 7 counts, which 8.6 reproduces together with the drift below.
    drift_share, drift_counts: share of taxels with a wandering baseline, and its standard
        deviation, counts. With 0.15 and 620, 95 % lie within 600 counts, as measured.
    hysteresis: largest share of a count that is missing after loading (assumed).
    crosstalk: share of each nearest neighbor's count that is added (assumed).
    gain_spread: standard deviation of the taxels' gains around 1, fixed for an array (assumed).
    dead: indices of taxels that read 0.
    """

    white_counts: float = 0.0
    drift_share: float = 0.0
    drift_counts: float = 0.0
    hysteresis: float = 0.0
    crosstalk: float = 0.0
    gain_spread: float = 0.0
    dead: tuple[int, ...] = ()

    def check_dead(self, taxels: int) -> None:
        """Raises T2TwinError for a dead taxel that is not one of this number."""
        for index in self.dead:
            if not (isinstance(index, int) and 0 <= index < taxels):
                raise T2TwinError(
                    f"dead contains taxel {index!r}; the layout has taxels 0 to {taxels - 1}"
                )


PRESETS = {
    "none": Imperfections(),
    "white": Imperfections(white_counts=8.6),
    "baseline": Imperfections(white_counts=8.6, drift_share=0.15, drift_counts=620.0),
    "all": Imperfections(
        white_counts=8.6,
        drift_share=0.15,
        drift_counts=620.0,
        hysteresis=0.05,
        crosstalk=0.02,
        gain_spread=0.1,
    ),
}


def imperfections(name: str, dead: tuple[int, ...] = ()) -> Imperfections:
    """A preset by name, with dead taxels added. Raises T2TwinError for an unknown name."""
    if arguments.text(name, "imperfections") not in PRESETS:
        raise T2TwinError(f"no imperfections called {name!r}; allowed are {', '.join(PRESETS)}")
    return replace(PRESETS[name], dead=dead)


def read(
    true_counts: np.ndarray,
    layout: Layout,
    flaws: Imperfections,
    rng: np.random.Generator,
    array_seed: int = 0,
) -> np.ndarray:
    """One sample of the array: the rounded mean of READINGS readings, (n,) uint16.

    true_counts: (n,) noiseless. array_seed: identifies the array, whose gains are the same in all
    samples. Readings are clipped to 0 and FULL_SCALE_COUNTS.
    """
    n = layout.size
    gains = 1 + flaws.gain_spread * np.random.default_rng(array_seed).standard_normal(n)
    signal = gains * (true_counts + flaws.crosstalk * (_neighbors(layout) @ true_counts))
    signal *= 1 - flaws.hysteresis * rng.random(n)
    signal[list(flaws.dead)] = 0.0
    wandered = rng.random(n) < flaws.drift_share
    signal = signal + wandered * flaws.drift_counts * rng.standard_normal(n)
    readings = signal + flaws.white_counts * rng.standard_normal((READINGS, n))
    return np.rint(np.clip(readings, 0, FULL_SCALE_COUNTS).mean(axis=0)).astype(np.uint16)


def _neighbors(layout: Layout) -> np.ndarray:
    """(n, n), 1 for nearest neighbors: taxels within 1.2 times the layout's least distance."""
    distance = np.hypot(
        layout.x_mm[:, None] - layout.x_mm[None], layout.y_mm[:, None] - layout.y_mm[None]
    )
    distance[np.diag_indices(layout.size)] = np.inf
    return (distance < 1.2 * distance.min()).astype(float)
