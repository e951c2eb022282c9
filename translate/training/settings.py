"""The settings of a training: its preset, adapted to the arguments of `train`, and their checks."""

import math
from dataclasses import replace

from t2twin.core import arguments
from t2twin.core.arguments import check_seed
from t2twin.core.errors import T2TwinError
from t2twin.translate.models.presets import DIGIT_TO_CYSKIN, REVERSIBLE, Preset
from t2twin.translate.runs.config import MAX_STEPS

WARM_START_SHARE = 0.3
"""Learning rate after a warm start, divided by the preset's (assumed)."""


def check_limits(epochs: int | None, minutes: float | None, steps: int | None, seed: int) -> None:
    """Raises T2TwinError for limits and seeds that are out of range, and for epochs with steps."""
    for name, value in (("steps", steps), ("epochs", epochs)):
        if value is not None:
            arguments.whole_number(value, name)
    if minutes is not None:
        minutes = arguments.real(minutes, "minutes")
    if steps is not None and not 1 <= steps <= MAX_STEPS:
        raise T2TwinError(f"steps is {steps}; it must be from 1 to {MAX_STEPS:,}")
    if steps is not None and epochs is not None:
        raise T2TwinError("epochs and steps are both given; expected at most one of them")
    if epochs is not None and epochs < 1:
        raise T2TwinError(f"epochs is {epochs}; it must be at least 1")
    if minutes is not None and not (minutes > 0 and math.isfinite(minutes)):
        raise T2TwinError(f"minutes is {minutes:g}; it must be more than 0")
    check_seed(seed)


def for_steps(preset: Preset, steps: int | None) -> Preset:
    """The preset for a number of steps, None for its own.

    With more steps than the preset's, the discriminator's learning rate is reduced in proportion.
    With the full rate and three times the steps, the discriminator dominates in the second half,
    and L1 and validation error increase.
    """
    if preset.l1_weight == 0.0 or not preset.steps or steps is None or steps <= preset.steps:
        return preset
    share = preset.discriminator_share * preset.steps / steps
    return replace(preset, discriminator_share=share)


def with_iou_weight(preset: Preset, weight: float | None, model: str, direction: str) -> Preset:
    """The preset with a weight of the soft IoU loss, None for its own.

    Raises T2TwinError for a negative weight, and for a model or direction without tactile images.
    """
    weight = preset.iou_weight if weight is None else arguments.real(weight, "iou_weight")
    if not (weight >= 0 and math.isfinite(weight)):
        raise T2TwinError(f"iou_weight is {weight:g}; it must be 0 or more")
    if weight and not (model == REVERSIBLE and direction == DIGIT_TO_CYSKIN):
        raise T2TwinError(
            f"iou_weight is {weight:g}, but a {model} {direction} run predicts no tactile image; "
            f"expected 0, or {REVERSIBLE} {DIGIT_TO_CYSKIN}"
        )
    return replace(preset, iou_weight=weight)


def after_warm_start(preset: Preset) -> Preset:
    """The preset with the lower learning rate for trained initial weights."""
    return replace(preset, learning_rate=WARM_START_SHARE * preset.learning_rate)


def check_processes(preset: Preset, processes: int) -> None:
    """Raises T2TwinError for a batch that the processes cannot divide evenly."""
    if preset.batch % processes:
        raise T2TwinError(
            f"a batch of {preset.batch} cannot be shared by {processes} processes; their number "
            "must divide it"
        )
