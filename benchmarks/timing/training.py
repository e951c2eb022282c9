"""Training throughput of `t2twin train`, compared with a plain training loop.

    python -m benchmarks.timing.training [--data DIR]

Both train the same networks at preset cpu, with the same batch and pairs, in turn on the same
machine. The plain loop (`plain_training.py`) computes in float32 on contiguous tensors.
It decodes every image from its PNG in each epoch with a DataLoader, and uses Adam with default
settings. It runs in its own process and has no augmentation.

The time of an epoch includes the validation. It does not include the first decoding, the estimate
and saving. The loading share is the part of the time in which t2twin prepares batches. Without
--data a dataset of scale smoke is made. Some steps of preset paper are timed to estimate its hours.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from argparse import Namespace
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.evidence import Argument, Benchmark, Figure, main
from t2twin.primitives_cad import catalogue
from t2twin.sim.dataset.generate import make_dataset
from t2twin.sim.sampling import protocol

if TYPE_CHECKING:
    from benchmarks.timing.plain_training import PngPairs
    from t2twin.translate.data.pairs import DataInfo
    from t2twin.translate.models.presets import Model, Preset

BENCHMARK = Benchmark(
    module="benchmarks.timing.training",
    measures="Training throughput, against a plain training loop.",
    minutes=6,
    sources=("sim/dataset", "translate"),
    figures=(
        Figure("models.*.ratio", least=1.5),
        Figure("models.*.loading_share", most=0.1),
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
    """Images a second of both, the medians of the rounds, and the median of the rounds' ratios."""
    from benchmarks.timing.plain_training import PngPairs
    from t2twin.translate.data.pairs import load_info
    from t2twin.translate.models.presets import PRESETS

    preset = PRESETS[model][PRESET]
    splits = {split: PngPairs(data_dir, split, preset) for split in ("train", "val")}
    steps = len(splits["train"]) // preset.batch
    epochs = -(-MIN_STEPS // steps)
    ours, plain = [], []
    with ProcessPoolExecutor(1, get_context("spawn")) as apart:
        for number in range(ROUNDS):
            ours.append(_ours(model, data_dir, folder / f"{model}-{number}", epochs))
            round_ = apart.submit(_plain, model, preset, splits, load_info(data_dir), epochs)
            plain.append(round_.result())
    images = epochs * steps * preset.batch
    return {
        "pairs": len(splits["train"]),
        "validated_on": len(splits["val"]),
        "batch": preset.batch,
        "steps_a_round": epochs * steps,
        "images_a_second": images / statistics.median(ours),
        "plain_images_a_second": images / statistics.median(plain),
        "ratio": statistics.median(slow / fast for slow, fast in zip(plain, ours, strict=True)),
        "loading_share": epochs * steps * _loading(preset, data_dir) / statistics.median(ours),
    }


def _loading(preset: Preset, data_dir: Path) -> float:
    """Seconds in which t2twin has a batch ready, the median of a round's."""
    import torch

    from t2twin.translate.data.pairs import load_pairs
    from t2twin.translate.training.batches import Batches

    pairs = load_pairs(data_dir, "train", preset.size, preset.grey)
    batches, rng = Batches(pairs, preset, torch.device("cpu")), np.random.default_rng(0)
    seconds = []
    for _ in range(MIN_STEPS):
        started = time.perf_counter()
        batches.examples(rng.permutation(len(pairs))[: preset.batch], rng)
        seconds.append(time.perf_counter() - started)
    return statistics.median(seconds)


def _paper_hours(model: Model, info: DataInfo) -> float:
    """Hours that the steps of preset paper take on the paper's training set, if none is spared."""
    import torch

    from t2twin.translate.data.pairs import Examples
    from t2twin.translate.models.presets import PRESETS
    from t2twin.translate.runs.checkpoint import TRANSLATORS, has_bf16

    preset, scale = PRESETS[model]["paper"], protocol.scale_of("paper")
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
    from t2twin.translate.runs.log import read_log
    from t2twin.translate.training.train import train

    train(model, data_dir, PRESET, run_dir, epochs=epochs)
    return sum(record.seconds for record in read_log(run_dir))


def _plain(
    model: Model, preset: Preset, splits: dict[str, PngPairs], info: DataInfo, epochs: int
) -> float:
    """Seconds of the same epochs in the plain loop."""
    import torch
    from torch.utils.data import DataLoader

    from benchmarks.timing.plain_training import PlainResNet18, PlainTouch2Touch
    from t2twin.translate.models.distributed import use_all_cores

    use_all_cores()
    loader = DataLoader(splits["train"], preset.batch, shuffle=True, drop_last=True)
    validation = DataLoader(splits["val"], preset.batch)
    kind = PlainTouch2Touch if model == "touch2touch" else PlainResNet18
    translator = kind(preset, info)
    started = time.perf_counter()
    for _ in range(epochs):
        for network in translator.networks:
            network.train()
        for images, counts in loader:
            translator.step(images, counts)
        for network in translator.networks:
            network.eval()
        squares = 0.0
        with torch.no_grad():
            for images, counts in validation:
                squares += (translator.predict(images) - counts).square().sum().item()
    return time.perf_counter() - started


if __name__ == "__main__":
    main(BENCHMARK)
