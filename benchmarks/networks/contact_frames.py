"""The contact predicted for one real DIGIT, compared with gradients by color and Poisson.

    python -m benchmarks contact_frames FRAMES RUN [RUN ...]

FRAMES is a folder with background.png and press_*.png of a 4.70 mm ball. It is not part of the
project. Runs are those of `t2twin train` that predict the contact. They are evaluated on two sets:

- the frames. Optics fitted to them give the place and the depth of the ball in each; the reference
  is the simulated press of the ball there;
- simulated presses of random shapes and tools into a unit with these optics.

Gradients and Poisson (module gradients) are trained on two thirds of the frames and evaluated on
the other third, in turn. For the other set they are trained on the simulated frames of the balls.
The reference is the depth of the gel and the mask of the contact, in the cells of the contact maps.
"""

from __future__ import annotations

import tempfile
from argparse import Namespace
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.evidence import Argument, Benchmark, Figure
from benchmarks.networks.real import runs_by_name
from benchmarks.optics.fitted_optics import (
    BALL_DIAMETER_MM,
    HELD_OUT,
    ROTATIONS,
    SENSOR,
    read_frames,
)
from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.catalogue import OBJECTS
from t2twin.sim.calibrate.calibrate import calibrate
from t2twin.sim.contact.contact_solver import force_at_depth
from t2twin.sim.contact.types import PressCommand
from t2twin.sim.optical.gel_camera import depth_on

if TYPE_CHECKING:
    from collections.abc import Iterable

    from t2twin.sim.optical.gel_camera import GelCamera
    from t2twin.translate.inference.estimate import ContactEstimate

BENCHMARK = Benchmark(
    module="benchmarks.networks.contact_frames",
    minutes=8,
    sources=("primitives_cad", "sim", "translate"),
    figures=(
        Figure("runs.*.real.depth_rmse_mm", "mm"),
        Figure("runs.*.real.deepest_error_percent", "%"),
        Figure("runs.*.real.deepest_worst_percent", "%"),
        Figure("runs.*.shapes.depth_rmse_mm", "mm"),
        Figure("runs.*.shapes.iou"),
        Figure("gradients.real.depth_rmse_mm", "mm"),
        Figure("gradients.real.deepest_worst_percent", "%"),
        Figure("gradients.shapes.depth_rmse_mm", "mm"),
    ),
    arguments=(
        Argument("frames", "folder of background.png and press_*.png", Path),
        Argument("runs", "folders of trained runs that predict the contact", Path, nargs="+"),
    ),
)

BACKGROUND = "background.png"

SHAPES = (*(f"random-{seed}" for seed in range(9_000, 9_020)), *OBJECTS)
"""Shapes of the simulated presses; no recipe samples these random shapes."""

FORCES_N = (1.0, 2.0, 4.0, 8.0)
"""Forces of the presses, in turn."""


def measure(options: Namespace) -> dict[str, Any]:
    if not (options.frames / BACKGROUND).is_file():
        raise T2TwinError(
            f"{options.frames} has no {BACKGROUND}; expected a folder of it and press_*.png, "
            "frames of a real DIGIT, which are not part of the project"
        )
    names, frames, background, balls = ball_references(options.frames)
    sensor = balls[0].sensor
    shapes, still = shape_references(sensor), sensor.background_frame(np.random.default_rng(0))
    runs = {}
    for name, each in runs_by_name(options.runs).items():
        run: Any = each  # whose contact is one or several
        images = [each.image for each in shapes]
        runs[name] = {
            "real": _errors(run.contact(list(frames), background), balls),
            "shapes": _errors(run.contact(images, still), shapes),
        }
    return {
        "frames": names,
        "runs": runs,
        "gradients": _of_gradients(frames, background, balls, shapes, still),
    }


