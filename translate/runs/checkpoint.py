"""Weights of a network, and the state of a training: networks, optimizers and log.

Both are safetensors files. The state contains no random numbers: each epoch has its own generators,
seeded by (seed, epoch).
"""

from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import load_file, save_file
from torch import nn

from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write
from t2twin.translate.models.base import Translator
from t2twin.translate.runs.log import EpochRecord, decode_history, encode_history

HISTORY = "history"

AVERAGE = "mean"
"""Name of the weight average in the state."""


def save_weights(path: Path, network: nn.Module) -> None:
    """Writes the weights of one network."""
    _save(path, network.state_dict())


def load_weights(path: Path, network: nn.Module, optional: tuple[str, ...] = ()) -> None:
    """Reads the weights of one network.

    optional: first letters of names that the file may lack, or may have in addition.
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


def save_state(path: Path, translator: Translator, history: list[EpochRecord]) -> None:
    """Writes the state after an epoch. history: one record per epoch."""
    tensors: dict[str, torch.Tensor] = {}
    for name, network in _networks(translator).items():
        for key, tensor in network.state_dict().items():
            tensors[f"network/{name}/{key}"] = tensor
    for name, optimizer in translator.optimizers.items():
        for number, state in optimizer.state_dict()["state"].items():
            for key, tensor in state.items():
                tensors[f"optimizer/{name}/{number}/{key}"] = tensor
    _save(path, tensors, {HISTORY: encode_history(history)})


def load_state(path: Path, translator: Translator) -> list[EpochRecord]:
    """Restores a saved state. Returns its history.

    Raises T2TwinError for a damaged file, a state of other networks and non-finite numbers.
    """
    history = load_history(path)
    try:
        state = load_file(path)
    except SafetensorError:
        raise _other_state(path) from None
    _check_finite(path, state)
    try:
        _restore(state, translator)
    except (RuntimeError, KeyError, ValueError):
        raise _other_state(path) from None
    return history


def _other_state(path: Path) -> T2TwinError:
    return T2TwinError(
        f"{path} is not a saved state of these networks; remove its folder to train again"
    )


def _check_finite(path: Path, tensors: dict[str, torch.Tensor]) -> None:
    for name, tensor in tensors.items():
        if not torch.isfinite(tensor).all():
            raise T2TwinError(
                f"{path} has non-finite numbers in {name}: the training diverged or the file is "
                "damaged; train again"
            )


def _restore(tensors: dict[str, torch.Tensor], translator: Translator) -> None:
    for name, network in _networks(translator).items():
        start = f"network/{name}/"
        network.load_state_dict(
            {k.removeprefix(start): t for k, t in tensors.items() if k.startswith(start)}
        )
    for name, optimizer in translator.optimizers.items():
        start = f"optimizer/{name}/"
        states: dict[int, dict[str, torch.Tensor]] = {}
        for key, tensor in tensors.items():
            if key.startswith(start):
                number, field = key.removeprefix(start).split("/")
                states.setdefault(int(number), {})[field] = tensor
        groups = optimizer.state_dict()["param_groups"]
        optimizer.load_state_dict({"state": states, "param_groups": groups})
        for parameter, state in optimizer.state.items():
            for field, tensor in state.items():
                if tensor.shape == parameter.shape:
                    # The fused Adam needs equal memory layouts of both.
                    state[field] = torch.empty_like(parameter).copy_(tensor)


def _networks(translator: Translator) -> dict[str, nn.Module]:
    """All trained networks, and the weight average."""
    average = translator.average
    return translator.networks | ({} if average is None else {AVERAGE: average})


def load_history(path: Path) -> list[EpochRecord]:
    """The history of a saved state. Raises T2TwinError for a damaged file."""
    try:
        with safe_open(path, "pt") as file:
            text = file.metadata()[HISTORY]
    except (SafetensorError, KeyError, TypeError):
        raise T2TwinError(
            f"{path} is not a saved state of a training; remove its folder to train again"
        ) from None
    return decode_history(text, str(path))


def _save(
    path: Path, tensors: dict[str, torch.Tensor], metadata: dict[str, str] | None = None
) -> None:
    # safetensors needs contiguous tensors; channels-last weights are not.
    in_order = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    with atomic_write(path) as temporary:
        try:
            save_file(in_order, temporary, metadata)
        except SafetensorError as error:  # its text names the cause, such as a full disk
            raise T2TwinError(f"{path} cannot be written ({error})") from error
        temporary.chmod(0o644)  # safetensors restricts it to the owner
