"""Wrong values for a field of JSON, by the kind of value that belongs there."""

import json
from typing import Any

Change = tuple[str, Any]
"""A field, its keys and places in lists between dots, and its new value; ... takes it away."""

WRONG: dict[str, tuple[Any, ...]] = {
    "int": (..., None, "many", [], 1.5, True, float("nan")),
    "float": (None, "many", [], {}, True, float("nan"), float("inf")),
    "bool": (..., None, "yes", 1, []),
    "str": (..., None, 3, [], {}),
    "list": (..., None, "many", 3, ["many"], [None]),
    "dict": (..., None, "many", 3, []),
}
"""Values that no field of a kind may have."""


def changed(text: str, field: str, value: Any) -> str:
    """JSON text with one field changed."""
    content = json.loads(text)
    keys, place = field.split("."), content
    # A key may hold a dot itself: train/circle-1.parquet.
    if ".parquet" in field:
        first, _, rest = field.partition(".parquet")
        keys = [*first.split(".", 1)[:1], first.split(".", 1)[1] + ".parquet"]
        keys += rest.removeprefix(".").split(".") if rest else []
    for key in keys[:-1]:
        place = place[int(key) if isinstance(place, list) else key]
    last: Any = int(keys[-1]) if isinstance(place, list) else keys[-1]
    if value is ...:
        del place[last]
    else:
        place[last] = value
    return json.dumps(content)
