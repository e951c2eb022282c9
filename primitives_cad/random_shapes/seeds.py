"""Names of random shapes: `random-0`, `random-1` and so on, by their seeds."""

from t2twin.core.errors import T2TwinError

PREFIX = "random-"
MAX_SEED = 2**63 - 1


def seed_of(name: str) -> int | None:
    """The seed of `random-17`, None for any other name. Raises T2TwinError where it is none."""
    if not name.startswith(PREFIX) or "." in name or "/" in name:
        return None
    digits = name.removeprefix(PREFIX)
    is_number = digits.isascii() and digits.isdigit() and len(digits) <= len(str(MAX_SEED))
    if not (is_number and digits == str(int(digits)) and int(digits) <= MAX_SEED):
        raise T2TwinError(
            f"{name} is no random shape; they are called {PREFIX}0, {PREFIX}1 and so on to "
            f"{PREFIX}{MAX_SEED}"
        )
    return int(digits)
