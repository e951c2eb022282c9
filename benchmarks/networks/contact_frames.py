"""The contact predicted from frames of a real DIGIT, compared with the balls fitted to them.

    python -m benchmarks.networks.contact_frames FRAMES RUN [RUN ...]

FRAMES is a folder with background.png and press_*.png of a 4.70 mm ball. It is not part of the
project. Optics fitted to the frames give the place and the depth of the ball in each. The reference
is the simulated press of the ball there: the depth of the gel and the mask of the contact, in the
cells of the contact maps. Runs are those of `t2twin train` that predict the contact.
"""

from __future__ import annotations

import tempfile
import time
from argparse import Namespace
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.evidence.record import Argument, Benchmark, Figure
from benchmarks.evidence.run import main
from benchmarks.optics.fitted_optics import BALL_DIAMETER_MM, HELD_OUT, SENSOR, read_frames
from t2twin.primitives_cad.export import write_ball
from t2twin.sim.calibrate.calibrate import calibrate
from t2twin.sim.contact.contact_solver import force_at_depth
from t2twin.sim.contact.types import PressCommand

if TYPE_CHECKING:
    from t2twin.sim.optical.gel_camera import ImageReading
    from t2twin.translate.inference.contact import ContactEstimate
    from t2twin.translate.inference.predictor import FieldPredictor

BENCHMARK = Benchmark(
    module="benchmarks.networks.contact_frames",
    measures="The contact predicted from frames of a real DIGIT, compared with the fitted balls.",
    minutes=4,
    sources=("primitives_cad", "sim", "translate"),
    figures=(
        Figure("runs.*.real.depth_rmse_mm", "mm"),
        Figure("runs.*.real.depth_mean_rmse_mm", "mm"),
        Figure("runs.*.real.deepest_error_percent", "%"),
        Figure("runs.*.real.deepest_worst_percent", "%"),
        Figure("runs.*.real.iou"),
        Figure("runs.*.real.force_error_percent", "%"),
        Figure("runs.*.real.center_error_mm", "mm"),
        Figure("runs.*.simulated.depth_rmse_mm", "mm"),
        Figure("runs.*.background_area_mm2", "mm2"),
        Figure("runs.*.milliseconds", "ms"),
    ),
    arguments=(
        Argument("frames", "folder of background.png and press_*.png", Path),
        Argument("runs", "folders of trained runs that predict the contact", Path, nargs="+"),
    ),
)

TIMED = 20
"""Predictions that the time is the median of."""


def measure(options: Namespace) -> dict[str, Any]:
    from t2twin.translate.inference.load import load_run
    from t2twin.translate.inference.predictor import FieldPredictor, require

    names, frames, background, references = ball_references(options.frames)
    runs = {}
    for folder in options.runs:
        run: Any = require(load_run(folder), FieldPredictor, "the contact")  # one or several
        found = {"real": frames, "simulated": [each.image for each in references]}
        runs[str(folder)] = {
            kind: _errors(run.contact(list(images), background), references)
            for kind, images in found.items()
        } | {
            "background_area_mm2": run.contact(background, background).area_mm2,
            "milliseconds": _milliseconds(run, frames[0], background),
        }
    return {"frames": names, "runs": runs}


def ball_references(
    folder: Path,
) -> tuple[list[str], np.ndarray, np.ndarray, list[ImageReading]]:
    """Names and frames of all presses in a folder, the background frame, and the simulated readings
    of the balls at the places and depths that fitted optics find."""
    report = calibrate(
        folder / "background.png", folder, BALL_DIAMETER_MM, HELD_OUT, tolerance=None
    )
    background, frames, found = read_frames(folder / "background.png", folder, SENSOR.camera)
    names = [*report.trained, *report.held_out]
    frames = frames[[found.index(name) for name in names]]
    poses = np.concatenate([report.training_poses, report.poses])
    references = []
    with tempfile.TemporaryDirectory() as temporary:
        optics = Path(temporary) / "optics.npz"
        report.optics.save(optics)
        sensor = SENSOR.with_options({"optics": optics, "frames": 1})
        ball = write_ball(Path(temporary) / "ball.step", BALL_DIAMETER_MM)
        for number, (x_mm, y_mm, depth_mm) in enumerate(poses.tolist()):
            command = PressCommand(ball.name, x_mm, y_mm, 0.0, 1.0)
            force_n = force_at_depth(partial(sensor.press, ball), command, depth_mm)
            contact = sensor.press(ball, replace(command, force_n=force_n))
            reading = sensor.read(contact, np.random.default_rng(number))
            _ = reading.depth_map_mm, reading.pressure_map_kpa  # the file of the optics goes away
            references.append(reading)
    return names, frames, background, references


def _errors(
    contacts: list[ContactEstimate], references: list[ImageReading]
) -> dict[str, float | list[float]]:
    """Errors of the contacts of all presses, in the cells of the contact maps."""
    from t2twin.translate.models.contact import CONTACT_KPA

    rmse, deepest, iou, force, center = [], [], [], [], []
    for contact, reference in zip(contacts, references, strict=True):
        depth, pressure = reference.depth_map_mm, reference.pressure_map_kpa
        inside, rows_columns = pressure > CONTACT_KPA, pressure.shape
        found = _in_cells(contact.depth_mm, rows_columns)
        mask = _in_cells(contact.mask, rows_columns) > 0.5
        rmse.append(float(np.sqrt(np.square(found - depth)[inside].mean())))
        deepest.append(abs(found[inside].max() / depth[inside].max() - 1.0))
        iou.append((inside & mask).sum() / (inside | mask).sum())
        assert reference.contact is not None and contact.force_n is not None
        force.append(abs(float(contact.force_n) / reference.contact.force_n - 1.0))
        center.append(float(np.hypot(*(contact.center_mm - _center_mm(pressure, contact)))))
    return {
        "depth_rmse_mm": float(np.median(rmse)),
        "depth_mean_rmse_mm": float(np.mean(rmse)),
        "deepest_error_percent": 100.0 * float(np.median(deepest)),
        "deepest_worst_percent": 100.0 * float(np.max(deepest)),
        "iou": float(np.mean(iou)),
        "force_error_percent": 100.0 * float(np.median(force)),
        "center_error_mm": float(np.median(center)),
        "each_depth_rmse_mm": rmse,
    }


def _in_cells(values: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Means of pixels over cells of equal size, float64."""
    rows, columns = (size // cells for size, cells in zip(values.shape, shape, strict=True))
    return values.reshape(shape[0], rows, shape[1], columns).mean(axis=(1, 3), dtype=float)


def _center_mm(pressure: np.ndarray, contact: ContactEstimate) -> np.ndarray:
    """The center of a true pressure in the view, as ContactEstimate.center_mm."""
    share = pressure / pressure.sum()
    axes = (share.sum(axis=0), share.sum(axis=1))
    return np.array([
        2.0 * half * (weights @ (np.arange(weights.size) + 0.5) / weights.size - 0.5)
        for half, weights in zip(contact.view_mm, axes, strict=True)
    ])  # fmt: skip


def _milliseconds(run: FieldPredictor, frame: np.ndarray, background: np.ndarray) -> float:
    """Median time of a prediction of one frame."""
    seconds = []
    for _ in range(TIMED + 1):
        start = time.perf_counter()
        run.contact(frame, background)
        seconds.append(time.perf_counter() - start)
    return 1e3 * float(np.median(seconds[1:]))


if __name__ == "__main__":
    main(BENCHMARK)
