"""How numbers are written in the documents."""

from t2twin.core.errors import T2TwinError


def formatted(number: float, form: str) -> str:
    """A number in a format of Python's; in percent with a space before the sign.

    Raises T2TwinError where it cannot be written so.
    """
    try:
        return format(number, form).replace("%", " %")
    except (TypeError, ValueError):
        raise T2TwinError(f"{number!r} cannot be written in the format {form!r}") from None
