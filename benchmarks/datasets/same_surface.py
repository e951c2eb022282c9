"""Recognizes a pressing surface, independent of position and rotation.

Matches the patch of a reference surface around its press axis to a shape at every position and
rotation: first on a coarse grid by Fourier transforms, then finely at the best coarse matches.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np
from scipy import fft, ndimage, optimize

from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.shape import HeightMap

SHARED = ("clamp/handle",)
"""Keypoints with the surface of a primitive of the training set: the ball at the end of the clamp's
handle is hemisphere-4's."""

PATCH_MM = 13.0
"""Radius of the compared patch, mm: about half the width of the cover, 28 mm."""

MAX_DEPTH_MM = 3.0
"""Depth below the patch's top to which surfaces are compared, mm (assumed: no press is deeper)."""

WINDOW_MM = 38.0
"""Half the side of the search window around the shape's press axis, mm: the patch's center may lie
as far aside as a press, 25 mm."""

COARSE_MM, COARSE_TURNS, SAMPLES = 1.0, 36, 2
"""Cells of the coarse search, mm; its rotations per turn; sample points along a cell."""

NEARLY_MM = 0.6
"""Root mean square difference, mm, up to which a coarse match is refined."""

BEST = 8
"""Number of coarse matches that are refined."""

FINE_MM = 0.4
"""Spacing of the points of the fine comparison, mm."""

ASIDE_MM = 0.1
"""Lateral tolerance, mm: at a wall heights differ by millimeters."""

SAME_MM, SAME_SHARE = 0.1, 0.95
"""Surfaces are the same if this share of the compared points differs by less than SAME_MM: below a
sensor's resolution, and above the error of a mesh or a print."""


class KnownSurfaces:
    """Reference surfaces. named: surfaces by name, the patch centered on the press axis."""

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
        """The name of the reference surface that a surface contains, or None."""
        window = self._transform(self._coarse(surface, self._axis, 0.0))
        squares = self._transform(self._coarse(surface, self._axis, 0.0) ** 2)
        total, total_squares = (
            self._correlation(window * self._disc),
            self._correlation(squares * self._disc),
        )
        spread = total_squares - total**2 / self._points
        common = self._correlation(window * self._patches) - self._sums[:, None, None] * (
            total / self._points
        )
        apart = (self._squares[:, None, None] + spread - 2 * common) / self._points
        # the best shift of each patch and rotation, then the best of those
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
        """Mean heights of the rotated surface on coarse cells; 0 outside `inside`."""
        offsets = ((np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5) * COARSE_MM
        fine = (axis_mm[:, None] + offsets).ravel()
        x, y = np.meshgrid(fine, fine)
        heights = _turned(surface, x, y, 0.0, 0.0, turn_rad)
        heights = np.maximum(heights - heights.max(), -MAX_DEPTH_MM)
        cells = heights.reshape(axis_mm.size, SAMPLES, axis_mm.size, SAMPLES).mean(axis=(1, 3))
        return cells if inside is None else cells * inside

    def _transform(self, cells: np.ndarray) -> np.ndarray:
        """Fourier transform of a window; its conjugate for a patch, for the correlation."""
        made = np.asarray(fft.rfft2(cells, (self._size, self._size)))
        return made if len(cells) == self._axis.size else made.conj()

    def _correlation(self, product: np.ndarray) -> np.ndarray:
        """Sums over the patch at each of its positions in the window."""
        sums = np.asarray(fft.irfft2(product, (self._size, self._size)))
        return sums[..., : self._shifts, : self._shifts]


@cache
def tool_surfaces() -> KnownSurfaces:
    """The surfaces of all tools at their keypoints, except SHARED."""
    names = [name for name in catalogue.OBJECTS if name not in SHARED]
    return KnownSurfaces({name: catalogue.load(name).surface for name in names})


def _turned(
    surface: HeightMap, x: np.ndarray, y: np.ndarray, at_x: float, at_y: float, turn: float
) -> np.ndarray:
    """Heights of a surface at rotated and shifted points, mm."""
    cos, sin = np.cos(turn), np.sin(turn)
    return surface.sample(at_x + cos * x + sin * y, at_y + cos * y - sin * x)


def _share_of_same(
    known: HeightMap, surface: HeightMap, start: tuple[float, float, float]
) -> float:
    """Share of a patch's points at which a surface agrees, after optimizing the pose locally."""
    axis = np.arange(-PATCH_MM, PATCH_MM + FINE_MM / 2, FINE_MM)
    x, y = np.meshgrid(axis, axis)
    inside = np.hypot(x, y) <= PATCH_MM
    x, y = x[inside], y[inside]
    wanted = known.sample(x, y)
    wanted = np.maximum(wanted - wanted.max(), -MAX_DEPTH_MM)

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
        """Differences at the points where either surface lies above the largest depth."""
        there, low, high = (
            np.maximum(heights(of, laid) - top, -MAX_DEPTH_MM) for of in (surface, lowest, highest)
        )
        near_top, wanted_near_top = there > -MAX_DEPTH_MM, wanted > -MAX_DEPTH_MM
        if not (near_top & wanted_near_top).any():
            return np.full(x.size, MAX_DEPTH_MM)
        level = wanted + np.median((there - wanted)[near_top & wanted_near_top])
        return np.maximum(np.maximum(level - high, low - level), 0.0)[near_top | wanted_near_top]

    laid = optimize.minimize(
        lambda values: float(np.minimum(apart(values), 5 * SAME_MM).mean()),
        np.array(start),
        method="Nelder-Mead",
        options={"initial_simplex": _simplex(start), "xatol": 1e-3, "fatol": 1e-4, "maxiter": 300},
    )
    return float((apart(laid.x) < SAME_MM).mean())


def _simplex(start: tuple[float, float, float]) -> np.ndarray:
    """An initial simplex of half a coarse cell and half a coarse rotation."""
    steps = np.diag([COARSE_MM / 2, COARSE_MM / 2, np.pi / COARSE_TURNS])
    return np.array(start) + np.concatenate([np.zeros((1, 3)), steps])
