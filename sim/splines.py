"""Bicubic splines from one grid to another, as products of cached banded matrices.

They are not-a-knot splines (de Boor, A Practical Guide to Splines, 1978).
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from t2twin.core.jit import compiled

DEGREE = 3

MIN_WEIGHT = 1e-7
"""Weights of values on coefficients below this are dropped: they fall to a quarter with each place,
and single precision cannot represent them."""


@dataclass(frozen=True)
class _Banded:
    """A banded matrix, (m, n): weighted sums of neighboring rows.

    first: (m,) int64, the first row of each sum. weights: (m, k) float32, from the first row on.
    """

    first: np.ndarray
    weights: np.ndarray

    def apply(self, values: np.ndarray) -> np.ndarray:
        """The product with (n, columns) float32, (m, columns) float32."""
        sums = np.zeros((self.first.size, values.shape[1]), np.float32)
        _add_rows(values, self.first, self.weights, sums)
        return sums


def on_lines(
    values: np.ndarray, y: np.ndarray, x: np.ndarray, lines_y: np.ndarray, lines_x: np.ndarray
) -> np.ndarray:
    """The bicubic spline through values (y.size, x.size) on the axes lines_y and lines_x, float32.

    All axes rise. Outside the values the spline is constant.
    """
    to_coefficients, to_lines = _axis(y.tobytes(), lines_y.tobytes())
    along = _axis(x.tobytes(), lines_x.tobytes())
    values = np.array(values, np.float32)  # a copy: the argument may be read-only
    coefficients = to_coefficients.apply(values)
    spread = np.ascontiguousarray(coefficients.T)
    for matrix in along:
        spread = matrix.apply(spread)
    # y comes last, so that the largest array is written once and in its final order
    return to_lines.apply(np.ascontiguousarray(spread.T))


@lru_cache(maxsize=32)
def _axis(places: bytes, lines: bytes) -> tuple[_Banded, _Banded]:
    """The matrices from values at places to B-spline coefficients, and from these to lines.

    places, lines: float64. The grids repeat from press to press, so the last matrices are cached.
    """
    at = np.frombuffer(places)
    between = np.clip(np.frombuffer(lines), at[0], at[-1])
    # not-a-knot: the second and the last but one place are no knots
    knots = np.concatenate([np.repeat(at[0], DEGREE + 1), at[2:-2], np.repeat(at[-1], DEGREE + 1)])
    return _banded(np.linalg.inv(_b_splines(at, knots))), _banded(_b_splines(between, knots))


def _b_splines(x: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """(x.size, B-splines) values at x, by de Boor's recurrence; scipy.interpolate loads slowly."""
    number = knots.size - DEGREE - 1
    interval = np.clip(np.searchsorted(knots, x, "right") - 1, DEGREE, number - 1)
    values = np.zeros((DEGREE + 1, x.size))
    values[0] = 1.0
    for degree in range(1, DEGREE + 1):
        lower = values.copy()
        values[0] = 0.0
        for n in range(1, degree + 1):
            left, right = knots[interval + n - degree], knots[interval + n]
            share = lower[n - 1] / (right - left)
            values[n - 1] += share * (right - x)
            values[n] = share * (x - left)
    matrix = np.zeros((x.size, number))
    np.put_along_axis(matrix, interval[:, None] + np.arange(-DEGREE, 1), values.T, axis=1)
    return matrix


def _banded(matrix: np.ndarray) -> _Banded:
    """A matrix (m, n) without the elements below MIN_WEIGHT at the ends of its rows."""
    large = np.abs(matrix) > MIN_WEIGHT
    first = large.argmax(axis=1)
    width = int((matrix.shape[1] - large[:, ::-1].argmax(axis=1) - first).max())
    first = np.minimum(first, matrix.shape[1] - width)
    weights = np.take_along_axis(matrix, first[:, None] + np.arange(width), axis=1)
    return _Banded(first, np.ascontiguousarray(weights, np.float32))


@compiled(nogil=True)
def _add_rows(values, first, weights, sums):
    for i in range(first.size):
        row = sums[i]
        for k in range(weights.shape[1]):
            weight, added = weights[i, k], values[first[i] + k]
            for j in range(row.size):
                row[j] += weight * added[j]
