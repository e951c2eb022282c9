"""Frames of a unit whose light is known: the shipped one, pressed by a ball."""

from pathlib import Path

import numpy as np
from kinds import gel_camera
from PIL import Image

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


def write_frames(folder: Path) -> None:
    """background.png and press_*.png, with a frame's noise."""
    folder.mkdir(parents=True, exist_ok=True)
    digit, rng = gel_camera(), np.random.default_rng(3)
    renderer, gel = digit.image_renderer, digit.own_gel
    still = ball_surface(gel, 0, 0, 1.0) * 0
    save(renderer.render(still, rng), folder / "background.png")
    for index, (x_mm, y_mm, depth_mm) in enumerate(POSES):
        surface = ball_surface(gel, x_mm, y_mm, depth_mm, BALL_MM / 2)
        save(renderer.render(surface, rng), folder / f"press_{index:02d}.png")
