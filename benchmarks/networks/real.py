"""Predictions of trained translators for frames of a real DIGIT.

    python -m benchmarks real FRAMES RUN [RUN ...]

FRAMES is a folder with background.png and press_*.png of a 4.70 mm ball. It is not part of the
project. The light is fitted to the first presses. On the last ones every run is evaluated on the
real frame, on the simulated frame of the same press, and on the background frame. A field run is
also evaluated without the background frame. The reference is the simulated CySkin at the place and
depth that the optics finds in the frame. Runs have the name of the recipe that they were
trained on.
"""

from __future__ import annotations

import tempfile
from argparse import Namespace
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.evidence import Argument, Benchmark, Figure
from benchmarks.optics.fitted_optics import BALL_DIAMETER_MM, HELD_OUT
from t2twin.core.errors import T2TwinError
from t2twin.sim.calibrate.calibrate import calibrate
from t2twin.sim.calibrate.frames import read_frame, sized_frame
from t2twin.sim.sensors.pair import SensorPair

if TYPE_CHECKING:
    from t2twin.adaptation.real_frame_evaluation import References
    from t2twin.translate.inference.predictor import TrainedTranslator

BENCHMARK = Benchmark(
    module="benchmarks.networks.real",
    minutes=2,
    sources=("primitives_cad", "sim", "t2twin/adaptation/real_frame_evaluation.py", "translate"),
    figures=(
        Figure("runs.*.real.rmse_percent", "%"),
        Figure("runs.*.real.interval_coverage_percent", "%"),
        Figure("runs.*.real_without_background.rmse_percent", "%"),
        Figure("runs.*.simulated.rmse_percent", "%"),
        Figure("runs.*.real.centroid_mm", "mm"),
        Figure("runs.*.real.force_error"),
        Figure("runs.*.background_counts", "counts"),
    ),
    arguments=(
        Argument("frames", "folder of background.png and press_*.png", Path),
        Argument("runs", "folders of trained runs", Path, nargs="+"),
    ),
)


def measure(options: Namespace) -> dict[str, Any]:
    runs = runs_by_name(options.runs)
    references, background_frame = real_references(options.frames)
    return {
        "presses": [
            {"name": name, "pose": pose, "force_n": force_n}
            for name, pose, force_n in zip(
                references.names,
                references.poses.tolist(),
                references.force_n.tolist(),
                strict=True,
            )
        ],
        "runs": {name: _scores(run, references, background_frame) for name, run in runs.items()},
    }


def runs_by_name(folders: list[Path]) -> dict[str, TrainedTranslator]:
    """The runs in folders, named by model and recipe. Raises T2TwinError for two of one name."""
    from t2twin.translate.inference.load import load_run

    runs = {}
    for run in map(load_run, folders):
        name = f"{run.config.model}-of-{run.config.data.recipe or run.config.data.sha256[:8]}"
        if name in runs:
            raise T2TwinError(f"two runs are a {name}; name one of them")
        runs[name] = run
    return runs


def real_references(folder: Path) -> tuple[References, np.ndarray]:
    """Simulated presses of the held-out frames in a folder, and the background frame."""
    from t2twin.adaptation.real_frame_evaluation import simulate_references

    background = folder / "background.png"
    report = calibrate(background, folder, BALL_DIAMETER_MM, HELD_OUT, tolerance=None)
    with tempfile.TemporaryDirectory() as temporary:
        optics = Path(temporary) / "optics.npz"
        report.scored_by.save(optics)
        sensors = SensorPair.of(optics=optics, frames=1)
        names = [press.name for press in report.held_out]
        diameters_mm = [BALL_DIAMETER_MM] * len(names)
        references = simulate_references(
            names, report.poses[-len(names) :], report.real, diameters_mm, sensors
        )
    return references, sized_frame(read_frame(background), sensors.camera.camera)


def _scores(
    run: TrainedTranslator, references: References, background: np.ndarray
) -> dict[str, Any]:
    from t2twin.adaptation.real_frame_evaluation import (
        AdaptationScores,
        background_counts,
        evaluate_frames,
    )

    real, alone, simulated = (
        asdict(AdaptationScores.of(evaluate_frames(run, images, references, still)[1]))
        for images, still in (
            (references.frames, background),
            (references.frames, None),
            (references.simulated, background),
        )
    )
    return {
        "real": real,
        "real_without_background": alone,
        "simulated": simulated,
        "background_counts": background_counts(run, background),
    }
