"""Arrays and mappings that records and caches keep: read-only, so that no caller changes them."""

from collections.abc import Callable
from functools import cached_property, wraps
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np

Value = TypeVar("Value")


def kept(value: Any) -> Any:
    """A read-only copy of an array or a dict that can be written; a tuple with such copies."""
    if isinstance(value, np.ndarray) and value.flags.writeable:
        value = np.array(value)
        value.setflags(write=False)
    if type(value) is dict:
        return MappingProxyType({**value})
    return tuple(map(kept, value)) if type(value) is tuple else value


def kept_property(compute: Callable[[Any], Value]) -> cached_property[Value]:
    """A cached property whose arrays are read-only."""
    return cached_property(wraps(compute)(lambda owner: kept(compute(owner))))


class Record:
    """Base of frozen dataclasses whose arrays are their own, read-only also in copies.

    They are declared with eq=False, as arrays have no truth value, and compared by identity.
    """

    def __post_init__(self) -> None:
        self.__setstate__(vars(self))

    def __getstate__(self) -> dict[str, Any]:
        return {
            name: {**value} if isinstance(value, MappingProxyType) else value  # for pickle
            for name, value in vars(self).items()
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update({name: kept(value) for name, value in state.items()})


class Result(Record):
    """Base of records of arrays that this package has just made: read-only views, not copies."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray) and value.flags.writeable:
                vars(self)[name] = view = value.view()
                view.setflags(write=False)