def _of_gradients(
    frames: np.ndarray,
    background: np.ndarray,
    balls: list[Any],
    shapes: list[Any],
    still: np.ndarray,
) -> dict[str, Any]:
    """Errors of the depth by gradients and Poisson."""
    from benchmarks.networks.gradients import REDUCTION, DepthFromGradients

    camera = balls[0].sensor.camera
    grid = camera.rows // REDUCTION, camera.columns // REDUCTION
    optics = balls[0].sensor.optics.camera
    depths = np.stack([depth_on(grid, each.contact, optics) for each in balls])
    view_mm = camera.seen_half_extent_mm()
    found = np.empty_like(depths)
    for rotation in range(ROTATIONS):
        held_out = np.arange(len(frames)) % ROTATIONS == rotation
        model = DepthFromGradients(frames[~held_out], background, depths[~held_out], view_mm)
        found[held_out] = [model.depth_mm(frame) for frame in frames[held_out]]
    simulated = np.stack([each.image for each in balls])
    model = DepthFromGradients(simulated, still, depths, view_mm)
    return {
        "real": _depth_errors(found, balls),
        "shapes": _depth_errors([model.depth_mm(each.image) for each in shapes], shapes),
    }


def shape_references(sensor: GelCamera) -> list[Any]:
    """Readings of presses of SHAPES into a gel camera."""
    readings = []
    for number, name in enumerate(SHAPES):
        shape, rng = catalogue.load(name), np.random.default_rng((1, number))
        x_mm, y_mm, yaw_rad = rng.uniform(-1.5, 1.5), rng.uniform(-2.0, 2.0), rng.uniform(0.0, 6.28)
        force_n = FORCES_N[number % len(FORCES_N)]
        contact = sensor.press(shape, PressCommand(name, x_mm, y_mm, yaw_rad, force_n))
        readings.append(sensor.read(contact, rng))
    return readings


def ball_references(folder: Path) -> tuple[list[str], np.ndarray, np.ndarray, list[Any]]:
    """Names and frames of all presses in a folder, the background frame, and the simulated readings
    of the balls at the places and depths that fitted optics find.

    The readings are ImageReading, with contact and image.
    """
    from t2twin.primitives_cad.solids import write_ball  # slow to import

    report = calibrate(folder / BACKGROUND, folder, BALL_DIAMETER_MM, HELD_OUT, tolerance=None)
    background, frames, found = read_frames(folder / BACKGROUND, folder, SENSOR.camera)
    names = [*report.trained, *(press.name for press in report.held_out)]
    frames = frames[[found.index(name) for name in names]]
    poses = report.poses
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


def _errors(contacts: list[ContactEstimate], references: list[Any]) -> dict[str, float]:
    """Errors of the contacts of all presses, in the cells of the contact maps."""
    from t2twin.translate.models.field import CONTACT_KPA

    iou = []
    for contact, reference in zip(contacts, references, strict=True):
        inside = reference.pressure_map_kpa > CONTACT_KPA
        mask = _in_cells(contact.mask, inside.shape) > 0.5
        iou.append((inside & mask).sum() / (inside | mask).sum())
    found = _depth_errors([each.depth_mm for each in contacts], references)
    return found | {"iou": float(np.mean(iou))}


def _depth_errors(depths_mm: Iterable[np.ndarray], references: list[Any]) -> dict[str, float]:
    """Errors of depths in the contacts of all presses, in the cells of the contact maps."""
    from t2twin.translate.models.field import CONTACT_KPA

    rmse, deepest = [], []
    for found, reference in zip(depths_mm, references, strict=True):
        inside, depth = reference.pressure_map_kpa > CONTACT_KPA, reference.depth_map_mm
        in_cells = _in_cells(found, depth.shape)
        rmse.append(float(np.sqrt(np.square(in_cells - depth)[inside].mean())))
        deepest.append(abs(in_cells[inside].max() / depth[inside].max() - 1.0))
    return {
        "depth_rmse_mm": float(np.median(rmse)),
        "deepest_error_percent": 100.0 * float(np.median(deepest)),
        "deepest_worst_percent": 100.0 * float(np.max(deepest)),
    }


def _in_cells(values: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Means of pixels over cells, float64."""
    import torch  # other benchmarks are listed without it
    from torch.nn import functional

    whole = torch.from_numpy(np.asarray(values, float))[None]
    return functional.adaptive_avg_pool2d(whole, (shape[0], shape[1]))[0].numpy()
