"""Accuracy of an optics file with known displacements, forces and a second ball.

    python -m benchmarks anchors

Simulates eight presses of one ball and of two balls, with a known scale and gel, in the default
light. Measures the errors of scale, depths and modulus with and without known displacements and
forces, and whether the stated ranges contain the truth.
"""

import csv
import tempfile
from argparse import Namespace
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import structs
from PIL import Image

from benchmarks.evidence import Benchmark, Figure
from t2twin.sim.calibrate.calibrate import (
    FORCES,
    Bounds,
    OpticsUncertainty,
    ball_forces_n,
    calibrate,
)
from t2twin.sim.optical.image_renderer import ImageRenderer
from t2twin.sim.optical.surface import ball_surface
from t2twin.sim.sensors.pair import SensorPair

BENCHMARK = Benchmark(
    module="benchmarks.optics.anchors",
    minutes=6,
    sources=("primitives_cad", "sim/contact", "sim/calibrate", "sim/optical"),
    figures=tuple(
        figure
        for balls in ("one_ball", "two_balls")
        for figure in (
            Figure(f"{balls}.stated.depth_range"),
            Figure(f"{balls}.stated.depths_inside", least=8),
            Figure(f"{balls}.anchored.scale_off_percent", "%", most=2.0),
            Figure(f"{balls}.anchored.young_off_percent", "%", most=5.0),
            Figure(f"{balls}.anchored.depth_off_percent", "%", most=3.0),
            Figure(f"{balls}.anchored.depths_inside", least=8),
        )
    ),
)

SCALE_PX_PER_MM, YOUNG_MPA = 18.0, 0.42
"""Of the twins; stated are 19.2 px/mm and assumed 0.5 MPa."""
BALLS_MM = {"one_ball": (4.7,), "two_balls": (4.0, 6.0)}
BALL, DEPTH, FORCE = "ball_diameter_mm", "depth_mm", "force_n"
"""Columns of the table beside the frames."""
PRESSES, HELD_OUT, DISPLACEMENTS = 8, 2, 3
SENSOR = SensorPair().camera
GEL, NOISE_GREY = SENSOR.own_gel, SENSOR.spec.camera.noise_grey


def measure(options: Namespace) -> dict[str, Any]:
    rng = np.random.default_rng(0)
    poses = np.stack(
        [rng.uniform(-2.5, 2.5, PRESSES), rng.uniform(-3.5, 3.5, PRESSES),
         rng.uniform(0.7, 1.3, PRESSES)], axis=1
    )  # fmt: skip
    content: dict[str, Any] = {"scale_px_per_mm": SCALE_PX_PER_MM, "young_mpa": YOUNG_MPA}
    for name, balls_mm in BALLS_MM.items():
        diameters_mm = np.resize(balls_mm, PRESSES)
        background, frames = _frames(poses, diameters_mm, rng)
        forces_n = ball_forces_n(SENSOR, poses, diameters_mm) * YOUNG_MPA / GEL.young_mpa
        known = {BALL: diameters_mm}
        stated = _certainty(background, frames, known)
        known |= {DEPTH: poses[:DISPLACEMENTS, 2], FORCE: forces_n}
        anchored = _certainty(background, frames, known)
        content[name] = {"stated": _beside(stated, poses), "anchored": _beside(anchored, poses)}
    return content


def _frames(
    poses: np.ndarray, diameters_mm: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """The background frame and those of the presses, (n, rows, columns, 3) uint8."""
    renderer = ImageRenderer(
        replace(
            SENSOR.optics,
            camera=structs.replace(SENSOR.optics.camera, scale_px_per_mm=SCALE_PX_PER_MM),
        ),
        GEL,
        NOISE_GREY,
    )
    still = renderer.render(0.0 * ball_surface(GEL, 0.0, 0.0, 1.0), rng, NOISE_GREY)
    surfaces = (
        ball_surface(GEL, x_mm, y_mm, depth_mm, diameter_mm / 2)
        for (x_mm, y_mm, depth_mm), diameter_mm in zip(poses, diameters_mm, strict=True)
    )
    return still, np.array([renderer.render(surface, rng, NOISE_GREY) for surface in surfaces])


def _certainty(
    background: np.ndarray, frames: np.ndarray, known: Mapping[str, np.ndarray]
) -> OpticsUncertainty:
    """Of an optics file of these frames. known: columns of the table, for as many first presses."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        Image.fromarray(background).save(folder / "background.png")
        names = [f"press_{index:02d}.png" for index in range(PRESSES)]
        for path, frame in zip(names, frames, strict=True):
            Image.fromarray(frame).save(folder / path)
        with (folder / FORCES).open("w", newline="") as file:
            table = csv.writer(file)
            table.writerow(["file", *known])
            for index, path in enumerate(names):
                cells = (of[index] if index < len(of) else "" for of in known.values())
                table.writerow([path, *cells])
        ball_mm = float(known[BALL][0])
        certainty = calibrate(folder / "background.png", folder, ball_mm, HELD_OUT).uncertainty
    assert certainty is not None
    return certainty


def _beside(certainty: OpticsUncertainty, poses: np.ndarray) -> dict[str, Any]:
    """How far from the truth, in percent, and how many ranges hold it."""
    depths = [press.depth_mm for press in certainty.presses]
    pairs = list(zip(depths, poses[:, 2].tolist(), strict=True))
    young = certainty.young_mpa
    return {
        "scale_off_percent": _percent(certainty.scale_px_per_mm, SCALE_PX_PER_MM),
        "young_off_percent": None if young is None else _percent(young, YOUNG_MPA),
        "depth_off_percent": float(np.mean([_percent(*each) for each in pairs])),
        "depth_range": float(np.mean([of.high / of.low for of in depths])),
        "depths_inside": sum(bool(of.low <= truth <= of.high) for of, truth in pairs),
    }


def _percent(span: Bounds, truth: float) -> float:
    return abs(100.0 * (span.value / truth - 1.0))
