"""What a real array adds to the true counts, each imperfection with its own switch."""

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
    """How far the array is from ideal. Zero switches a term off.

    white_counts: standard deviation of every reading's noise, counts. Real untouched readings: half
        within 7 counts, which 8.6 gives together with the drift below.
    drift_share, drift_counts: share of taxel baselines that have wandered, and the standard
        deviation of those, counts. 0.15 and 620 put 95 % within 600, as measured.
    hysteresis: largest share of a count still missing after loading (assumed).
    crosstalk: share of each nearest neighbor's count that leaks in (assumed).
    gain_spread: standard deviation of the taxels' gains around 1, fixed for an array (assumed).
    dead: indices of taxels that read nothing.
    """

    white_counts: float = 0.0
    drift_share: float = 0.0
    drift_counts: float = 0.0
    hysteresis: float = 0.0
    crosstalk: float = 0.0
    gain_spread: float = 0.0
    dead: tuple[int, ...] = ()

    def check_dead(self, taxels: int) -> None:
        """Raises T2TwinError where a dead taxel is none of so many."""
        for index in self.dead:
            if not (isinstance(index, int) and 0 <= index < taxels):
                raise T2TwinError(
                    f"dead names taxel {index!r}; those of the layout are 0 to {taxels - 1}"
                )


PRESETS = {
    "none": Imperfections(),
    "white": Imperfections(white_counts=8.6),
    "untouched": Imperfections(white_counts=8.6, drift_share=0.15, drift_counts=620.0),
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
    """A sample of the array: READINGS readings averaged and rounded, (n,) uint16.

    true_counts: (n,) noiseless. array_seed: which array it is; its gain spread stays the same for
    all its samples. A reading below 0 or above FULL_SCALE_COUNTS is held there.
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
    """1 where two taxels are nearest neighbors: within 1.2 of the layout's least distance."""
    apart = np.hypot(
        layout.x_mm[:, None] - layout.x_mm[None], layout.y_mm[:, None] - layout.y_mm[None]
    )
    apart[np.diag_indices(layout.size)] = np.inf
    return (apart < 1.2 * apart.min()).astype(float)
