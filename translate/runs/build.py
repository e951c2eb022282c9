"""Builds the translator of a run, on this machine's device and in its precision."""

import torch

from t2twin.core.machine import processor_flags
from t2twin.translate.models.base import Translator
from t2twin.translate.models.distributed import device
from t2twin.translate.models.field import FieldTranslator
from t2twin.translate.models.presets import CYSKIN_TO_DIGIT
from t2twin.translate.models.resnet18 import ResNet18Translator
from t2twin.translate.models.touch2touch import CySkinToDigit, Touch2Touch
from t2twin.translate.runs.config import RunConfig

TRANSLATORS: dict[str, type[Touch2Touch | ResNet18Translator | FieldTranslator]] = {
    "touch2touch": Touch2Touch,
    "resnet18": ResNet18Translator,
    "field": FieldTranslator,
}
"""Translators from DIGIT to CySkin by model; all take preset, dataset, device and bf16."""

BF16_INSTRUCTIONS = ("avx512_bf16", "amx_bf16")
"""Processors with one of these compute faster in bfloat16 than in float32 (measured on one that has
both)."""


def build(config: RunConfig) -> Translator:
    """The translator of a run with initial weights, which depend on the run's seed.

    The state of torch's random number generator does not change.
    """
    with torch.random.fork_rng(devices=[]):  # weights are initialized on the CPU
        torch.default_generator.manual_seed(config.seed)
        reverse = config.direction == CYSKIN_TO_DIGIT
        kind = CySkinToDigit if reverse else TRANSLATORS[config.model]
        return kind(config.preset, config.data, device(), config.bf16)


def has_bf16() -> bool:
    """Whether the processor has bfloat16 instructions; without them, bf16 is slower."""
    if torch.cuda.is_available():
        return torch.cuda.is_bf16_supported(including_emulation=False)
    query = getattr(torch.cpu, "get_capabilities", None)  # missing in older versions of torch
    found = query() if query else dict.fromkeys(processor_flags(), True)
    return any(found.get(name) for name in BF16_INSTRUCTIONS)
