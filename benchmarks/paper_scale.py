"""What the results at the paper's scale were asked to be, which no small case shows: every press of
the dataset, and the settings of the trainings."""

from dataclasses import asdict
from typing import Any

from benchmarks.evidence.small_case import rounded, sha256_of
from t2twin.primitives_cad import catalogue
from t2twin.sim.world import protocol
from t2twin.translate.models.presets import PAPER_MODELS, PRESETS

SCALE, PRESET = "paper", "cpu"

NEWER = ("iou_weight",)
"""Settings that came after results were measured: where they are off, nothing is otherwise."""


def presses_sha256() -> str:
    """One sha256 over all presses of the scale: shape, place, turn and force."""
    scale = protocol.scale_of(SCALE)
    commands = (
        protocol.press_of(name, catalogue.spacing_mm(name), index)
        for name in catalogue.NAMES
        for index in protocol.indices(name, scale)
    )
    return sha256_of(rounded([list(asdict(command).values()) for command in commands]))


def settings() -> dict[str, dict[str, Any]]:
    """The preset by model."""
    return {model: _set(asdict(PRESETS[model][PRESET])) for model in PAPER_MODELS}


def _set(preset: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in preset.items() if value or name not in NEWER}
