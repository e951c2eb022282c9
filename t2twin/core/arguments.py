"""Checks of the arguments of public functions.

Each check takes the value and the name of an argument, and returns the value in its final type. A
wrong type or value raises a T2TwinError of one sentence. NumPy's scalars are numbers; bool is not.
"""

import errno
import math
import os
from collections.abc import Sequence
from numbers import Integral, Real
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from t2twin.core.errors import T2TwinError

MAX_SEED = 2**63 - 1
"""The largest seed that NumPy, PyTorch and JSON readers accept."""

MAX_VALUE_CHARACTERS = 40
"""Characters of a value in a message (assumed: the sentence stays on one line)."""

Kind = TypeVar("Kind")


def real(value: object, name: str) -> float:
    """A number as a float, which may be infinite or NaN. Raises T2TwinError for anything else."""
    if type(value) is float:  # fast path
        return value
    if not isinstance(value, Real) or isinstance(value, bool):
        raise _wrong(value, name, "a number")
    try:
        return float(value)
    except OverflowError:  # a whole number beyond the largest float
        return math.inf if value > 0 else -math.inf  # pyright: ignore[reportOperatorIssue]


def number(value: object, name: str, low: float = -math.inf, high: float = math.inf) -> float:
    """A finite number in [low, high], as a float. Raises T2TwinError for anything else."""
    found = real(value, name)
    if not math.isfinite(found):
        raise T2TwinError(f"{name} is {found:g}; expected a finite number")
    if not low <= found <= high:
        raise T2TwinError(f"{name} is {found:g}; expected a number {_between(low, high)}")
    return found


def whole_number(value: object, name: str, low: int | None = None, high: int | None = None) -> int:
    """A whole number in [low, high], as an int; None for no bound.

    Raises T2TwinError for anything else.
    """
    if not isinstance(value, Integral) or isinstance(value, bool):
        raise _wrong(value, name, "a whole number")
    found = int(value)
    if (low is not None and found < low) or (high is not None and found > high):
        bounds = _between(-math.inf if low is None else low, math.inf if high is None else high)
        raise T2TwinError(f"{name} is {found}; expected a whole number {bounds}")
    return found


def flag(value: object, name: str) -> bool:
    """True or False. Raises T2TwinError for anything else."""
    if not isinstance(value, bool | np.bool_):
        raise _wrong(value, name, "True or False")
    return bool(value)


def path(value: object, name: str) -> Path:
    """A path. Raises T2TwinError for anything but str and PathLike, and for an invalid path: empty,
    too long for the file system, or with characters that file names cannot contain."""
    if not isinstance(value, str | os.PathLike):
        raise _wrong(value, name, "a path")
    text = os.fspath(value)
    if not isinstance(text, str) or not text:
        raise _wrong(value, name, "a path")
    try:
        os.lstat(text)
    except ValueError:  # a null character, or a character that cannot be encoded
        raise _wrong(value, name, "a path") from None
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            raise T2TwinError(f"{name} is {_short_repr(value)}; expected a shorter path") from None
    return Path(text)


def paths(values: object, name: str) -> list[Path]:
    """A list or a tuple of paths. Raises T2TwinError for anything else."""
    return [path(value, f"{name}[{n}]") for n, value in enumerate(_items(values, name, "paths"))]


def texts(values: object, name: str) -> list[str]:
    """A list or a tuple of str. Raises T2TwinError for anything else."""
    return [text(value, f"{name}[{n}]") for n, value in enumerate(_items(values, name, "names"))]


def instance(value: object, name: str, kind: type[Kind]) -> Kind:
    """An instance of a class. Raises T2TwinError for anything else."""
    if not isinstance(value, kind):
        raise _wrong(value, name, f"an object of the class {kind.__name__}")
    return value


def function(value: object, name: str) -> None:
    """Raises T2TwinError for anything that is not callable."""
    if not callable(value):
        raise _wrong(value, name, "a function")


def choice(value: object, name: str, allowed: Sequence[str]) -> str:
    """One of the allowed strings. Raises T2TwinError for anything else."""
    if not isinstance(value, str) or value not in allowed:
        raise _wrong(value, name, f"one of {', '.join(allowed)}")
    return value


def text(value: object, name: str) -> str:
    """A str. Raises T2TwinError for anything else."""
    if not isinstance(value, str):
        raise _wrong(value, name, "text")
    return value


def array(value: object, name: str) -> np.ndarray:
    """An array of integers or floats, of any shape. Raises T2TwinError for anything else."""
    try:
        found = np.asarray(value)
    except (ValueError, TypeError, RuntimeError):  # a ragged list, a tensor with a gradient
        found = np.empty(0, object)
    if found.dtype.kind not in "iuf":
        raise _wrong(value, name, "an array of numbers")
    return found


def vector(value: object, name: str, size: int | None = None) -> np.ndarray:
    """(n,) float64, all finite. size: n, None for any. Raises T2TwinError for anything else."""
    found = array(value, name)
    if found.ndim != 1 or (size is not None and found.size != size):
        raise T2TwinError(
            f"{name} has shape {found.shape}; expected ({'n' if size is None else size},)"
        )
    found = found.astype(np.float64)
    if not np.isfinite(found).all():
        raise T2TwinError(f"{name} has values that are not finite; expected finite numbers")
    return found


def check_seed(seed: int) -> None:
    """Raises T2TwinError for a seed that is not a whole number from 0 to MAX_SEED."""
    whole_number(seed, "seed")
    if not 0 <= seed <= MAX_SEED:
        raise T2TwinError(f"the seed is {seed}; it must be a whole number from 0 to {MAX_SEED}")


def describe(value: object) -> str:
    """A value in one line for a message: its repr, or its type where that is long."""
    kind = type(value).__name__
    shape: Any = getattr(value, "shape", None)
    if isinstance(shape, tuple) and shape:
        return f"of type {kind}, shape {tuple(shape)} and {getattr(value, 'dtype', 'no dtype')}"
    if value is None or isinstance(value, str | bytes | bool | int | float | complex | Path):
        text = _short_repr(value)
        return text if value is None else f"{text} of type {kind}"
    return f"of type {kind}"


def _short_repr(value: object) -> str:
    if isinstance(value, int) and not isinstance(value, bool) and value.bit_length() > 128:
        return "a very large number"  # Python does not print integers of thousands of digits
    text = str(value) if isinstance(value, Path | np.generic) else repr(value)
    text = "".join(letter if letter.isprintable() else "?" for letter in text)
    return text if len(text) <= MAX_VALUE_CHARACTERS else f"{text[:MAX_VALUE_CHARACTERS]}..."


def _items(values: object, name: str, of: str) -> Sequence[object]:
    if not isinstance(values, Sequence) or isinstance(values, str | bytes | bytearray):
        raise _wrong(values, name, f"a list of {of}")
    return values


def _wrong(value: object, name: str, expected: str) -> T2TwinError:
    return T2TwinError(f"{name} is {describe(value)}; expected {expected}")


def _between(low: float, high: float) -> str:
    if math.isinf(high):
        return f"of at least {low:g}"
    return f"of at most {high:g}" if math.isinf(low) else f"from {low:g} to {high:g}"
