"""Interpolating cubic splines through values at equally spaced places."""

import numpy as np


class CubicSpline:
    """The cubic spline through values (n, ...) at n >= 4 places from first to last.

    Its third derivative is continuous at the second and the last but one place (not-a-knot; de
    Boor, A Practical Guide to Splines, 1978), as in SciPy's class, whose import takes 0.3 s.
    """

    def __init__(self, first: float, last: float, values: np.ndarray) -> None:
        count = len(values)
        self._first, self._step = first, (last - first) / (count - 1)
        second = _second_differences(values)
        low, high = values[:-1], values[1:]
        bent_low, bent_high = second[:-1], second[1:]
        # of powers of the part of a step, 0 to 1
        self._powers = (
            low,
            high - low - (2.0 * bent_low + bent_high) / 6.0,
            bent_low / 2.0,
            (bent_high - bent_low) / 6.0,
        )

    def __call__(self, places: np.ndarray) -> np.ndarray:
        """Values at places of any shape, (*places.shape, ...); beyond the ends the last cubics go
        on."""
        steps = (places - self._first) / self._step
        index = np.clip(steps.astype(np.intp), 0, len(self._powers[0]) - 1)
        part = (steps - index).reshape(*places.shape, *(1,) * (self._powers[0].ndim - 1))
        value, slope, bend, twist = (power[index] for power in self._powers)
        return value + part * (slope + part * (bend + part * twist))


def _second_differences(values: np.ndarray) -> np.ndarray:
    """The spline's second derivatives times the squared step, (n, ...), by Thomas' algorithm.

    In the middle m[i - 1] + 4 m[i] + m[i + 1] is six times the second difference d[i] of the
    values; at the ends, where the third derivative is continuous, m[1] = d[1].
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
