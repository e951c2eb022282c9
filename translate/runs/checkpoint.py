"""The networks of a run: built from its configuration, saved, restored, and averaged.

Weights and the state of a training are safetensors files. The state contains no random numbers:
each step has its own generators, seeded by (seed, epoch, step).
"""

import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import load_file, save_file
from torch import nn

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write
from t2twin.core.machine import processor_flags
from t2twin.core.records import decode_json
from t2twin.sim.dataset.columns import COUNTS, IMAGE
from t2twin.translate.models.base import Translator
from t2twin.translate.models.distributed import device
from t2twin.translate.models.field import FieldTranslator
from t2twin.translate.models.field_net import CONTACT, SHEAR
from t2twin.translate.models.frame_check import FrameCheck
from t2twin.translate.models.resnet18 import ResNet18Translator
from t2twin.translate.models.touch2touch import Pix2Pix, Touch2Touch
from t2twin.translate.runs.card import CARD
from t2twin.translate.runs.config import BEST, CONFIG, FRAME_CHECK, LOG, RunConfig, TrainingState

# Translators by value of the target and by model; all take preset, dataset, device and bf16
TRANSLATORS: dict[str, dict[str, Any]] = {
    COUNTS: {"touch2touch": Touch2Touch, "resnet18": ResNet18Translator, "field": FieldTranslator},
    IMAGE: {"touch2touch": Pix2Pix},
}
# Processors with one of these compute faster in bfloat16 than in float32 (measured on one that has
# both)
BF16_INSTRUCTIONS = ("avx512_bf16", "amx_bf16")


def build(config: RunConfig) -> Translator:
    """The translator of a run with initial weights by its seed; torch's own generator stays."""
    with torch.random.fork_rng(devices=[]):  # weights are initialized on the CPU
        torch.default_generator.manual_seed(config.seed)
        kind = TRANSLATORS[config.data.target.value][config.model]
        translator = kind(config.preset, config.data, device(), config.bf16)
    translator.is_contact_alone = config.contact_data is not None
    return translator


def has_bf16() -> bool:
    """Whether the processor has bfloat16 instructions; without them, bf16 is slower."""
    if torch.cuda.is_available():
        return torch.cuda.is_bf16_supported(including_emulation=False)
    query = getattr(torch.cpu, "get_capabilities", None)  # missing in older versions of torch
    found = query() if query else dict.fromkeys(processor_flags(), True)
    return any(found.get(name) for name in BF16_INSTRUCTIONS)


PROGRESS = "progress"  # Key of a state's metadata
MEAN = "mean"  # Name of the weight average in the state


def save_weights(
    path: Path, tensors: Mapping[str, torch.Tensor], metadata: dict[str, str] | None = None
) -> None:
    """Writes tensors by name, such as the state of a network."""
    # safetensors needs contiguous tensors; channels-last weights are not.
    in_order = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    with atomic_write(path) as temporary:
        try:
            save_file(in_order, temporary, metadata)
        except SafetensorError as error:  # its text names the cause, such as a full disk
            raise T2TwinError(f"{path} cannot be written ({error})") from error
        temporary.chmod(0o644)  # safetensors restricts it to the owner


def load_weights(path: Path, network: nn.Module, optional: tuple[str, ...] = ()) -> None:
    """Reads the weights of one network. optional: first letters of names that may differ.

    Raises T2TwinError if the file is missing, is of another network or has non-finite numbers.
    """
    if not path.is_file():
        raise T2TwinError(f"{path} does not exist; the run has not finished its first epoch")
    try:
        weights = load_file(path)
        _check_finite(path, weights)
        own = {n: each for n, each in network.state_dict().items() if n.startswith(optional)}
        required = {n: each for n, each in weights.items() if not n.startswith(optional)}
        network.load_state_dict(required | {n: weights.get(n, own[n]) for n in own})
    except (SafetensorError, RuntimeError):
        raise T2TwinError(f"{path} does not fit the networks of its config.json") from None


def load_frame_check(run_dir: Path) -> FrameCheck | None:
    """The frame check of a run, None without one. Raises T2TwinError for a damaged file."""
    path = run_dir / FRAME_CHECK
    if not path.is_file():
        return None
    try:
        weights = load_file(path)
        check = FrameCheck(weights["center"].numel())
        check.load_state_dict(weights)
        if any(each.isnan().any() for each in weights.values()):
            raise KeyError("numbers")
    except (SafetensorError, RuntimeError, KeyError):
        raise T2TwinError(
            f"{path} is not a frame check of this version; remove it, and `t2twin "
            f"calibrate-uncertainty {run_dir} --data DATASET` writes another"
        ) from None
    return check.eval()


