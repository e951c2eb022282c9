"""Loads trained runs as predictors, in PyTorch or ONNX Runtime, and exports them as ONNX files.

The graph of a file contains the normalization, the network with folded batch norms, phi^-1 for
touch2touch, and the clipping to full scale. Its inputs are images, (B, c, S, S) float32 in [0, 1],
and for a field run optionally a background frame, (1, 3, S, S). docs/reference/file-formats.md has
the outputs. ONNX Runtime takes half the time of PyTorch per frame.

Shape letters: B images, c channels, S image side of the run.
"""

import dataclasses
import hashlib
import json
import warnings
from functools import cache, partial
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from msgspec import structs
from torch import nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from t2twin.core import arguments
from t2twin.core.cache_dir import cache_dir
from t2twin.core.errors import T2TwinError, how_to_install, warn
from t2twin.core.files import atomic_write, check_own, sha256_of
from t2twin.core.machine import installed_version
from t2twin.sim.dataset.info import COUNTS
from t2twin.sim.taxels.layout import Layout, load_layout
from t2twin.translate.inference.predictor import Compute, TrainedTranslator
from t2twin.translate.models.base import FEATURES, TACTILE_IMAGES, FromPixels
from t2twin.translate.models.field import CENTER, MAPS
from t2twin.translate.runs.checkpoint import build, has_bf16, load_weights
from t2twin.translate.runs.config import (
    BEST,
    CONFIG,
    DEFAULT_RUN,
    FRAME_CHECK,
    load_config,
    resolve_run,
)

INPUT, BACKGROUND = "images", "background"

OPSET = 17  # Version of the ONNX operators, not the latest, so that older runtimes can read it
PARITY_IMAGES = 5  # Random images on which the file is compared with the run
# Largest accepted difference, counts; for standard deviations above 1,000 counts, thousandths of
# them; for depths, micrometers
PARITY_COUNTS = 1.0
ONNX = ("onnx", "onnxruntime")
NEEDS_ONNX = f"needs onnx and onnxruntime; {how_to_install('onnx')}"
# Folder of the files in the cache folder, and their maximum number; the oldest are removed
# (assumed: 200 MB of preset cpu)
FOLDER, MAX_FILES = "onnx", 20


def fold_batchnorm(network: nn.Module) -> None:
    """Folds every batch norm into the convolution defined before it, in place, for half the memory
    traffic. Outputs change by rounding only; the network cannot be trained further."""
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
    layout: str | Path | Layout | None = None,
    bf16: bool = False,
    engine: Literal["onnx", "torch"] | None = None,
) -> TrainedTranslator:
    """A run with its best weights.

    run: its folder, or the name of a pretrained run. layout: a taxel layout (name, file or Layout)
    that a touch2touch or field run is read at, by default its own. bf16: compute in bfloat16, which
    is faster and changes counts by up to some hundreds; warns if the run's preset or the processor
    does not support it. engine: computes counts: "onnx" (ONNX Runtime) or "torch". The default is
    ONNX Runtime if the extra t2twin[onnx] is installed, the run computes in float32 on the CPU, and
    the cache is writable; counts differ by less than one. torch's threads do not change.
    Raises T2TwinError for a folder that is not a run, a layout that it cannot be read at, an
    unknown engine, and "onnx" if it is not available.
    """
    if engine is not None:
        arguments.choice(engine, "engine", ("onnx", "torch"))
    config = load_config(run_dir := resolve_run(run))
    is_bf16 = arguments.flag(bf16, "bf16") and config.preset.bf16 and has_bf16()
    if bf16 and not is_bf16:
        warn(f"bf16 has no effect: the preset of {run} or the processor does not support it")
    translator = build(structs.replace(config, bf16=is_bf16))
    load_weights(run_dir / BEST, translator.predictor)
    fold_batchnorm(translator.predictor)
    loaded = TrainedTranslator(run_dir, config, translator)
    if layout is not None:
        loaded = loaded._need_counts("a layout")._at_layout(load_layout(layout))
    if engine == "torch":
        return loaded
    obstacles = {
        f"it {NEEDS_ONNX}": not all(map(find_spec, ONNX)),
        "it is used for counts from images": not config.is_image_to_counts,
        "it is used in float32 on the CPU only": is_bf16 or translator.device.type != "cpu",
        "there is no writable folder for its file": cache_dir() is None,
    }
    obstacle = next((text for text, applies in obstacles.items() if applies), None)
    if obstacle is None:
        return dataclasses.replace(loaded, engine=onnx_engine)
    if engine == "onnx":
        raise T2TwinError(f"{run} cannot be used with ONNX Runtime: {obstacle}")
    return loaded


