"""The force that presses a shape to a given depth."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.types import FORCE_RANGE_N, Contact, PressCommand

TOLERANCE_MM = 1e-3
"""Tolerance of the depth, mm: the change in a converged step of the contact solver."""

FIRST_N, STEP = 1.0, 4.0
"""First force of the search, N, and the factor between its steps."""

MAX_PRESSES = 60
"""Limit on the presses of one search."""


def force_at_depth(
    press: Callable[[PressCommand], Contact], command: PressCommand, depth_mm: float
) -> float:
    """The force, N, that presses the command's shape depth_mm beyond its first touch.

    press: solves a press into one sensor. The command's own force is not used. Brent's method on
    the logarithm of the force, with which the depth increases.
    Raises T2TwinError for a depth that no force in FORCE_RANGE_N gives, and as `press` does.
    """
    depth_mm = arguments.real(depth_mm, "depth_mm")
    if not (np.isfinite(depth_mm) and depth_mm > 0):
        raise T2TwinError(f"a depth of {depth_mm:g} mm cannot be pressed; it must be above 0")
    from scipy.optimize import root_scalar  # slow to import

    residuals: dict[float, float] = {}

    def residual(log_n: float) -> float:
        """Depth of a force less the wanted depth, mm."""
        if log_n not in residuals:
            if len(residuals) == MAX_PRESSES:
                raise T2TwinError(
                    f"no force was found that gives a depth of {depth_mm:g} mm; take another depth"
                )
            contact = press(replace(command, force_n=_force(log_n)))
            error = contact.depth_mm - depth_mm
            residuals[log_n] = 0.0 if abs(error) < TOLERANCE_MM else error
        return residuals[log_n]

    low, high = _bracket(residual, depth_mm)
    found = root_scalar(residual, bracket=(low, high), method="brentq", xtol=1e-6)
    return _force(found.root)


def _force(log_n: float) -> float:
    return float(np.clip(np.exp(log_n), *FORCE_RANGE_N))


def _bracket(residual: Callable[[float], float], depth_mm: float) -> tuple[float, float]:
    """Logarithms of a force that is too small and of one that is too large."""
    low, high = np.log(FORCE_RANGE_N)
    current = np.log(FIRST_N)
    direction = -1.0 if residual(current) > 0 else 1.0
    while True:
        following = float(np.clip(current + direction * np.log(STEP), low, high))
        if residual(following) * direction >= 0:
            return min(current, following), max(current, following)
        if following in (low, high):
            side, (least_n, most_n) = "under" if direction < 0 else "over", FORCE_RANGE_N
            raise T2TwinError(
                f"a depth of {depth_mm:g} mm needs a force {side} {_force(following):g} N; allowed "
                f"are {least_n:g} to {most_n:g} N"
            )
        current = following
