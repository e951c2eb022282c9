"""Measured camera noise: correlated between neighboring pixels and between colors.

Gaussian white noise of each pixel and color is smoothed along both axes and mixed over the colors.
"""

from dataclasses import dataclass

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.sim.optical.camera.compiled import jit_finite
from t2twin.sim.optical.camera.gaussian_noise import choose, keys, quantiles

REACH = 2
"""Radius of the smoothing, px: the correlation of real noise is small beyond (0.2 at 3 px, measured
on a real unit)."""
TAPS = 2 * REACH + 1
MAX_MIX_GREY = 64.0
"""Largest entry of a mix, grey levels (assumed: a DIGIT's noise has 2 to 4)."""


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of one frame.

    mix: (3, 3) grey levels, weights of three independent noises of unit variance for each color.
    taps: (TAPS,) weights of the smoothing along each axis, of unit energy.
    Raises T2TwinError for other shapes and values out of range.
    """

    mix: np.ndarray
    taps: np.ndarray

    def __post_init__(self) -> None:
        for name, value, shape, most in (
            ("mix", self.mix, (3, 3), MAX_MIX_GREY),
            ("taps", self.taps, (TAPS,), 1.0),
        ):
            if value.shape != shape or value.dtype.kind not in "fiu":
                raise T2TwinError(f"the noise's {name} must be {shape} numbers")
            if not np.abs(value).max() <= most:  # nor is nan
                raise T2TwinError(f"the noise's {name} must lie between -{most:g} and {most:g}")

    @property
    def grey(self) -> float:
        """Standard deviation over all colors, grey levels."""
        return float(np.sqrt(np.mean(np.sum(self.mix**2, axis=1))))

    def sample(self, rng: np.random.Generator, rows: int, columns: int) -> np.ndarray:
        """(rows, columns, 3) float32: noise of one frame, grey levels."""
        out = np.empty((rows, columns, 3), dtype=np.float32)
        taps, mix = self.taps.astype(np.float32), self.mix.astype(np.float32)
        _fill(keys(rng), quantiles(), taps, mix, out)
        return out


@jit_finite
def _fill(keys, quantiles, taps, mix, out):
    """Fill out (P, RGB) with Gaussian noise, smoothed and mixed.

    The white noise covers the image and a margin of the smoothing's radius.
    """
    columns, reach = out.shape[1], taps.size // 2
    down = np.empty((columns + 2 * reach) * 3, dtype=np.float32)
    across = np.empty(columns * 3, dtype=np.float32)
    rows = np.empty((taps.size, down.size), dtype=np.float32)
    chosen = np.empty(down.size, dtype=np.uint32)
    for row in range(out.shape[0] + 2 * reach):
        line = rows[row % taps.size]
        choose(row * down.size, keys[0], keys[1], chosen)
        for n in range(line.size):
            line[n] = quantiles[chosen[n]]
        if row < 2 * reach:
            continue
        down[:] = np.float32(0.0)
        for k in range(taps.size):
            tap, line = taps[k], rows[(row - 2 * reach + k) % taps.size]
            for n in range(down.size):
                down[n] += tap * line[n]
        across[:] = np.float32(0.0)
        for k in range(taps.size):
            tap, shifted = taps[k], down[3 * k : 3 * k + across.size]
            for n in range(across.size):
                across[n] += tap * shifted[n]
        filled = out[row - 2 * reach]
        for n in range(columns):
            a, b, c = across[3 * n], across[3 * n + 1], across[3 * n + 2]
            for color in range(3):
                filled[n, color] = mix[color, 0] * a + mix[color, 1] * b + mix[color, 2] * c