def load_run(
    run: str | Path, layout: str | Path | Layout | None = None, bf16: bool = False
) -> TrainedTranslator:
    """As `load`, in PyTorch; raises T2TwinError for a run that is not from images to counts."""
    return load(run, layout, bf16, "torch")._need_counts("a prediction of counts")


def export_onnx(
    run: TrainedTranslator | str | Path, path: str | Path, force: bool = False
) -> float:
    """Writes a run at its layout as the ONNX file path, and compares the two on random images.

    run: as `load` returns or takes it. force: replace an existing file. Returns the largest
    difference of counts between ONNX Runtime and the run. Raises T2TwinError for a run without
    counts, if onnx or onnxruntime is not installed, and for a difference above PARITY_COUNTS.
    """
    run = run if isinstance(run, TrainedTranslator) else load_run(run)
    path = arguments.path(path, "path")
    if path.suffix.lower() not in ("", ".onnx"):  # libraries read other formats by their suffixes
        raise T2TwinError(f"{path} is no name of an ONNX file; expected one that ends in .onnx")
    own = [run.run_dir / name for name in (BEST, CONFIG, FRAME_CHECK)]
    check_own(path.parent, [path.name], "", own, arguments.flag(force, "force"))
    return _export(run, path)


def _export(run: TrainedTranslator, path: Path) -> float:
    run = run._need_counts("an ONNX file")._in_float32()
    if not all(map(find_spec, ONNX)):
        raise T2TwinError(f"the export {NEEDS_ONNX}")
    preset = run.config.preset
    shape = (PARITY_IMAGES, preset.size, preset.size, 1 if preset.grey else 3)
    pixels = np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8)
    with atomic_write(path) as temporary:
        _write(run, pixels, temporary)
        difference = _difference(run, pixels, temporary)
        if difference > PARITY_COUNTS:
            raise T2TwinError(
                f"the ONNX file's outputs differ from the run's by {difference:.1f}, more than "
                f"{PARITY_COUNTS:g}; it was not written"
            )
    return difference


def _write(run: TrainedTranslator, pixels: np.ndarray, path: Path) -> None:
    """Traces the run on pixels, (B, S, S, c) uint8, and writes the file."""
    import onnx

    module = FromPixels(run.translator, run._frame_check).eval()
    frame = []
    if run.config.has_uncertainty:
        mean_frame: Any = module.network.mean_frame
        frame = [(mean_frame * module.std + module.mean)[None]]
    given = (torch.from_numpy(_to_input(pixels)), *frame)
    with torch.no_grad():
        module(*given)  # makes what is constant, and the names
    with warnings.catch_warnings():
        # The tracing exporter is deprecated, but its successor needs onnxscript as well.
        # The outputs are compared afterwards.
        warnings.simplefilter("ignore")
        torch.onnx.export(
            module, given, str(path), input_names=[INPUT, BACKGROUND][: len(given)],
            output_names=module.names, opset_version=OPSET, dynamo=False,
            dynamic_axes={name: {0: "batch"} for name in (INPUT, *module.names)},
        )  # fmt: skip
    model = onnx.load(path)
    for each in frame:  # an input that is also an initializer has it as its default
        model.graph.initializer.append(onnx.numpy_helper.from_array(each.numpy(), BACKGROUND))
    preset, info = run.config.preset, run.config.data.array
    color = "grey, 1 channel" if preset.grey else "red, green, blue, 3 channels"
    model.doc_string = (
        f"{run.config.model} of t2twin. Input {INPUT}: {preset.size} x {preset.size} pixels, "
        f"{color}, float32 in [0, 1], upright, resized bilinearly with antialiasing. Outputs "
        f"{', '.join(module.names)}: float32; counts, N, mm, kPa."
    )
    metadata = {
        "made_by": f"t2twin {installed_version('t2twin')}",
        "model": run.config.model,
        "preset": preset.name,
        "size": str(preset.size),
        "color": "grey" if preset.grey else "rgb",
        "layout": info.layout,
        "layout_x_mm": json.dumps(info.x_mm.tolist()),
        "layout_y_mm": json.dumps(info.y_mm.tolist()),
        "full_scale_counts": f"{info.full_scale_counts:g}",
        "info_sha256": run.config.data.sha256,
    }
    onnx.helper.set_model_props(model, metadata)
    onnx.checker.check_model(model, full_check=True)
    onnx.save(model, path)


