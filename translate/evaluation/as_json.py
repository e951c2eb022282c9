"""Records as JSON has them."""

from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from typing import Any


def as_json(value: Any) -> Any:
    """A record, or a dict of them, in dicts, lists and numbers, as its file holds it.

    A field that may be left out, its default being None, is left out where it is None.
    """
    if is_dataclass(value):
        content = {field.name: getattr(value, field.name) for field in fields(value)}
        optional = {field.name for field in fields(value) if field.default is not MISSING}
        return {
            name: as_json(part)
            for name, part in content.items()
            if not (part is None and name in optional)
        }
    if isinstance(value, Mapping):
        return {name: as_json(part) for name, part in value.items()}
    if isinstance(value, (tuple, list)):
        return [as_json(part) for part in value]
    return value
