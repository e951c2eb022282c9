"""Keys that version 0.3.0 renamed, for the readers of files that version 0.2 wrote."""

from typing import Any

KEYS: dict[str, dict[str, str]] = {
    "json": {
        "start_sha256": "init_from_sha256",
        "shape_weight": "iou_weight",
        "pictures": "ood_detector",
        "spread_grey": "std_grey",
        "farthest": "max_distance",
    },
    "safetensors": {
        "place_rungs": "place_knots",
        "press_rungs": "press_knots",
        "force_rungs": "force_knots",
    },
}


def translated(kind: str, content: Any) -> Any:
    """The content with its old keys renamed, at every depth. kind: "json" or "safetensors"."""
    if isinstance(content, dict):
        return {KEYS[kind].get(k, k): translated(kind, each) for k, each in content.items()}
    return [translated(kind, each) for each in content] if isinstance(content, list) else content