def _difference(run: TrainedTranslator, pixels: np.ndarray, path: Path) -> float:
    """Largest difference between the outputs of the file and of the run, see PARITY_COUNTS."""
    theirs = _run(open_onnx(path), {INPUT: _to_input(pixels)})
    inputs = run.translator.to_input(pixels / np.float32(255.0))
    tensors = run.translator.predict_all(inputs, run.config.predicts_contact)
    scales: dict[str, Any] = {COUNTS: 1.0, "depth_mm": 1e3}
    if run.config.has_uncertainty:  # deviations are exponentials: rounding errors are relative
        scales["counts_std"] = 1.0 / np.maximum(1.0, tensors["counts_std"].cpu().numpy() / 1e3)
    return max(
        float((scale * np.abs(theirs[name] - tensors[name].cpu().numpy())).max())
        for name, scale in scales.items()
        if name in tensors
    )


def open_onnx(model: Path | bytes, threads: int = 0) -> Any:
    """An ONNX Runtime session of a file or its content, on the CPU. threads: 0 for its default."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3  # errors only; inputs with a default cause a warning
    options.intra_op_num_threads = threads
    return onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])


def _run(session: Any, inputs: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    names = [output.name for output in session.get_outputs()]
    return dict(zip(names, session.run(names, inputs), strict=True))


def onnx_engine(run: TrainedTranslator) -> Compute:
    """Predictions of a run in ONNX Runtime; an engine of a TrainedTranslator.

    The file is written on first use, which takes seconds. A session starts on its first call, with
    as many threads as torch has at that time. Calls from several threads are safe.
    """
    session_of = cache(partial(_open_session, run))

    def compute(pixels: np.ndarray, with_contact: bool) -> dict[str, np.ndarray] | None:
        """None for images with different background frames, as the file has one per batch."""
        channels = 1 if run.config.preset.grey else 3
        inputs, frames = {INPUT: _to_input(pixels[..., :channels])}, pixels[..., channels:]
        if frames.shape[-1]:
            inputs[BACKGROUND] = _to_input(frames[:1])
        session = session_of(with_contact)
        if session is None or not (frames == frames[:1]).all():
            return None
        return _run(session, inputs)

    return compute


def _open_session(run: TrainedTranslator, with_contact: bool) -> Any:
    """A session with the contact or without; None, with a warning, without its file."""
    import onnx.utils

    home = cache_dir()
    assert home is not None
    path = home / FOLDER / f"{_key(run)}.onnx"
    try:
        if not path.is_file():
            path.parent.mkdir(parents=True, exist_ok=True)
            _export(run, path)
            files = sorted(path.parent.glob("*.onnx"), key=lambda each: each.stat().st_mtime)
            for oldest in files[:-MAX_FILES]:
                oldest.unlink(missing_ok=True)
        model = onnx.load(path)
    except (T2TwinError, OSError) as error:
        warn(f"{error}; PyTorch computes the predictions in place of ONNX Runtime")
        return None
    unused = {TACTILE_IMAGES, FEATURES, *(() if with_contact else (*MAPS, *CENTER))}
    inputs = [each.name for each in model.graph.input]
    outputs = [each.name for each in model.graph.output if each.name not in unused]
    # ONNX Runtime computes all that is in a graph, used or not.
    part = onnx.utils.Extractor(model).extract_model(inputs, outputs)
    part.ir_version = model.ir_version
    return open_onnx(part.SerializeToString(), torch.get_num_threads())


def _to_input(pixels: np.ndarray) -> np.ndarray:
    """(B, c, S, S) float32 in [0, 1]."""
    return np.ascontiguousarray(pixels.transpose(0, 3, 1, 2), np.float32) / np.float32(255.0)


def _key(run: TrainedTranslator) -> str:
    """Hash of everything that the file depends on: weights, layout, preset and source code."""
    taxels, full_scale = run.config.data.array.taxels, run.config.data.array.full_scale
    values = [each.tolist() for each in (taxels.x_mm, taxels.y_mm, taxels.pad_diameter_mm)]
    settings = run.config.model, run.config.preset, full_scale, values
    files = [each for name in (BEST, FRAME_CHECK) if (each := run.run_dir / name).is_file()]
    known = hashlib.sha256(f"{[*map(sha256_of, files)]}{settings}".encode())
    translate = Path(__file__).parents[1]
    for folder in ("inference", "models", "uncertainty"):
        for source in sorted((translate / folder).glob("*.py")):
            known.update(source.read_bytes())
    return known.hexdigest()[:32]
