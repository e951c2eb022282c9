"""Fields of a recipe that have no effect, because other fields switch them off.

A field that has its default is accepted.
"""

from collections.abc import Iterator
from dataclasses import fields
from typing import Any

from t2twin.core.errors import T2TwinError
from t2twin.sim.digit.randomization.artifacts import Artifacts
from t2twin.sim.digit.randomization.ranges import UnitRanges
from t2twin.sim.world.motion import Motion

NEAR = tuple(field.name for field in fields(UnitRanges) if field.name.startswith("around_"))
"""Ranges of units that are sampled near a calibration; the others are of all other units."""

SWITCHES = (
    (UnitRanges, "leak_amount", (0.0, 0.0), ("leak_part",)),
    (UnitRanges, "linear_amount", 0.0, ("linear_gamma",)),
    (UnitRanges, "linear_amount", 1.0, ("gamma",)),
    (UnitRanges, "edge_dark_amount", (0.0, 0.0), ("edge_px", "edge_soft_px")),
    (UnitRanges, "specks", (0, 0), ("speck_px", "speck_grey")),
    (Artifacts, "streaks", (0, 0), (
        "streak_grey", "streak_px", "streak_length_px", "streak_off_deg", "streak_bend_part",
        "streak_moved_px")),
    (Artifacts, "glares", (0, 0), ("glare_grey", "glare_px")),
    (Artifacts, "worn", 0.0, ("wear_part", "speckle_part")),
    (Artifacts, "drift_grey", (0.0, 0.0), ("drift_even_part",)),
    (Motion, "slide", 0.0, ("slide_mm",)),
    (Motion, "twist", 0.0, ("twist_deg",)),
    (Motion, "still", 1.0, ("steps", "force_change")),
)  # fmt: skip
"""A record, its field, the value that switches further fields off, and these fields."""


def check_effects(recipe: Any, source: object) -> None:
    """Raises T2TwinError for a field without effect. recipe: a Recipe. source: for the message."""
    for name, of, reason in _without_effect(recipe):
        raise T2TwinError(
            f"{source}: {name} of {of} has no effect, as {reason}; leave it out or change that"
        )


def _without_effect(recipe: Any) -> Iterator[tuple[str, str, str]]:
    """Fields without effect: name, record and reason."""
    light, motion = recipe.light, recipe.motion
    for part in recipe.parts:
        of = f"the part of {part.shapes} shapes"
        if part.place != "grid" and isinstance(part.scale, str) and part.scale != "paper":
            yield "scale", of, "its place is not the grid"
        if part.split == "val" and part.val_share:
            yield "val_share", of, 'its split is "val"'
    records = [("light.draw", light.draw), ("light.artifacts", light.artifacts), ("motion", motion)]
    if light.kind == "fixed":
        plain = type(light)()
        for name in ("draw", "each"):
            if getattr(light, name) != getattr(plain, name):
                yield name, "light", 'its kind is not "drawn"'
    own = {field.name for field in fields(UnitRanges)} - {*NEAR}
    unused, state = (NEAR, "has no") if light.calibration is None else (sorted(own), "has a")
    for name in unused:
        if getattr(light.draw, name) != getattr(UnitRanges, name):
            yield name, "light.draw", f"light {state} calibration around which units are sampled"
    for of, record in records:
        for kind, switch, value, names in SWITCHES:
            if isinstance(record, kind) and getattr(record, switch) == value:
                for name in names:
                    if getattr(record, name) != getattr(kind(), name):
                        yield name, of, f"its {switch} is {value}"
    presses = [part.presses for part in recipe.parts if part.place != "grid"]
    if motion and motion.still < 1.0 and max(presses) == 1:
        yield "motion", "the recipe", "each shape has one press, and a path needs two touches"


def check_val_shares(recipe: Any, splits: set[tuple[int, str]]) -> None:
    """Raises T2TwinError for a val_share of too few shapes. recipe: a Recipe. splits: number of the
    part and split of all shards."""
    for number, part in enumerate(recipe.parts):
        if part.val_share and (number, "val") not in splits:
            raise T2TwinError(
                f"val_share of the part of {part.shapes} shapes is {part.val_share:g}, which is "
                "less than half a shape; expected a larger share, or more shapes"
            )
