"""Predictions for frames of a real DIGIT before and after an adaptation to it.

    python -m benchmarks adaptation FRAMES OUT

FRAMES is a folder with background.png and press_*.png of a 4.70 mm ball. It is not part of the
project. The pretrained network is adapted on two thirds of the presses, three times for each
duration, and evaluated on the other third, which `adapt` does not get. The reference is the
simulated CySkin at the place and depth that an optics file without this third finds in the frame.
OUT keeps the adaptations, so that the same command continues an interrupted measurement.
"""

from __future__ import annotations

import shutil
from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.evidence import Argument, Benchmark, Figure
from benchmarks.networks.real import real_references
from benchmarks.optics.fitted_optics import BALL_DIAMETER_MM, HELD_OUT, ROTATIONS
from t2twin.core.errors import T2TwinError

if TYPE_CHECKING:
    from t2twin.adaptation.real_frame_evaluation import References
    from t2twin.translate.inference.predictor import TrainedTranslator

BENCHMARK = Benchmark(
    module="benchmarks.networks.adaptation",
    minutes=100,
    sources=("primitives_cad", "sim", "t2twin/adaptation", "translate"),
    figures=(
        Figure("pretrained.mean_rmse_percent", "%"),
        Figure("adapted.*.mean_rmse_percent", "%"),
        Figure("adapted.*.largest_ratio", most=1.0),
        Figure("adapted.*.median_ratio", most=0.9),
        Figure("adapted.*.mean_refused_percent", "%", most=1.0),
    ),
    arguments=(
        Argument("frames", "folder of background.png and press_*.png", Path),
        Argument("out", "folder of the adaptations", Path),
    ),
)

BACKGROUND = "background.png"

MINUTES = (10,)
"""Durations of the adaptations; the default is twice as long."""


def measure(options: Namespace) -> dict[str, Any]:
    from t2twin.adaptation.pipeline import adapt
    from t2twin.translate.inference.load import load_run
    from t2twin.translate.runs.config import DEFAULT_RUN

    initial_run = load_run(DEFAULT_RUN)
    pretrained, adapted = [], {str(minutes): [] for minutes in MINUTES}
    for rotation in range(ROTATIONS):
        folder = options.out / f"rotation-{rotation}"
        all_frames, fitted_frames = _arrange(options.frames, folder, rotation)
        references, background = real_references(all_frames)
        pretrained.append(_scores(initial_run, references, background))
        for minutes in MINUTES:
            out = folder / f"{minutes}-minutes"
            adapt(all_frames / BACKGROUND, fitted_frames, BALL_DIAMETER_MM, out, minutes=minutes)
            adapted[str(minutes)].append(_scores(load_run(out / "field"), references, background))
    return {
        "pretrained": _summary(pretrained),
        "adapted": {
            minutes: _summary(thirds) | _ratios(thirds, pretrained)
            for minutes, thirds in adapted.items()
        },
    }


def _arrange(frames: Path, folder: Path, rotation: int) -> tuple[Path, Path]:
    """Copies the frames; every third press is held out.

    Returns two folders: all frames, with the held-out presses as the last, and the other presses.
    Raises T2TwinError unless a third of the presses are HELD_OUT.
    """
    presses = sorted(frames.glob("press_*.png"))
    if len(presses) != ROTATIONS * HELD_OUT:
        raise T2TwinError(
            f"{frames} contains {len(presses)} presses, press_*.png; this benchmark uses "
            f"{ROTATIONS * HELD_OUT}"
        )
    held_out = presses[rotation::ROTATIONS]
    others = [press for press in presses if press not in held_out]
    folders = folder / "all", folder / "fitted"
    for of, chosen in zip(folders, ([*others, *held_out], others), strict=True):
        shutil.rmtree(of, ignore_errors=True)
        of.mkdir(parents=True)
        for number, press in enumerate(chosen):
            shutil.copy(press, of / f"press_{number:02d}.png")
    shutil.copy(frames / BACKGROUND, folders[0])
    return folders


def _scores(
    run: TrainedTranslator, references: References, background: np.ndarray
) -> dict[str, Any]:
    """Scores of a run on the real frames of a third."""
    from t2twin.adaptation.real_frame_evaluation import AdaptationScores, evaluate_frames

    found, alone = (
        AdaptationScores.of(evaluate_frames(run, references.frames, references, still)[1])
        for still in (background, None)
    )
    return {
        "presses": len(references.names),
        "rmse_percent": found.rmse_percent,
        "rmse_percent_without_background": alone.rmse_percent,
        "interval_coverage_percent": found.interval_coverage_percent,
        "refused_percent": 100.0 * found.refused / len(references.names),
    }


def _summary(thirds: list[dict[str, Any]]) -> dict[str, Any]:
    """The scores of the thirds, and their means."""
    names = [name for name in thirds[0] if name != "presses"]
    means = {f"mean_{name}": float(np.mean([one[name] for one in thirds])) for name in names}
    return {"thirds": thirds} | means


def _ratios(thirds: list[dict[str, Any]], pretrained: list[dict[str, Any]]) -> dict[str, Any]:
    """RMSE over that of the pretrained network: of each third, the median and the largest."""
    ratios = [
        one["rmse_percent"] / before["rmse_percent"]
        for one, before in zip(thirds, pretrained, strict=True)
    ]
    return {
        "ratios": ratios,
        "median_ratio": float(np.median(ratios)),
        "largest_ratio": max(ratios),
    }
