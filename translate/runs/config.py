"""What a run's folder says of it: config.json, enough to build its networks again.

RUN/config.json        model, preset, seed, data set and layout, epochs, versions
RUN/log.jsonl          one line an epoch
RUN/tensorboard/       the same for TensorBoard
RUN/last.safetensors   state after the last epoch, to go on from
RUN/best.safetensors   weights of the epoch with the lowest validation L3
RUN/README.md          the model card, once the training is done
"""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from t2twin.primitives_cad.errors import T2TwinError
from t2twin.primitives_cad.writing import write_json
from t2twin.translate.data.pairs import DataInfo
from t2twin.translate.presets import Preset, find_preset
from t2twin.translate.resnet18 import ResNet18Translator
from t2twin.translate.touch2touch import Touch2Touch

CONFIG = "config.json"
LOG = "log.jsonl"
TENSORBOARD = "tensorboard"
LAST = "last.safetensors"
BEST = "best.safetensors"


@dataclass(frozen=True)
class RunConfig:
    """What a run was asked to do.

    epochs, minutes: as asked for, None where the preset decides. planned_epochs: how many that
    came to; with a limit in minutes it depends on the machine, so it is decided once. processes:
    how many share each batch.
    """

    model: str
    preset: Preset
    seed: int
    data: DataInfo
    epochs: int | None
    minutes: float | None
    planned_epochs: int
    bf16: bool
    processes: int

    def as_json(self) -> dict[str, Any]:
        return {
            "model": self.model,
            "preset": asdict(self.preset),
            "seed": self.seed,
            "epochs": self.epochs,
            "minutes": self.minutes,
            "planned_epochs": self.planned_epochs,
            "bf16": self.bf16,
            "processes": self.processes,
            "data": self.data.as_json(),
            "versions": {"torch": torch.__version__, "numpy": np.__version__},
        }

    def save(self, run_dir: Path) -> None:
        write_json(run_dir / CONFIG, self.as_json())


def load_config(run_dir: Path) -> RunConfig:
    """Raises T2TwinError where the folder holds no run."""
    path = run_dir / CONFIG
    if not path.is_file():
        raise T2TwinError(f"{run_dir} holds no config.json; give a folder that `train` has made")
    try:
        content = json.loads(path.read_text())
        return RunConfig(
            model=content["model"],
            preset=find_preset(content["model"], Preset(**content["preset"])),
            seed=content["seed"],
            data=DataInfo.from_json(content["data"]),
            epochs=content["epochs"],
            minutes=content["minutes"],
            planned_epochs=content["planned_epochs"],
            bf16=content["bf16"],
            processes=content["processes"],
        )
    except (ValueError, KeyError, TypeError):
        raise T2TwinError(
            f"{path} is not a run's config; train again into another folder"
        ) from None


def build(config: RunConfig) -> Touch2Touch | ResNet18Translator:
    """The networks of a run with fresh weights, drawn from its seed."""
    torch.manual_seed(config.seed)
    kind = Touch2Touch if config.model == "touch2touch" else ResNet18Translator
    return kind(config.preset, config.data, device(), config.bf16)


def device() -> torch.device:
    """A GPU where there is one."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


def has_bf16() -> bool:
    """Whether the processor multiplies bfloat16 itself; where it does not, bf16 is slower."""
    if torch.cuda.is_available():
        return torch.cuda.is_bf16_supported(including_emulation=False)
    cpu = Path("/proc/cpuinfo")
    flags = cpu.read_text().split() if cpu.is_file() else []
    return "avx512_bf16" in flags or "amx_bf16" in flags
