"""Bicubic splines from one grid to another, as products of cached sparse matrices.

They are not-a-knot splines (de Boor, A Practical Guide to Splines, 1978).
"""

from functools import lru_cache

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
        _design_matrix(x, knots) for x in (at, np.clip(np.frombuffer(lines), at[0], at[-1]))
    )
    return _banded(np.linalg.inv(values)), _banded(lines_between)


def _design_matrix(x: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """The B-splines on knots at x, cached on disk."""

    def compute() -> np.ndarray:
        from scipy.interpolate import BSpline  # slow to import

        return BSpline.design_matrix(x, knots, DEGREE).toarray()

    return cached_array("splines", short_digest(x.tobytes() + knots.tobytes()), __file__, compute)


def _banded(matrix: np.ndarray) -> sparse.csr_array:
    """A matrix, (m, n), without the elements below MIN_WEIGHT at the ends of its rows."""
    large, columns = np.abs(matrix) > MIN_WEIGHT, np.arange(matrix.shape[1])
    first = large.argmax(axis=1)
    width = int((columns.size - large[:, ::-1].argmax(axis=1) - first).max())
    first = np.minimum(first, columns.size - width)[:, None]
    inside = (columns >= first) & (columns < first + width)
    return sparse.csr_array(np.where(inside, matrix, 0.0), dtype=np.float32)
