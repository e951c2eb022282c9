"""A trained run as one ONNX file, for a robot's computer that has no PyTorch.

The graph holds everything between pixels and counts: the normalisation, the network with its batch
norms folded in, phi^-1 for touch2touch, the clipping to full scale.

    input    images          (B, c, S, S) float32 in [0, 1]: grey (c = 1), or red, green, blue
    outputs  counts          (B, N) float32, within zero and full scale
             tactile_images  (B, R, C) float32, counts, R x C = 396 x 240

and of a field run

    input    untouched       (1, 3, S, S), the same DIGIT's frame while nothing touches it; where it
                             is not given, the mean frame of the run's world
    outputs  counts_std      (B, N) float32, counts, the standard deviation of each
             field, field_std    (B, F) float32, counts, the same at the field's places
             force_n, force_std_n    (B,) float32, N, of a run that was trained on several forces

B is free. The file's metadata name the model, its preset, the layout with its positions and full
scale. Shape letters: c channels, S the run's image side, N taxels, R rows and C columns.
"""

import json
import warnings
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import torch

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write
from t2twin.translate.inference.predictor import COUNTS, TrainedTranslator
from t2twin.translate.models.field import FromPixels

INPUT, UNTOUCHED = "images", "untouched"
TACTILE_IMAGES = "tactile_images"
OUTPUTS = (
    COUNTS, TACTILE_IMAGES, "counts_std", "field", "field_std", "force_n", "force_std_n"
)  # fmt: skip
"""In this order; what a run does not tell is left out from the end."""

OPSET = 17
"""Version of ONNX's operators: not the newest, so that older runtimes read the file too."""

PARITY_IMAGES = 5
"""Random pictures that the file is compared with the run on before it is kept."""

PARITY_COUNTS = 1.0
"""Largest difference that is let through, counts; of standard deviations above 1,000 in parts of a
thousandth."""


def export_onnx(run: TrainedTranslator, path: str | Path) -> float:
    """Writes a run, with its layout, as an ONNX file, and compares the two on random images.

    Returns the largest difference between onnxruntime's counts and the run's, counts.
    Raises T2TwinError where onnx or onnxruntime is not installed, and where they differ by more
    than PARITY_COUNTS.
    """
    run, path = arguments.instance(run, "run", TrainedTranslator), arguments.path(path, "path")
    try:
        import onnx
        import onnxruntime  # noqa: F401, what opens the file needs it
    except ImportError:
        raise T2TwinError(
            "the export needs onnx and onnxruntime; install them with: pip install 't2twin[onnx]'"
        ) from None
    run = run.in_float32()  # as the file computes
    pixels = _random_pixels(run)
    images = torch.from_numpy(pixels.astype(np.float32) / 255.0).permute(0, 3, 1, 2).contiguous()
    module = run.translator.as_module().eval()
    frame = [module.mean_frame] if isinstance(module, FromPixels) else []
    with torch.inference_mode():
        outputs = OUTPUTS[: len(module(images, *frame))]
    with atomic_write(path) as temporary:
        with warnings.catch_warnings():
            # The tracing exporter is deprecated, but its successor needs onnxscript as well.
            warnings.simplefilter("ignore", DeprecationWarning)
            warnings.filterwarnings("ignore", "torch.from_numpy results are registered")  # as meant
            torch.onnx.export(
                module,
                (images, *frame),
                str(temporary),
                input_names=[INPUT, UNTOUCHED][: 1 + len(frame)],
                output_names=list(outputs),
                dynamic_axes={name: {0: "batch"} for name in (INPUT, *outputs)},
                opset_version=OPSET,
                dynamo=False,
            )
        model = onnx.load(temporary)
        for each in frame:  # an input that is also a constant has that for its default
            default = onnx.numpy_helper.from_array(each.numpy(), UNTOUCHED)
            model.graph.initializer.append(default)
        model.doc_string = _about(run, outputs)
        onnx.helper.set_model_props(model, _metadata(run))
        onnx.checker.check_model(model, full_check=True)
        onnx.save(model, temporary)
        session = open_onnx(temporary)
        (theirs,) = session.run([COUNTS], {INPUT: images.numpy()})
        apart = float(np.abs(theirs - run.predict_pixels(pixels)).max())
        if frame:
            (theirs,) = session.run([OUTPUTS[2]], {INPUT: images.numpy()})
            own = run.estimate_pixels(pixels).counts_std
            # Exponentials: rounding is a part of them.
            apart = max(apart, float((np.abs(theirs - own) / np.maximum(1.0, own / 1e3)).max()))
        if apart > PARITY_COUNTS:
            raise T2TwinError(
                f"the ONNX file's counts differ from the run's by {apart:.1f}, more than "
                f"{PARITY_COUNTS:g}; it was not written"
            )
    return apart


def open_onnx(model: Path | bytes, threads: int = 0) -> Any:
    """ONNX Runtime's session of a file or of its content, on the CPU. threads: 0 leaves their
    number to it."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3  # errors; it warns of an input that has a default, as meant
    options.intra_op_num_threads = threads
    return onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])


def _random_pixels(run: TrainedTranslator) -> np.ndarray:
    """(PARITY_IMAGES, S, S, c) uint8."""
    preset = run.config.preset
    shape = (PARITY_IMAGES, preset.size, preset.size, 1 if preset.grey else 3)
    return np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8)


def _about(run: TrainedTranslator, outputs: tuple[str, ...]) -> str:
    preset, info = run.config.preset, run.config.data
    color = "grey, 1 channel" if preset.grey else "red, green, blue, 3 channels"
    return (
        f"{run.config.model} of t2twin: DIGIT images to the counts of {info.x_mm.size} taxels. "
        f"Input {INPUT}: {preset.size} x {preset.size} pixels, {color}, float32 in [0, 1], "
        f"upright, resized bilinearly with antialiasing. Outputs {', '.join(outputs)}: float32, "
        f"counts from 0 to {info.full_scale_counts:g}, forces in newtons."
    )


def _metadata(run: TrainedTranslator) -> dict[str, str]:
    """All values are text, as ONNX has them; lists are JSON."""
    preset, info = run.config.preset, run.config.data
    return {
        "made_by": f"t2twin {version('t2twin')}",
        "model": run.config.model,
        "preset": preset.name,
        "size": str(preset.size),
        "colour": "grey" if preset.grey else "rgb",
        "layout": info.layout,
        "layout_x_mm": json.dumps(info.x_mm.tolist()),
        "layout_y_mm": json.dumps(info.y_mm.tolist()),
        "full_scale_counts": f"{info.full_scale_counts:g}",
        "info_sha256": info.sha256,
    }
