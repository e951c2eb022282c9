"""The force that pushes a shape in to a depth, for whoever knows a depth and has no force cell."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.types import FORCE_RANGE_N, Contact, PressCommand

TOLERANCE_MM = 1e-3
"""How near to the asked depth the press that is found lies, mm: what a settled step still moves."""

FIRST_N, STEP = 1.0, 4.0
"""Force that the search begins at, N, and the factor of its steps away from there."""

MAX_PRESSES = 60
"""Presses after which a search that does not end is given up."""


def force_at_depth(
    press: Callable[[PressCommand], Contact], command: PressCommand, depth_mm: float
) -> float:
    """The force, N, under which a press of this command travels depth_mm from its first touch.

    press: solves a press into one sensor; the command's own force is not looked at. Found by
    Brent's method on the logarithm of the force, of which the depth is a rising function.
    Raises T2TwinError for a depth that no force of FORCE_RANGE_N gives, and as press does.
    """
    depth_mm = arguments.real(depth_mm, "depth_mm")
    if not (np.isfinite(depth_mm) and depth_mm > 0):
        raise T2TwinError(f"a depth of {depth_mm:g} mm cannot be pressed; it must be above 0")
    from scipy.optimize import root_scalar  # a press of a force does without

    known: dict[float, float] = {}

    def beyond(log_n: float) -> float:
        """How much deeper than asked a force goes, mm."""
        if log_n not in known:
            if len(known) == MAX_PRESSES:
                raise T2TwinError(
                    f"no force was found that gives a depth of {depth_mm:g} mm; take another depth"
                )
            contact = press(replace(command, force_n=_force(log_n)))
            off = contact.depth_mm - depth_mm
            known[log_n] = 0.0 if abs(off) < TOLERANCE_MM else off
        return known[log_n]

    low, high = _bracket(beyond, depth_mm)
    found = root_scalar(beyond, bracket=(low, high), method="brentq", xtol=1e-6)
    return _force(found.root)


def _force(log_n: float) -> float:
    return float(np.clip(np.exp(log_n), *FORCE_RANGE_N))


def _bracket(beyond: Callable[[float], float], depth_mm: float) -> tuple[float, float]:
    """Logarithms of two forces, the one too small and the other too great."""
    least, most = np.log(FORCE_RANGE_N)
    at = np.log(FIRST_N)
    direction = -1.0 if beyond(at) > 0 else 1.0
    while True:
        there = float(np.clip(at + direction * np.log(STEP), least, most))
        if beyond(there) * direction >= 0:
            return min(at, there), max(at, there)
        if there in (least, most):
            raise T2TwinError(
                f"a depth of {depth_mm:g} mm needs a force {'under' if direction < 0 else 'over'} "
                f"{np.exp(there):g} N; allowed are {FORCE_RANGE_N[0]:g} to {FORCE_RANGE_N[1]:g} N"
            )
        at = there
