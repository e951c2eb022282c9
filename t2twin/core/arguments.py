"""Checks of the arguments of public functions.

Each check takes the value and the name of an argument, and returns the value in its final type. A
wrong type or value raises T2TwinError. NumPy's numbers are numbers; bool is not.
"""

import math
import os
import reprlib
import sys
from collections.abc import Sequence
from decimal import Decimal
from numbers import Integral, Real
from pathlib import Path
from typing import TypeVar

import numpy as np

from t2twin.core.errors import T2TwinError

MAX_SEED = 2**63 - 1  # the largest that NumPy, PyTorch and JSON readers accept
NO_NUMBERS = (bool, np.timedelta64)  # types of numbers, to Python, that are none

Kind = TypeVar("Kind")
Number = TypeVar("Number", int, float)


def real(value: object, name: str) -> float:
    """A number as a float, which may be infinite or NaN."""
    if not isinstance(value, Real) or isinstance(value, NO_NUMBERS):
        raise _wrong(value, name, "a number")
    try:
        return float(value)
    except OverflowError:  # of a whole number
        found = Decimal(int(math.trunc(value)))  # noqa: RUF046
        most = f"expected a number of at most {sys.float_info.max:g}"
        raise T2TwinError(f"{name} is {found:.20g}; {most}") from None


def number(value: object, name: str, low: float = -math.inf, high: float = math.inf) -> float:
    """A finite number in [low, high], as a float."""
    found = real(value, name)
    if not math.isfinite(found):
        raise T2TwinError(f"{name} is {found:g}; expected a finite number")
    return _within(found, name, low, high)


def whole_number(value: object, name: str, low: float = -math.inf, high: float = math.inf) -> int:
    """A whole number in [low, high], as an int."""
    if not isinstance(value, Integral) or isinstance(value, NO_NUMBERS):
        raise _wrong(value, name, "a whole number")
    return _within(int(value), name, low, high)


def _within(value: Number, name: str, low: float, high: float) -> Number:
    if low <= value <= high:
        return value
    found, least, most = (
        f"{Decimal(each):.20g}" if isinstance(each, int) else f"{each:g}"
        for each in (value, low, high)
    )
    allowed = f"from {least} to {most}"
    if math.isinf(high):
        allowed = f"of at least {least}"
    elif math.isinf(low):
        allowed = f"of at most {most}"
    kind = "a number" if isinstance(value, float) else "a whole number"
    raise T2TwinError(f"{name} is {found}; expected {kind} {allowed}")


def check_seed(seed: int) -> None:
    """Raises T2TwinError for a seed that is not a whole number from 0 to MAX_SEED."""
    whole_number(seed, "seed", 0, MAX_SEED)


def flag(value: object, name: str) -> bool:
    """True or False."""
    if not isinstance(value, bool | np.bool_):
        raise _wrong(value, name, "True or False")
    return bool(value)


def path(value: object, name: str) -> Path:
    """A path from str or PathLike, not empty."""
    text = os.fspath(value) if isinstance(value, str | os.PathLike) else None
    if not isinstance(text, str) or not text or "\0" in text:
        raise _wrong(value, name, "a path")
    return Path(text)


def paths(values: object, name: str) -> list[Path]:
    """A list or a tuple of paths."""
    return [path(value, f"{name}[{n}]") for n, value in enumerate(_items(values, name))]


def text(value: object, name: str) -> str:
    """A str."""
    return instance(value, name, str)


def choice(value: object, name: str, allowed: Sequence[str]) -> str:
    """One of the allowed strings."""
    if not isinstance(value, str) or value not in allowed:
        raise _wrong(value, name, f"one of {', '.join(allowed)}")
    return value


def instance(value: object, name: str, kind: type[Kind]) -> Kind:
    """An instance of a class."""
    if not isinstance(value, kind):
        raise _wrong(value, name, f"an object of the class {kind.__name__}")
    return value


def objects(values: object, name: str, kind: type[Kind]) -> list[Kind]:
    """A list or a tuple of instances of a class."""
    return [instance(each, f"{name}[{n}]", kind) for n, each in enumerate(_items(values, name))]


def function(value: object, name: str) -> None:
    """Raises T2TwinError for anything that is not callable."""
    if not callable(value):
        raise _wrong(value, name, "a function")


def array(value: object, name: str) -> np.ndarray:
    """An array of integers or floats, of any shape, without masked values."""
    try:
        found = np.asarray(value)
        of_list = np.asarray(value, object).flat if isinstance(value, list | tuple) else ()
        if {bool, np.bool_} & {*map(type, of_list)}:
            raise TypeError  # NumPy makes 1 and 0 of True and False among numbers
    except (ValueError, TypeError, RuntimeError):  # a ragged list, a tensor with a gradient
        found = np.empty(0, object)
    if found.dtype.kind not in "iuf" or np.ma.is_masked(value):
        raise _wrong(value, name, "an array of numbers")
    return found


def vector(value: object, name: str, size: int | None = None) -> np.ndarray:
    """(n,) float64, all finite. size: n, None for any."""
    found = array(value, name)
    if found.ndim != 1 or (size is not None and found.size != size):
        expected = f"({'n' if size is None else size},)"
        raise T2TwinError(f"{name} has shape {found.shape}; expected {expected}")
    if not np.isfinite(found).all():
        raise T2TwinError(f"{name} has values that are not finite; expected finite numbers")
    return found.astype(np.float64)


def describe(value: object) -> str:
    """A value in one line for a message: its type, and its repr."""
    return f"{' '.join(reprlib.repr(value).split())} of type {type(value).__name__}"


def _items(values: object, name: str) -> Sequence[object]:
    if not isinstance(values, Sequence) or isinstance(values, str | bytes | bytearray):
        raise _wrong(values, name, "a list")
    return values


def _wrong(value: object, name: str, expected: str) -> T2TwinError:
    return T2TwinError(f"{name} is {describe(value)}; expected {expected}")
