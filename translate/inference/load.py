"""Loads trained runs as predictors, in PyTorch or ONNX Runtime."""

import dataclasses
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from msgspec import structs
from torch import nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from t2twin.core import arguments
from t2twin.core.cache_dir import cache_dir
from t2twin.core.errors import T2TwinError
from t2twin.sim.taxels.layout import load_layout
from t2twin.translate.inference.onnx_export import OnnxEngine
from t2twin.translate.inference.predictor import TrainedTranslator
from t2twin.translate.runs.checkpoint import build, has_bf16, load_weights
from t2twin.translate.runs.config import (
    BEST,
    DEFAULT_RUN,
    load_config,
    pretrained_runs,
    resolve_run,
)


def fold_batchnorm(network: nn.Module) -> None:
    """Folds every batch norm into the convolution defined before it, in place.

    Outputs change by rounding only, with half the memory traffic. The network is in evaluation mode
    afterwards and cannot be trained further.
    """
    network.eval()
    for module in list(network.modules()):
        for (name, layer), (after, norm) in pairwise(list(module.named_children())):
            if isinstance(layer, nn.Conv2d | nn.ConvTranspose2d) and isinstance(
                norm, nn.BatchNorm2d
            ):
                transposed = isinstance(layer, nn.ConvTranspose2d)
                setattr(module, name, fuse_conv_bn_eval(layer, norm, transposed))
                setattr(module, after, nn.Identity())
    network.requires_grad_(False)
    network.to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]


def load(
    run: str | Path = DEFAULT_RUN,
    layout: str | Path | None = None,
    bf16: bool = False,
    engine: Literal["onnx", "torch"] | None = None,
) -> TrainedTranslator:
    """A run with its best weights.

    run: its folder, or the name of a pretrained run. layout: name or file of a taxel layout that a
    touch2touch or field run is read at, by default its own. bf16: compute in bfloat16 if the run's
    preset and the processor support it, which is faster and changes counts by up to some hundreds.
    engine: computes counts: "onnx" (ONNX Runtime) or "torch". The default is ONNX Runtime if the
    extra t2twin[onnx] is installed, the run computes in float32 on the CPU, and the cache is
    writable; counts differ by less than one. torch's threads and random numbers do not change.
    Raises T2TwinError for a folder that is not a run, a layout that it cannot be read at, an
    unknown engine, and "onnx" if it is not available.
    """
    if engine is not None:
        arguments.choice(engine, "engine", ("onnx", "torch"))
    run_dir, bf16 = resolve_run(run), arguments.flag(bf16, "bf16")
    config = load_config(run_dir)
    translator = build(structs.replace(config, bf16=bf16 and config.preset.bf16 and has_bf16()))
    load_weights(run_dir / BEST, translator.predictor)
    fold_batchnorm(translator.predictor)
    predictor = TrainedTranslator(run_dir, config, translator)
    if layout is not None:
        predictor = predictor.need_counts("a layout").at_layout(load_layout(layout))
    if engine == "torch":
        return predictor
    needs = "it needs onnx and onnxruntime; install them with: pip install 't2twin[onnx]'"
    is_float32_on_cpu = translator.device.type == "cpu" and not bf16
    obstacles = {
        needs: not all(map(find_spec, ("onnx", "onnxruntime"))),
        "it is used for counts from images": not config.is_image_to_counts,
        "it is used in float32 on the CPU only": not is_float32_on_cpu,
        "there is no writable folder for its file": cache_dir() is None,
    }
    obstacle = next((text for text, applies in obstacles.items() if applies), None)
    if obstacle is None:
        return dataclasses.replace(predictor, engine=OnnxEngine)
    if engine == "onnx":
        raise T2TwinError(f"{run} cannot be used with ONNX Runtime: {obstacle}")
    return predictor


def load_run(
    run: str | Path, layout: str | Path | None = None, bf16: bool = False
) -> TrainedTranslator:
    """As `load`, in PyTorch; raises T2TwinError for a run that is not from images to counts."""
    return load(run, layout, bf16, "torch").need_counts("a prediction of counts")


def contact_warnings(frame: np.ndarray, name: str, sensor: str) -> list[str]:
    """A sentence for each pretrained run of a sensor that finds a contact in a background frame.

    frame: (rows, columns, 3) uint8, upright. name: names it in the sentences.
    """
    said = []
    for run_name in pretrained_runs():
        config = load_config(resolve_run(run_name))
        is_own = config.data.camera.name == sensor and config.has_uncertainty
        if is_own and load_run(run_name).shows_contact(frame)[0]:
            said.append(f"{name} shows a contact, by {run_name}; expected a frame without")
    return said
