"""Interpolating cubic splines: in one dimension, and from one grid to another.

Both are not-a-knot splines (de Boor, A Practical Guide to Splines, 1978): the third derivative is
continuous at the second and the last but one place. SciPy's classes take 0.3 s to import.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from t2twin.core.jit import compiled

DEGREE = 3

MIN_WEIGHT = 1e-7
"""Weights of values on coefficients below this are dropped: they fall to a quarter with each place,
and single precision cannot represent them."""


class CubicSpline:
    """The cubic spline through values (n, ...) at n >= 4 equally spaced places, first to last."""

    def __init__(self, first: float, last: float, values: np.ndarray) -> None:
        count = len(values)
        self._first, self._step = first, (last - first) / (count - 1)
        second = _second_differences(values)
        low, high = values[:-1], values[1:]
        bent_low, bent_high = second[:-1], second[1:]
        # coefficients of the powers of the position within a step, 0 to 1
        self._powers = (
            low,
            high - low - (2.0 * bent_low + bent_high) / 6.0,
            bent_low / 2.0,
            (bent_high - bent_low) / 6.0,
        )

    def __call__(self, places: np.ndarray) -> np.ndarray:
        """Values at places of any shape, (*places.shape, ...); extrapolates the last cubics."""
        steps = (places - self._first) / self._step
        index = np.clip(steps.astype(np.intp), 0, len(self._powers[0]) - 1)
        part = (steps - index).reshape(*places.shape, *(1,) * (self._powers[0].ndim - 1))
        value, slope, bend, twist = (power[index] for power in self._powers)
        return value + part * (slope + part * (bend + part * twist))


def _second_differences(values: np.ndarray) -> np.ndarray:
    """The spline's second derivatives times the squared step, m, (n, ...), by Thomas' algorithm.

    In the middle m[i - 1] + 4 m[i] + m[i + 1] = 6 d[i], with the second difference d of the values;
    next to the ends, where the third derivative is continuous, m[1] = d[1].
    """
    count = len(values)
    wanted = np.diff(values, n=2, axis=0)
    second = np.empty(values.shape)
    second[1], second[-2] = wanted[0], wanted[-1]
    right, pivots = 6.0 * wanted, np.empty(count)
    for i in range(2, count - 2):
        pivots[i] = 4.0 - (1.0 / pivots[i - 1] if i > 2 else 0.0)
        before = right[i - 2] / pivots[i - 1] if i > 2 else second[1]
        right[i - 1] = right[i - 1] - before
    for i in range(count - 3, 1, -1):
        second[i] = (right[i - 1] - second[i + 1]) / pivots[i]
    second[0] = 2.0 * second[1] - second[2]
    second[-1] = 2.0 * second[-2] - second[-3]
    return second


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
    values: np.ndarray,
    y: np.ndarray,
    x: np.ndarray,
    lines_y: np.ndarray,
    lines_x: np.ndarray,
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
    return _banded(np.linalg.inv(_b_splines(knots, at))), _banded(_b_splines(knots, between))


def _b_splines(knots: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(places, knots - DEGREE - 1) values of the B-splines, by the Cox-de Boor recurrence."""
    last = knots.size - DEGREE - 2
    interval = np.clip(np.searchsorted(knots, places, side="right") - 1, DEGREE, last)
    values = np.zeros((places.size, knots.size - 1))
    values[np.arange(places.size), interval] = 1.0
    for degree in range(1, DEGREE + 1):
        lengths = knots[degree:] - knots[:-degree]
        parts = np.divide(
            places[:, None] - knots[:-degree], lengths, where=lengths > 0,
            out=np.zeros((places.size, lengths.size)),
        )  # fmt: skip
        rests = np.where(lengths > 0, 1.0 - parts, 0.0)
        values = parts[:, :-1] * values[:, :-1] + rests[:, 1:] * values[:, 1:]
    return values


def _banded(matrix: np.ndarray) -> _Banded:
    """A matrix (m, n) without the elements below MIN_WEIGHT at the ends of its rows."""
    large = np.abs(matrix) > MIN_WEIGHT
    first = large.argmax(axis=1)
    width = int((matrix.shape[1] - large[:, ::-1].argmax(axis=1) - first).max())
    first = np.minimum(first, matrix.shape[1] - width)
    weights = np.take_along_axis(matrix, first[:, None] + np.arange(width), axis=1)
    return _Banded(first, np.ascontiguousarray(weights, np.float32))


@compiled("void(f4[:, ::1], i8[::1], f4[:, ::1], f4[:, ::1])", nogil=True)
def _add_rows(values, first, weights, sums):
    for i in range(first.size):
        row = sums[i]
        for k in range(weights.shape[1]):
            weight, added = weights[i, k], values[first[i] + k]
            for j in range(row.size):
                row[j] += weight * added[j]
