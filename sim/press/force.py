"""Forces that may be commanded."""

from t2twin.primitives_cad import checks
from t2twin.primitives_cad.errors import T2TwinError

FORCE_RANGE_N = (0.01, 100.0)
"""Forces that may be commanded, N."""


def check_force(force_n: float) -> None:
    """Raises T2TwinError for a force that cannot be pressed."""
    low, high = FORCE_RANGE_N
    force_n = checks.real(force_n, "force_n")
    if not low <= force_n <= high:
        raise T2TwinError(
            f"a force of {force_n:g} N cannot be pressed; allowed are {low:g} to {high:g} N"
        )
