"""Bicubic splines from one grid to another, as products of cached banded matrices.

They are not-a-knot splines (de Boor, A Practical Guide to Splines, 1978).
"""

from functools import lru_cache

import numpy as np

from t2twin.core.cache_dir import cached_array, short_digest
from t2twin.core.jit import compiled

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
    spread = _product(*to_coefficients, values.astype(np.float32)).T
    for matrix in _axis(x.tobytes(), lines_x.tobytes()):
        spread = _product(*matrix, np.ascontiguousarray(spread))
    # y comes last, so that the largest array is written once and in its final order
    return _product(*to_lines, np.ascontiguousarray(spread.T))


@compiled(nogil=True)
def _product(first, weights, values):
    """The product of a matrix of `_banded` and values, (n, k) float32."""
    found = np.empty((first.size, values.shape[1]), np.float32)
    for i in range(first.size):
        row = found[i]
        for j in range(row.size):
            row[j] = weights[i, 0] * values[first[i], j]
        for n in range(1, weights.shape[1]):
            weight, others = weights[i, n], values[first[i] + n]
            for j in range(row.size):
                row[j] += weight * others[j]
    return found


@lru_cache(maxsize=32)
def _axis(places: bytes, lines: bytes) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
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


def _banded(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The first columns, (m,), and the elements, (m, width), of a matrix, (m, n), without those
    below MIN_WEIGHT at the ends of its rows."""
    large = np.abs(matrix) > MIN_WEIGHT
    first = large.argmax(axis=1)
    width = int((large.shape[1] - large[:, ::-1].argmax(axis=1) - first).max())
    first = np.minimum(first, large.shape[1] - width)
    inside = np.take_along_axis(matrix, first[:, None] + np.arange(width), axis=1)
    return first, inside.astype(np.float32)
