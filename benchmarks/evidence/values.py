"""Values in a results file by dotted paths."""

from collections.abc import Iterator
from typing import Any

from t2twin.core.errors import T2TwinError

EVERY = "*"


def values(content: Any, path: str) -> dict[str, Any]:
    """The values at a path, by their full paths. A * in the path matches every key.

    A path through null has no value. Raises T2TwinError for a path that does not exist.
    """
    return dict(_walk(content, path.split("."), []))


def value(content: Any, path: str) -> Any:
    """The value at a path without *. Raises T2TwinError if there is none."""
    at_path = values(content, path)
    if path not in at_path:
        raise T2TwinError(f"the results have nothing at {path}")
    return at_path[path]


def _walk(content: Any, keys: list[str], before: list[str]) -> Iterator[tuple[str, Any]]:
    if not keys:
        yield ".".join(before), content
        return
    if content is None:
        return
    key, *rest = keys
    if isinstance(content, list) and key.isdigit() and int(key) < len(content):
        yield from _walk(content[int(key)], rest, [*before, key])
    elif isinstance(content, dict) and key == EVERY:
        for each, part in content.items():
            yield from _walk(part, rest, [*before, each])
    elif isinstance(content, dict) and key in content:
        yield from _walk(content[key], rest, [*before, key])
    else:
        raise T2TwinError(f"the results have nothing at {'.'.join([*before, key])}")
