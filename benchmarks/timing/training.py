"""Training throughput of `t2twin train`.

    python -m benchmarks training [--data DIR]

The time of an epoch includes the validation. It does not include the first decoding, the estimate
and saving. Without --data a dataset of scale smoke is made. Some steps of preset paper are timed to
estimate its hours.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.evidence import Argument, Benchmark, Figure
from t2twin.primitives_cad import catalogue
from t2twin.sim.dataset.generate import make_dataset
from t2twin.sim.sampling import protocol

if TYPE_CHECKING:
    from t2twin.translate.data.pairs import DataInfo
    from t2twin.translate.models.presets import Model

BENCHMARK = Benchmark(
    module="benchmarks.timing.training",
    minutes=6,
    sources=("sim/dataset", "translate"),
    figures=(
        Figure("models.*.images_a_second", "images/s"),
        Figure("models.*.paper_preset_hours", "h"),
    ),
    arguments=(
        Argument("--data", "a dataset, made at scale smoke unless given", Path, metavar="DIR"),
    ),
)

PRESET = "cpu"
ROUNDS = 3
MIN_STEPS = 24
"""Steps of a round, at least; as many epochs as that takes."""
PAPER_STEPS = 3
"""Timed steps of preset paper, after one that is not counted."""


def measure(options: Namespace) -> dict[str, Any]:
    import torch

    from t2twin.translate.data.pairs import load_info
    from t2twin.translate.models.presets import PAPER_MODELS
    from t2twin.translate.runs.checkpoint import has_bf16

    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        data_dir = options.data or folder / "data"
        if options.data is None:
            make_dataset(data_dir, "smoke", seed=0)
        models = {
            model: _measure(model, data_dir, folder)
            | {"paper_preset_hours": _paper_hours(model, load_info(data_dir))}
            for model in PAPER_MODELS
        }
    return {
        "threads": torch.get_num_threads(),
        "preset": PRESET,
        "bf16": has_bf16(),
        "rounds": ROUNDS,
        "models": models,
    }


def _measure(model: Model, data_dir: Path, folder: Path) -> dict[str, Any]:
    """Images a second, the median of the rounds."""
    from t2twin.translate.data.pairs import load_pairs
    from t2twin.translate.models.presets import PRESETS

    preset = PRESETS[model][PRESET]
    pairs = len(load_pairs(data_dir, "train", preset.size, preset.grey))
    steps = pairs // preset.batch
    epochs = -(-MIN_STEPS // steps)
    rounds = [_ours(model, data_dir, folder / f"{model}-{n}", epochs) for n in range(ROUNDS)]
    return {
        "pairs": pairs,
        "batch": preset.batch,
        "steps_a_round": epochs * steps,
        "images_a_second": epochs * steps * preset.batch / statistics.median(rounds),
    }


def _paper_hours(model: Model, info: DataInfo) -> float:
    """Hours that the steps of preset paper take on the paper's training set, if none is spared."""
    import torch

    from t2twin.translate.data.pairs import Examples
    from t2twin.translate.models.presets import PRESETS
    from t2twin.translate.runs.checkpoint import TRANSLATORS, has_bf16

    preset, scale = PRESETS[model]["paper"], protocol.SCALES["paper"]
    pairs = sum(
        len(protocol.indices(name, scale))
        for name in catalogue.PRIMITIVES
        if catalogue.split(name) == "train"
    )
    bf16 = preset.bf16 and has_bf16()
    translator = TRANSLATORS["counts"][model](preset, info, torch.device("cpu"), bf16)
    images = torch.zeros(preset.batch, 1 if preset.grey else 3, preset.size, preset.size)
    counts = torch.zeros(preset.batch, info.array.x_mm.size)
    translator.step(Examples(images, counts))
    started = time.perf_counter()
    for _ in range(PAPER_STEPS):
        translator.step(Examples(images, counts))
    step_seconds = (time.perf_counter() - started) / PAPER_STEPS
    return preset.epochs * (pairs // preset.batch) * step_seconds / 3600


def _ours(model: Model, data_dir: Path, run_dir: Path, epochs: int) -> float:
    """Seconds of the epochs by the run's own log."""
    from t2twin.translate.runs.config import read_log
    from t2twin.translate.training.train import train

    train(model, data_dir, PRESET, run_dir, epochs=epochs)
    return sum(record.seconds for record in read_log(run_dir))
