"""Names and colors, the same on the whole page."""

import numpy as np

from t2twin.translate.evaluation.metrics.baselines import MEAN_ARRAY, NEAREST_NEIGHBOR
from t2twin.translate.evaluation.metrics.floors import LAYOUT_FLOOR, NOISE_FLOOR
from t2twin.translate.evaluation.metrics.forces import MEAN_ARRAY_OF_FORCE

NAMES = {
    MEAN_ARRAY: "mean array",
    MEAN_ARRAY_OF_FORCE: "mean array of the force",
    NEAREST_NEIGHBOR: "nearest neighbor",
    NOISE_FLOOR: "noise floor",
    LAYOUT_FLOOR: "layout floor",
    "resnet18": "ResNet18",
    "touch2touch": "touch2touch",
    "field": "field",
}
BASELINE_COLORS = {
    MEAN_ARRAY: "#222222",
    MEAN_ARRAY_OF_FORCE: "#888888",
    NEAREST_NEIGHBOR: "#009e73",
}
RUN_COLORS = ("#0072b2", "#d55e00", "#cc79a7", "#e69f00", "#56b4e9")
SENSOR_COLORS = {"digit": "#0072b2", "cyskin": "#e69f00"}
"""Colours that readers with any color vision tell apart (Okabe and Ito 2008)."""

SPLIT_COLORS = {"train": "#999999", "val": "#0072b2", "test": "#d55e00"}
SPLIT_NAMES = {"train": "training", "val": "validation", "test": "test"}
SENSOR_NAMES = {"digit": "DIGIT", "cyskin": "CySkin"}

FORCES_NAMED = 6
"""Different forces that are named one by one."""

LONGEST_NAME, KEPT_END = 20, 6
"""Letters of a shape's name that are shown, and those of its end among them (assumed: they leave
half of a phone's width to the bars beside them)."""


def name_of(model: str) -> str:
    """A model as a person writes it: `resnet18 (seed-1)` is "ResNet18 (seed-1)"."""
    kind, space, rest = model.partition(" ")
    return NAMES.get(kind, kind) + space + printable(rest)


def shape_name(shape: str) -> str:
    """A shape's name as it is shown: in one line, without its middle where it is long."""
    name = printable(shape)
    if len(name) <= LONGEST_NAME:
        return name
    return f"{name[: LONGEST_NAME - KEPT_END - 1]}…{name[-KEPT_END:]}"


def forces_in_words(forces_n: np.ndarray) -> str:
    """As in "8 N", "1, 2 and 8 N" or "0.52 to 11.9 N". forces_n: (k,) rising, each once; those that
    touch nothing, 0, are not named."""
    touching = [f"{force:.3g}" for force in forces_n if force > 0]
    if not touching:
        return "none"
    if len(touching) > FORCES_NAMED:
        return f"{touching[0]} to {touching[-1]} N"
    last = touching.pop()
    return f"{', '.join(touching)} and {last} N" if touching else f"{last} N"


def printable(text: str) -> str:
    """The text with a space for all that has no glyph, such as a new line."""
    return "".join(letter if letter.isprintable() else " " for letter in text)


def colors(models: list[str]) -> dict[str, str]:
    """A color each; runs take theirs in turn."""
    runs = [model for model in models if model not in BASELINE_COLORS]
    return BASELINE_COLORS | {run: RUN_COLORS[i % len(RUN_COLORS)] for i, run in enumerate(runs)}
