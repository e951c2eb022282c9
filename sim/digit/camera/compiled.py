"""How the optics' inner loops are compiled, and what they share."""

from t2twin.core.jit import compiled

_OPTIONS = {"nogil": True, "error_model": "numpy"}

jit = compiled(**_OPTIONS)
jit_finite = compiled(fastmath={"nnan", "ninf", "nsz"}, **_OPTIONS)
"""For finite numbers only: lets minima and maxima be vectorised, changes no rounding."""
inlined = compiled(inline="always", **_OPTIONS)
"""A part of such a loop, compiled as if its text stood there."""


@inlined
def bilinear(upper_left, upper_right, lower_left, lower_right, down, across):
    """Between four corners, down and across being the parts of the way, 0 to 1."""
    upper = upper_left + across * (upper_right - upper_left)
    lower = lower_left + across * (lower_right - lower_left)
    return upper + down * (lower - upper)