def save_state(path: Path, translator: Translator, progress: TrainingState) -> None:
    """Writes the state of a training."""
    tensors = {
        f"network/{name}/{key}": tensor
        for name, network in _networks(translator).items()
        for key, tensor in network.state_dict().items()
    }
    for name, optimizer in translator.optimizers.items():
        for number, state in optimizer.state_dict()["state"].items():
            for key, tensor in state.items():
                tensors[f"optimizer/{name}/{number}/{key}"] = tensor
    save_weights(path, tensors, {PROGRESS: msgspec.json.encode(progress).decode()})


def load_state(path: Path, translator: Translator) -> TrainingState:
    """Restores a saved state. Raises T2TwinError for one that is damaged or of other networks."""
    progress = load_progress(path)
    try:
        state = load_file(path)
        _check_finite(path, state)
        for name, network in _networks(translator).items():
            network.load_state_dict(_part(state, f"network/{name}/"))
        for name, optimizer in translator.optimizers.items():
            states: dict[int, dict[str, torch.Tensor]] = {}
            for key, tensor in _part(state, f"optimizer/{name}/").items():
                number, field = key.split("/")
                states.setdefault(int(number), {})[field] = tensor
            groups = optimizer.state_dict()["param_groups"]
            optimizer.load_state_dict({"state": states, "param_groups": groups})
            for parameter, values in optimizer.state.items():
                for field, tensor in values.items():
                    if tensor.shape == parameter.shape:
                        # The fused Adam needs equal memory layouts of both.
                        values[field] = torch.empty_like(parameter).copy_(tensor)
    except (SafetensorError, RuntimeError, KeyError):
        raise T2TwinError(
            f"{path} is not a saved state of these networks; remove its folder to train again"
        ) from None
    return progress


def _check_finite(path: Path, tensors: dict[str, torch.Tensor]) -> None:
    for name, tensor in tensors.items():
        if not torch.isfinite(tensor).all():
            raise T2TwinError(
                f"{path} has non-finite numbers in {name}: the training diverged or the file is "
                "damaged; train again"
            )


def _part(tensors: dict[str, torch.Tensor], start: str) -> dict[str, torch.Tensor]:
    """The tensors whose names start so, by the rest of their names."""
    return {k.removeprefix(start): each for k, each in tensors.items() if k.startswith(start)}


def _networks(translator: Translator) -> dict[str, nn.Module]:
    """All trained networks, and the weight average."""
    average = translator.average
    return translator.networks | ({} if average is None else {MEAN: average})


def load_progress(path: Path) -> TrainingState:
    """The progress of a saved state. Raises T2TwinError for a damaged file."""
    try:
        with safe_open(path, "pt") as file:
            return decode_json((file.metadata() or {})[PROGRESS], TrainingState, path)
    except (SafetensorError, KeyError):
        raise T2TwinError(
            f"{path} is not a saved state of a training; remove its folder to train again"
        ) from None


AVERAGE = "average.json"  # Contains the share of the later run, for the card


def average_runs(earlier: Path, later: Path, share: float, out: Path) -> None:
    """Writes a copy of the later run whose weights are averaged; calibrate its uncertainty again.

    share: of the later run, 0 to 1. What the earlier run does not predict, or with another scale,
    is that of the later one. Raises T2TwinError for folders that are not finished runs, for runs of
    other networks, and if out exists.
    """
    arguments.number(share, "share", 0.0, 1.0)
    if out.exists():
        raise T2TwinError(f"{out} exists; give a new folder")
    weights = []
    for run in (earlier, later):
        for name, unfinished in ((BEST, "an epoch"), (CARD, "its training")):
            if not (run / name).is_file():
                raise T2TwinError(
                    f"{run / name} does not exist; the run has not finished {unfinished}"
                )
        weights.append(load_file(run / BEST))
    first, last = weights
    for part, scale in ((SHEAR, "shear_scale"), (CONTACT, "contact_scale")):
        if scale not in first or scale not in last or not torch.equal(first[scale], last[scale]):
            first = {name: each for name, each in first.items() if not name.startswith(part)}
            first |= {name: each for name, each in last.items() if name.startswith(part)}
    if {n: each.shape for n, each in first.items()} != {n: each.shape for n, each in last.items()}:
        raise T2TwinError(f"{earlier} and {later} have different networks; expected equal ones")
    mean = {  # of the later run's types; pretrained weights are stored as float16
        name: torch.lerp(first[name].float(), each.float(), share).to(each.dtype)
        for name, each in last.items()
    }
    out.mkdir(parents=True)
    for name in (CONFIG, LOG, CARD):
        shutil.copyfile(later / name, out / name)
    (out / AVERAGE).write_text(json.dumps({"share": share}), encoding="utf-8")
    save_file(mean, out / BEST)
