"""Whether a shape presses with the same surface as another one, wherever and however it stands.

What a sensor feels of the other one, its patch about the press axis, is laid over the shape at
every place and turn: coarsely by Fourier transforms, then finely where it nearly fits.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy import fft, ndimage, optimize

from t2twin.primitives_cad.shape import HeightMap

PATCH_MM = 13.0
"""Radius of the patch that is compared, mm: as far as a cover of 28 mm reaches to its sides."""

FELT_MM = 3.0
"""How far below the top of its patch a surface can be felt, mm (assumed: no press is deeper)."""

WINDOW_MM = 38.0
"""Half the side of the square about the shape's press axis in which the patch is looked for, mm:
its middle may lie as far aside as a press may be meant to, 25 mm."""

COARSE_MM, COARSE_TURNS, SAMPLES = 1.0, 36, 2
"""Cells, mm, and turns in a circle on which it is first looked for; points along a cell."""

NEARLY_MM = 0.6
"""Root mean square of the differences, mm, up to which a coarse place is looked at finely."""

BEST = 8
"""Coarse places that are looked at finely."""

FINE_MM = 0.4
"""Distance of the points that are compared in the end, mm."""

ASIDE_MM = 0.1
"""How far aside a height may be found, mm: at a wall that is millimeters up or down."""

SAME_MM, SAME_SHARE = 0.1, 0.95
"""Surfaces are the same where so large a share of the points that are felt differs by less (mm):
finer than a sensor feels, and coarser than a mesh's or a print's own error."""


class KnownSurfaces:
    """Surfaces that others are compared with.

    named: the surfaces by name, each with the press axis through the middle of what counts.
    """

    def __init__(self, named: Mapping[str, HeightMap]) -> None:
        self.names = tuple(named)
        self._surfaces = tuple(named.values())
        cells = round(2 * WINDOW_MM / COARSE_MM)
        patch = round(2 * PATCH_MM / COARSE_MM)
        self._size = fft.next_fast_len(cells + patch, real=True)
        self._axis = (np.arange(cells) - (cells - 1) / 2) * COARSE_MM
        self._patch_axis = (np.arange(patch) - (patch - 1) / 2) * COARSE_MM
        inside = np.hypot(*np.meshgrid(self._patch_axis, self._patch_axis)) <= PATCH_MM
        self._points = int(inside.sum())
        self._disc = self._transform(inside.astype(float))
        self._shifts = cells - patch + 1
        self._turns = 2 * np.pi * np.arange(COARSE_TURNS) / COARSE_TURNS
        patches = [
            [self._coarse(surface, self._patch_axis, turn, inside) for turn in self._turns]
            for surface in self._surfaces
        ]
        flat = np.array(patches).reshape(-1, patch, patch)
        self._patches = np.array([self._transform(each) for each in flat])
        self._sums = flat.sum(axis=(1, 2))
        self._squares = (flat**2).sum(axis=(1, 2)) - self._sums**2 / self._points

    def same_as(self, surface: HeightMap) -> str | None:
        """The name of the one that a surface is the same as, or None."""
        window = self._transform(self._coarse(surface, self._axis, 0.0))
        squares = self._transform(self._coarse(surface, self._axis, 0.0) ** 2)
        total, total_squares = self._slid(window * self._disc), self._slid(squares * self._disc)
        spread = total_squares - total**2 / self._points
        common = self._slid(window * self._patches) - self._sums[:, None, None] * (
            total / self._points
        )
        apart = (self._squares[:, None, None] + spread - 2 * common) / self._points
        # the best shift of every patch and turn, then the best of those
        best = apart.reshape(len(apart), -1)
        at = best.argmin(axis=1)
        least = best[np.arange(len(best)), at]
        for number in np.argsort(least)[:BEST]:
            if least[number] > NEARLY_MM**2:
                break
            known, turn = divmod(int(number), COARSE_TURNS)
            row, column = divmod(int(at[number]), self._shifts)
            middle = (self._shifts - 1) / 2
            start = ((column - middle) * COARSE_MM, (row - middle) * COARSE_MM, self._turns[turn])
            if _share_of_same(self._surfaces[known], surface, start) >= SAME_SHARE:
                return self.names[known]
        return None

    def _coarse(
        self,
        surface: HeightMap,
        axis_mm: np.ndarray,
        turn_rad: float,
        inside: np.ndarray | None = None,
    ) -> np.ndarray:
        """Mean heights on coarse cells of the surface turned about the axis, 0 outside."""
        offsets = ((np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5) * COARSE_MM
        fine = (axis_mm[:, None] + offsets).ravel()
        x, y = np.meshgrid(fine, fine)
        heights = _turned(surface, x, y, 0.0, 0.0, turn_rad)
        heights = np.maximum(heights - heights.max(), -FELT_MM)
        cells = heights.reshape(axis_mm.size, SAMPLES, axis_mm.size, SAMPLES).mean(axis=(1, 3))
        return cells if inside is None else cells * inside

    def _transform(self, cells: np.ndarray) -> np.ndarray:
        """Of the window as it is, of a patch for sliding it over."""
        made = np.asarray(fft.rfft2(cells, (self._size, self._size)))
        return made if len(cells) == self._axis.size else made.conj()

    def _slid(self, product: np.ndarray) -> np.ndarray:
        """Sums over the patch at each of its places in the window."""
        sums = np.asarray(fft.irfft2(product, (self._size, self._size)))
        return sums[..., : self._shifts, : self._shifts]


def _turned(
    surface: HeightMap, x: np.ndarray, y: np.ndarray, at_x: float, at_y: float, turn: float
) -> np.ndarray:
    """Heights of a surface at points that are turned about the axis and moved, mm."""
    cos, sin = np.cos(turn), np.sin(turn)
    return surface.sample(at_x + cos * x + sin * y, at_y + cos * y - sin * x)


def _share_of_same(
    known: HeightMap, surface: HeightMap, start: tuple[float, float, float]
) -> float:
    """Share of a patch's points at which a surface is the same, best laid from a first place."""
    axis = np.arange(-PATCH_MM, PATCH_MM + FINE_MM / 2, FINE_MM)
    x, y = np.meshgrid(axis, axis)
    inside = np.hypot(x, y) <= PATCH_MM
    x, y = x[inside], y[inside]
    wanted = known.sample(x, y)
    wanted = np.maximum(wanted - wanted.max(), -FELT_MM)

    size = 1 + 2 * round(ASIDE_MM / surface.pitch_mm)
    lowest, highest = (
        replace(surface, heights_mm=of(surface.heights_mm, size))
        for of in (ndimage.minimum_filter, ndimage.maximum_filter)
    )

    def heights(of: HeightMap, laid: np.ndarray) -> np.ndarray:
        cos, sin = np.cos(laid[2]), np.sin(laid[2])
        return of.sample(laid[0] + cos * x - sin * y, laid[1] + sin * x + cos * y)

    top = float(heights(surface, np.array(start)).max())

    def apart(laid: np.ndarray) -> np.ndarray:
        """At the points where either can be felt, so that what stands alone counts by itself."""
        there, low, high = (
            np.maximum(heights(of, laid) - top, -FELT_MM) for of in (surface, lowest, highest)
        )
        felt, felt_wanted = there > -FELT_MM, wanted > -FELT_MM
        if not (felt & felt_wanted).any():
            return np.full(x.size, FELT_MM)
        level = wanted + np.median((there - wanted)[felt & felt_wanted])
        return np.maximum(np.maximum(level - high, low - level), 0.0)[felt | felt_wanted]

    laid = optimize.minimize(
        lambda values: float(np.minimum(apart(values), 5 * SAME_MM).mean()),
        np.array(start),
        method="Nelder-Mead",
        options={"initial_simplex": _simplex(start), "xatol": 1e-3, "fatol": 1e-4, "maxiter": 300},
    )
    return float((apart(laid.x) < SAME_MM).mean())


def _simplex(start: tuple[float, float, float]) -> np.ndarray:
    """A first simplex of half a coarse cell and half a coarse turn."""
    steps = np.diag([COARSE_MM / 2, COARSE_MM / 2, np.pi / COARSE_TURNS])
    return np.array(start) + np.concatenate([np.zeros((1, 3)), steps])
