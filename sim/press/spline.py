"""A bicubic spline through values on a grid, read on the lines of another.

What it gives is linear in the values, and the grids are the same from press to press: along each
axis the values become coefficients of B-splines, by a band of weights, and these the lines between,
by four weights each.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from t2twin.primitives_cad.jit import compiled

DEGREE = 3
LEAST_WEIGHT = 1e-7
"""Weights of values on coefficients that are left out: they fall to a quarter with each place, and
single precision has no more."""


@dataclass(frozen=True)
class _Rows:
    """Sums of neighbouring rows. first: (m,) int64, the first row of each sum. weights: (m, k)
    float32, of it and of those after it."""

    first: np.ndarray
    weights: np.ndarray

    def of(self, values: np.ndarray) -> np.ndarray:
        """(m, columns) float32 of (n, columns) float32."""
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
    """The spline through values (y.size, x.size) at lines_y and lines_x, float32.

    All axes rise. The spline's third derivative goes on through the second and the last but one
    place of each axis (not-a-knot). Beyond the values it stays what it is at their edge.
    """
    to_coefficients, to_lines = _axis(y.tobytes(), lines_y.tobytes())
    along = _axis(x.tobytes(), lines_x.tobytes())
    values = np.array(values, np.float32)  # a copy, as what is given may be read-only
    coefficients = to_coefficients.of(values)
    spread = np.ascontiguousarray(coefficients.T)
    for columns in along:
        spread = columns.of(spread)
    # last to the lines along y, so that the largest array is written once and as it is wanted
    return to_lines.of(np.ascontiguousarray(spread.T))


@lru_cache(maxsize=32)
def _axis(places: bytes, lines: bytes) -> tuple[_Rows, _Rows]:
    """Values at places to coefficients, and these to what is at lines. Both float64."""
    at = np.frombuffer(places)
    between = np.clip(np.frombuffer(lines), at[0], at[-1])
    # not-a-knot: the second and the last but one place are no knots
    knots = np.concatenate([np.repeat(at[0], DEGREE + 1), at[2:-2], np.repeat(at[-1], DEGREE + 1)])
    return _banded(np.linalg.inv(_b_splines(knots, at))), _banded(_b_splines(knots, between))


def _b_splines(knots: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(places, knots - DEGREE - 1) values of the B-splines at places, by the recurrence of de Boor
    and Cox (de Boor, A Practical Guide to Splines, 1978)."""
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


def _banded(matrix: np.ndarray) -> _Rows:
    """The rows of a matrix (m, n) without what is next to nothing at their ends."""
    there = np.abs(matrix) > LEAST_WEIGHT
    first = there.argmax(axis=1)
    width = int((matrix.shape[1] - there[:, ::-1].argmax(axis=1) - first).max())
    first = np.minimum(first, matrix.shape[1] - width)
    weights = np.take_along_axis(matrix, first[:, None] + np.arange(width), axis=1)
    return _Rows(first, np.ascontiguousarray(weights, np.float32))


@compiled("void(f4[:, ::1], i8[::1], f4[:, ::1], f4[:, ::1])", nogil=True)
def _add_rows(values, first, weights, sums):
    for i in range(first.size):
        row = sums[i]
        for k in range(weights.shape[1]):
            weight, added = weights[i, k], values[first[i] + k]
            for j in range(row.size):
                row[j] += weight * added[j]
