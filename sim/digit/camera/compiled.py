"""Compilation of the optics' inner loops, and their shared functions."""

from t2twin.core.jit import compiled

_OPTIONS = {"nogil": True, "error_model": "numpy"}

jit = compiled(**_OPTIONS)
jit_finite = compiled(fastmath={"nnan", "ninf", "nsz"}, **_OPTIONS)
"""For finite numbers only: minima and maxima are vectorized; rounding does not change."""
inlined = compiled(inline="always", **_OPTIONS)
"""A function that is inlined into such a loop."""


@inlined
def bilinear(upper_left, upper_right, lower_left, lower_right, down, across):
    """Bilinear interpolation between four corners. down, across: 0 to 1."""
    upper = upper_left + across * (upper_right - upper_left)
    lower = lower_left + across * (lower_right - lower_left)
    return upper + down * (lower - upper)
