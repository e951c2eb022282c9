"""Random shapes: compositions of one to four features, named `random-SEED`."""

from t2twin.core.arguments import MAX_SEED
from t2twin.core.errors import T2TwinError

PREFIX = "random-"


def seed_of(name: str) -> int | None:
    """The seed in a name such as `random-17`; None for names without the prefix.

    Raises T2TwinError for an invalid seed.
    """
    if not name.startswith(PREFIX) or "." in name or "/" in name:
        return None
    digits = name.removeprefix(PREFIX)
    is_number = digits.isascii() and digits.isdigit() and len(digits) <= len(str(MAX_SEED))
    if not (is_number and digits == str(int(digits)) and int(digits) <= MAX_SEED):
        raise T2TwinError(
            f"{name} is not a random shape; their names are {PREFIX}0, {PREFIX}1 and so on to "
            f"{PREFIX}{MAX_SEED}"
        )
    return int(digits)
