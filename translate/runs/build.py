"""Translators by the name of their model, on the device and in the precision of this machine."""

from pathlib import Path

import torch

from t2twin.translate.models.base import Translator
from t2twin.translate.models.distributed import device
from t2twin.translate.models.field import FieldTranslator
from t2twin.translate.models.presets import CYSKIN_TO_DIGIT
from t2twin.translate.models.resnet18 import ResNet18Translator
from t2twin.translate.models.reverse import CySkinToDigit
from t2twin.translate.models.touch2touch import Touch2Touch
from t2twin.translate.runs.config import RunConfig

TRANSLATORS: dict[str, type[Touch2Touch | ResNet18Translator | FieldTranslator]] = {
    "touch2touch": Touch2Touch,
    "resnet18": ResNet18Translator,
    "field": FieldTranslator,
}
"""What makes a translator of each model: from preset, data set, device, and whether in bf16."""


def build(config: RunConfig) -> Translator:
    """The translator of a run with fresh weights, drawn from the run's seed.

    torch's random numbers go on as if they had not been drawn from.
    """
    with torch.random.fork_rng(devices=[]):  # weights are drawn on the CPU, whatever the device
        torch.default_generator.manual_seed(config.seed)
        kind = CySkinToDigit if config.direction == CYSKIN_TO_DIGIT else TRANSLATORS[config.model]
        return kind(config.preset, config.data, device(), config.bf16)


def has_bf16() -> bool:
    """Whether the processor multiplies bfloat16 itself; where it does not, bf16 is slower."""
    if torch.cuda.is_available():
        return torch.cuda.is_bf16_supported(including_emulation=False)
    cpu = Path("/proc/cpuinfo")
    flags = cpu.read_text().split() if cpu.is_file() else []
    return "avx512_bf16" in flags or "amx_bf16" in flags
