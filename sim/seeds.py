"""Seeds: one rule for all of them."""

from t2twin.primitives_cad import checks
from t2twin.primitives_cad.errors import T2TwinError

MOST_SEED = 2**63 - 1
"""The largest seed that NumPy, PyTorch and JSON readers all take for certain."""


def check_seed(seed: int) -> None:
    """Raises T2TwinError for a seed that is not a whole number from 0 to MOST_SEED."""
    checks.whole_number(seed, "seed")
    if not 0 <= seed <= MOST_SEED:
        raise T2TwinError(f"the seed is {seed}; it must be a whole number from 0 to {MOST_SEED}")
