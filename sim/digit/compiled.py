"""How the optics' inner loops are compiled, and what they share.

Numba's cache of a compiled loop does not notice a change in another file than the loop's own:
after a change here, delete sim/digit/__pycache__.
"""

import numba

_OPTIONS = {"nogil": True, "error_model": "numpy"}

jit = numba.njit(cache=True, **_OPTIONS)
jit_finite = numba.njit(cache=True, fastmath={"nnan", "ninf", "nsz"}, **_OPTIONS)
"""For finite numbers only: lets minima and maxima be vectorised, changes no rounding."""
inlined = numba.njit(inline="always", **_OPTIONS)
"""A part of such a loop, compiled as if its text stood there."""


@inlined
def bilinear(upper_left, upper_right, lower_left, lower_right, down, across):
    """Between four corners, down and across being the parts of the way, 0 to 1."""
    upper = upper_left + across * (upper_right - upper_left)
    lower = lower_left + across * (lower_right - lower_left)
    return upper + down * (lower - upper)
