"""One DIGIT frame to its counts, one at a time on one core, as a live sensor needs it.

    python -m benchmarks.latency

From a (320, 240, 3) uint8 array to counts, resize included, for both translators at the presets
cpu and paper, with fresh weights, whose values do not change the time. Beside it, turn by turn, the
same network in PyTorch as it comes (batch norms unfolded, contiguous, no_grad) and the exported
ONNX file in onnxruntime, on one thread too and with the same resize.
"""

import statistics
import tempfile
import time
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
import torch
from PIL import Image

from benchmarks.declared import LATENCY
from benchmarks.evidence.run import main
from t2twin.sim.cyskin.layout import load_layout
from t2twin.translate.build import build
from t2twin.translate.data.images import to_input, to_pixels
from t2twin.translate.data.pairs import DataInfo
from t2twin.translate.export import COUNTS, INPUT, export_onnx
from t2twin.translate.predict import TrainedTranslator, load_run
from t2twin.translate.presets import PAPER_MODELS, PRESETS, Model, Preset
from t2twin.translate.runs.checkpoint import load_weights, save_weights
from t2twin.translate.runs.config import BEST, RunConfig
from t2twin.translate.touch2touch import Touch2Touch

FRAME = (320, 240, 3)
FULL_SCALE = 40_000.0
ROUNDS = 30
"""Frames that each way is given, after two that are not counted."""

MEASURED = ("cpu", "paper")
"""Presets of either model."""

Way = Callable[[np.ndarray], np.ndarray]
"""From a frame to counts, (N,)."""


def measure(options: Namespace) -> dict[str, Any]:
    torch.set_num_threads(1)
    frames = np.random.default_rng(0).integers(0, 256, (ROUNDS + 2, *FRAME), dtype=np.uint8)
    return {
        "threads": 1,
        "frame": list(FRAME),
        "rounds": ROUNDS,
        "presets": {
            f"{model}-{name}": _measure(model, PRESETS[model][name], frames)
            for model in PAPER_MODELS
            for name in MEASURED
        },
    }


def _measure(model: Model, preset: Preset, frames: np.ndarray) -> dict[str, float]:
    with tempfile.TemporaryDirectory() as folder:
        run_dir = Path(folder)
        run = _fresh_run(model, preset, run_dir)
        ways = {"": run.in_float32().predict, "plain_": _plain(run, run_dir)}
        export_onnx(run, run_dir / "run.onnx")
        ways["onnxruntime_"] = _exported(run_dir / "run.onnx", preset)
        times: dict[str, list[float]] = {way: [] for way in ways}
        for frame in frames:
            for way, predict in ways.items():
                started = time.perf_counter()
                predict(frame)
                times[way].append(1e3 * (time.perf_counter() - started))
    counted = {way: sorted(each[2:]) for way, each in times.items()}
    medians = {way: statistics.median(each) for way, each in counted.items()}
    return {
        **{f"{way}median_ms": median for way, median in medians.items()},
        "p95_ms": counted[""][int(0.95 * len(counted[""]))],
        "plain_ratio": medians["plain_"] / medians[""],
        "onnxruntime_ratio": medians["onnxruntime_"] / medians[""],
    }


def _fresh_run(model: Model, preset: Preset, run_dir: Path) -> TrainedTranslator:
    layout = load_layout()
    info = DataInfo("0" * 64, layout.name, layout.x_mm, layout.y_mm, FULL_SCALE)
    config = RunConfig(model, preset, 0, info, None, None, 1, False, 1)
    config.save(run_dir)
    save_weights(run_dir / BEST, build(config).predictor)
    return load_run(run_dir)


def _exported(path: Path, preset: Preset) -> Way:
    """The exported file in onnxruntime, on one thread."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])

    def predict(frame: np.ndarray) -> np.ndarray:
        pixels = to_pixels(Image.fromarray(frame), preset.size, preset.grey)
        images = pixels.transpose(2, 0, 1)[None].astype(np.float32) / 255.0
        return np.asarray(session.run([COUNTS], {INPUT: images})[0])[0]

    return predict


def _plain(run: TrainedTranslator, run_dir: Path) -> Way:
    """The same network as anyone would write its use first."""
    translator, preset = build(run.config), run.config.preset
    load_weights(run_dir / BEST, translator.predictor)
    network = translator.predictor.to(memory_format=torch.contiguous_format).eval()  # pyright: ignore[reportCallIssue]

    def predict(frame: np.ndarray) -> np.ndarray:
        pixels = to_pixels(Image.fromarray(frame), preset.size, preset.grey)
        images = to_input(pixels[None].astype(np.float32) / 255.0).contiguous()
        with torch.no_grad():
            output = network(images)
            if isinstance(translator, Touch2Touch):
                counts = translator.counts_of((output + 1.0) * (FULL_SCALE / 2.0))
            else:
                counts = (output * FULL_SCALE).clamp(0.0, FULL_SCALE)
        return counts[0].numpy()

    return predict


if __name__ == "__main__":
    main(LATENCY)
