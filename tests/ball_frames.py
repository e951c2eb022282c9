"""Frames of a unit whose light is known, pressed by a ball: the shipped one, or a small one."""

from pathlib import Path

import numpy as np
import pytest
from kinds import gel_camera
from msgspec import structs
from PIL import Image

from t2twin.core.errors import T2TwinError
from t2twin.sim.calibrate.calibrate import calibrate
from t2twin.sim.optical.gel_camera import GelCamera
from t2twin.sim.optical.surface import ball_surface

BALL_MM = 4.7
POSES = np.array(
    [
        (1.1, -0.6, 1.1), (-2.2, 2.0, 0.8), (0.1, 2.4, 0.9), (-1.6, -1.8, 1.2), (2.2, -3.0, 1.0),
        (-2.4, 0.0, 0.9), (1.2, 0.9, 1.0), (-1.5, -0.5, 1.1), (0.6, -1.9, 0.9),
    ]
)  # fmt: skip
HELD_OUT = 3


def save(picture, path):
    Image.fromarray(picture).save(path)


def small_digit() -> GelCamera:
    """A DIGIT whose images have a quarter of the pixels."""
    own = gel_camera().spec
    camera = structs.replace(own.camera, rows=160, columns=120, scale_px_per_mm=9.6)
    light = structs.replace(own.light, optics="none")
    assert own.units is not None
    units = structs.replace(own.units, scale_px_per_mm=(8.6, 10.6))
    return GelCamera(structs.replace(own, name="small", camera=camera, light=light, units=units))


def refused(folder, *, ball_mm=BALL_MM, **options) -> str:
    """The message with which a calibration to these frames is refused."""
    with pytest.raises(T2TwinError) as error:
        calibrate(folder / "background.png", folder, ball_mm, tolerance=None, **options)
    said = str(error.value)
    assert "\n" not in said
    return said


def write_frames(folder: Path, sensor: GelCamera | None = None) -> None:
    """background.png and press_*.png of a sensor, default a DIGIT, with a frame's noise."""
    folder.mkdir(parents=True, exist_ok=True)
    rng, sensor = np.random.default_rng(3), sensor or gel_camera()
    renderer, gel = sensor.image_renderer, sensor.own_gel
    still = ball_surface(gel, 0, 0, 1.0) * 0
    save(renderer.render(still, rng), folder / "background.png")
    for index, (x_mm, y_mm, depth_mm) in enumerate(POSES):
        surface = ball_surface(gel, x_mm, y_mm, depth_mm, BALL_MM / 2)
        save(renderer.render(surface, rng), folder / f"press_{index:02d}.png")
