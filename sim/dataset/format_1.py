"""Reads datasets of format 1, which versions up to 0.3 wrote: of a DIGIT and a CySkin.

Their columns and the keys of their info.json get the names of format 2.
"""

from typing import Any

from t2twin.sim.dataset.columns import CONTACT, MOTION, TRACTIONS, column

SENSORS = {"source": "digit", "target": "cyskin"}
"""Names of the sensors, by role."""

COLUMNS = {
    "source_image": "image",
    "target_counts": "taxels",
    "source_unit": "unit",
    "source_background": "background",
    "source_markers": "markers",
    "target_dense_counts": "dense_counts",
    **{column("target", name): f"cover_{name}" for name in TRACTIONS},
    **{
        column(role, name): f"{sensor}_{name}"
        for role, sensor in SENSORS.items()
        for name in (*CONTACT, *MOTION)
    },
}
"""Columns of format 1 by those of format 2; the others have the same name."""

VIEW_MM = (6.25, 25 / 3)
"""Half of what a DIGIT's image shows along x and y, mm: 240 x 320 pixels at 19.2 px/mm."""

TACTILE_IMAGE = (396, 240, 8.8)
"""Rows, columns and px/mm of the tactile image."""

IMAGE_SHAPE = (320, 240, 3)
"""Rows, columns and channels of a DIGIT's image."""

COVER = {
    "name": "cyskin", "thickness_mm": 2.5, "young_mpa": 0.1, "poisson": 0.47, "width_mm": 28.0,
    "length_mm": 46.0,
}  # fmt: skip
"""The CySkin's cover."""

RATE_HZ = 10.0
"""Readings per second of the CySkin."""


def converted(content: dict[str, Any]) -> dict[str, Any]:
    """The content of an info.json of format 1 with the keys of format 2; format remains 1."""
    parameters = content.get("parameters") or {}
    camera, array = dict(parameters.get("digit") or {}), dict(parameters.get("cyskin") or {})
    source = {
        "name": "digit",
        "value": "image",
        "image_shape": content.get("image_shape"),
        "view_mm": VIEW_MM,
        "noise_grey": camera.pop("noise_grey", None),
        "optics_sha256": camera.pop("optics_sha256", None),
    }
    target = {
        "name": "cyskin-20",
        "value": "counts",
        "layout": content.get("layout"),
        "x_mm": content.get("layout_x_mm", ()),
        "y_mm": content.get("layout_y_mm", ()),
        "pad_diameter_mm": array.pop("pad_diameter_mm", None) or content.get("pad_diameter_mm"),
        "full_scale_counts": content.get("full_scale_counts"),
        "tactile_image": TACTILE_IMAGE,
        "readings": array.pop("readings", None),
        "imperfections": array.pop("imperfections", None),
        "dense_x_mm": content.get("dense_x_mm"),
        "dense_y_mm": content.get("dense_y_mm"),
    }
    array.pop("gain_counts", None)
    for sensor, layer in ((source, camera), (target, array)):
        sensor["pitch_mm"] = layer.pop("pitch_mm", None)
        sensor["elastomer"] = layer or None
    kept = (
        "format", "complete", "pairs", "versions", "shards", "scale", "seed", "origin", "recipe",
        "shape_code", "files",
    )  # fmt: skip
    return {key: content[key] for key in kept if key in content} | {
        "source": source,
        "target": target,
        "shapes": parameters.get("shapes"),
    }
