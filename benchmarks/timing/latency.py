"""Time from one frame to its counts on one core, as a live sensor needs it.

    python -m benchmarks latency

The input is a (320, 240, 3) uint8 array; the time includes resizing. All translators at the presets
cpu and paper are timed with random weights, which do not change the time. `t2twin.load` uses ONNX
Runtime here. The same run in PyTorch is timed in turn on one thread.

The pretrained runs are timed with a background frame, to counts, force and contact, with the
classes of frames.
"""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from argparse import Namespace
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.evidence import Benchmark, Figure
from t2twin.core.cache_dir import VARIABLE
from t2twin.sim.optical.gel_camera import GelCamera
from t2twin.sim.sensors.pair import SensorPair

if TYPE_CHECKING:
    from t2twin.translate.models.presets import Model, Preset

BENCHMARK = Benchmark(
    module="benchmarks.timing.latency",
    minutes=2,
    sources=("sim/taxels", "translate"),
    figures=(
        Figure("presets.touch2touch-cpu.median_ms", "ms", most=30.0),
        Figure("presets.resnet18-cpu.median_ms", "ms", most=16.0),
        Figure("presets.field-cpu.median_ms", "ms", most=12.0),
        Figure("contact.field.median_ms", "ms", most=12.0),
        Figure("contact.mini.median_ms", "ms", most=12.0),
        Figure("presets.touch2touch-paper.median_ms", "ms"),
        Figure("presets.resnet18-paper.median_ms", "ms"),
    ),
)

FRAME = (320, 240, 3)
FULL_SCALE = 40_000.0
ROUNDS = 30
"""Frames that each way is given, after two that are not counted."""

MEASURED = ("cpu", "paper")
"""Presets of either model."""


def measure(options: Namespace) -> dict[str, Any]:
    import torch

    from t2twin.translate.models.presets import MODELS, PRESETS
    from t2twin.translate.runs.config import pretrained_runs

    torch.set_num_threads(1)
    frames = np.random.default_rng(0).integers(0, 256, (ROUNDS + 2, *FRAME), dtype=np.uint8)
    return {
        "threads": 1,
        "frame": list(FRAME),
        "rounds": ROUNDS,
        "presets": {
            f"{model}-{name}": _measure(model, PRESETS[model][name], frames)
            for model in MODELS
            for name in MEASURED
        },
        "contact": {name: _measure_contact(name) for name in pretrained_runs()},
    }


def _measure_contact(name: str) -> dict[str, float]:
    """Times of the contact by a pretrained run, from frames without contact of its sensor."""
    from t2twin.sim.sensors.files import load_sensor
    from t2twin.translate.inference.load import load

    with tempfile.TemporaryDirectory() as folder:
        os.environ[VARIABLE] = folder
        runs = {"": load(name, engine="onnx"), "torch_": load(name, engine="torch")}
        sensor = load_sensor(runs[""].config.data.camera.name)
        assert isinstance(sensor, GelCamera)
        rng = np.random.default_rng(0)
        frames = [sensor.background_frame(rng) for _ in range(ROUNDS + 2)]
        ways = {
            way: partial(run.estimate, background=frames[0], contact=True)
            for way, run in runs.items()
        }
        return _compared(ways, frames)


def _measure(model: Model, preset: Preset, frames: np.ndarray) -> dict[str, float]:
    from t2twin.translate.inference.load import load

    with tempfile.TemporaryDirectory() as folder:
        run_dir = Path(folder)
        _fresh_run(model, preset, run_dir)
        os.environ[VARIABLE] = folder  # where its ONNX file is kept
        ways = {
            "": load(run_dir, engine="onnx").predict,
            "torch_": load(run_dir, engine="torch").predict,
        }
        return _compared(ways, frames)


def _compared(
    ways: Mapping[str, Callable[[np.ndarray], object]], frames: Iterable[np.ndarray]
) -> dict[str, float]:
    """Median times of the ways, taken in turn. The first two frames are not counted."""
    times: dict[str, list[float]] = {way: [] for way in ways}
    for frame in frames:
        for way, predict in ways.items():
            started = time.perf_counter()
            predict(frame)
            times[way].append(1e3 * (time.perf_counter() - started))
    return {f"{way}median_ms": statistics.median(each[2:]) for way, each in times.items()}


def _fresh_run(model: Model, preset: Preset, run_dir: Path) -> None:
    from t2twin.sim.dataset.generate import sensor_info
    from t2twin.translate.data.pairs import DataInfo
    from t2twin.translate.runs.checkpoint import build, save_weights
    from t2twin.translate.runs.config import BEST, RunConfig

    pair = SensorPair()
    info = DataInfo("0" * 64, sensor_info(pair.source), sensor_info(pair.target))
    config = RunConfig(model, preset, 0, info, None, None, 1, False, 1)
    config.save(run_dir)
    save_weights(run_dir / BEST, build(config).predictor.state_dict())
