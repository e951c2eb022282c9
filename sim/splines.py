"""Cubic splines, and bicubic ones from one grid to another, as products of cached sparse matrices.

They are not-a-knot splines (de Boor, A Practical Guide to Splines, 1978).
"""

from functools import lru_cache, partial

import numpy as np
from scipy import sparse

from t2twin.core.cache_dir import cached_array, short_digest

DEGREE = 3

MIN_WEIGHT = 1e-7
"""Weights of values on coefficients below this are dropped: they fall to a quarter with each place,
and single precision cannot represent them."""


def on_lines(
    values: np.ndarray, y: np.ndarray, x: np.ndarray, lines_y: np.ndarray, lines_x: np.ndarray
) -> np.ndarray:
    """The bicubic spline through values (y.size, x.size) on the axes lines_y and lines_x, float32.

    All axes rise. Outside the values the spline is constant.
    """
    to_coefficients, to_lines = _axis(y.tobytes(), lines_y.tobytes())
    along = _axis(x.tobytes(), lines_x.tobytes())
    spread = np.ascontiguousarray((to_coefficients @ values.astype(np.float32)).T)
    for matrix in along:
        spread = matrix @ spread
    # y comes last, so that the largest array is written once and in its final order
    return to_lines @ np.ascontiguousarray(spread.T)


@lru_cache(maxsize=32)
def _axis(places: bytes, lines: bytes) -> tuple[sparse.csr_array, sparse.csr_array]:
    """The matrices from values at places to B-spline coefficients, and from these to lines.

    places, lines: float64. The grids repeat from press to press, so the last matrices are cached.
    """
    at = np.frombuffer(places)
    # not-a-knot: the second and the last but one place are no knots
    knots = np.concatenate([np.repeat(at[0], DEGREE + 1), at[2:-2], np.repeat(at[-1], DEGREE + 1)])
    values, lines_between = (
        cached_array(
            "splines", short_digest(x.tobytes() + knots.tobytes()), __file__,
            partial(_design_matrix, x, knots),
        )
        for x in (at, np.clip(np.frombuffer(lines), at[0], at[-1]))
    )  # fmt: skip
    return _banded(np.linalg.inv(values)), _banded(lines_between)


def _design_matrix(x: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """The B-splines on knots at x."""
    from scipy.interpolate import BSpline  # slow to import

    return BSpline.design_matrix(x, knots, DEGREE).toarray()


def cubic_spline(x: np.ndarray, y: np.ndarray, at: np.ndarray) -> np.ndarray:
    """The spline through y, (n,), at x, (n,), n > 3, at places of any shape.

    As scipy.interpolate.CubicSpline, which takes half a second to import.
    """
    h = np.diff(x)
    rise = np.diff(y) / h
    first, last = x[2] - x[0], x[-1] - x[-3]
    # A tridiagonal system for the slopes at the places.
    below = [*h[1:].tolist(), float(last)]
    middle = [float(h[1]), *(2 * (h[:-1] + h[1:])).tolist(), float(h[-2])]
    above = [float(first), *h[:-1].tolist()]
    start = ((h[0] + 2 * first) * h[1] * rise[0] + h[0] ** 2 * rise[1]) / first
    end = (h[-1] ** 2 * rise[-2] + (2 * last + h[-1]) * h[-2] * rise[-1]) / last
    slopes = [float(start), *(3 * (h[1:] * rise[:-1] + h[:-1] * rise[1:])).tolist(), float(end)]
    for k in range(len(below)):
        share = below[k] / middle[k]
        middle[k + 1] -= share * above[k]
        slopes[k + 1] -= share * slopes[k]
    slopes[-1] /= middle[-1]
    for k in reversed(range(len(below))):
        slopes[k] = (slopes[k] - above[k] * slopes[k + 1]) / middle[k]
    slope = np.array(slopes)
    bend = (slope[:-1] + slope[1:] - 2 * rise) / h
    k = np.clip(np.searchsorted(x, at, "right") - 1, 0, x.size - 2)
    u, bends = at - x[k], ((rise - slope[:-1]) / h - bend)[k]
    return y[k] + slope[k] * u + bends * (u * u) + (bend / h)[k] * (u * u * u)


def _banded(matrix: np.ndarray) -> sparse.csr_array:
    """A matrix, (m, n), without the elements below MIN_WEIGHT at the ends of its rows."""
    large, columns = np.abs(matrix) > MIN_WEIGHT, np.arange(matrix.shape[1])
    first = large.argmax(axis=1)
    width = int((columns.size - large[:, ::-1].argmax(axis=1) - first).max())
    first = np.minimum(first, columns.size - width)[:, None]
    inside = (columns >= first) & (columns < first + width)
    return sparse.csr_array(np.where(inside, matrix, 0.0), dtype=np.float32)
