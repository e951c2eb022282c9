"""Calibrate the simulation to one DIGIT, and adapt the pretrained network to it.

python examples/adapt_to_a_sensor.py --background background.png --presses my_presses \\
    --ball-diameter-mm 4.7 --minutes 60 --out runs/mine

The presses are 15 to 25 images of one ball at unknown places and depths. Without them, the example
simulates the frames of a sensor with another lighting, as stand-ins.
"""

import argparse
from pathlib import Path

import numpy as np
from PIL import Image

import t2twin
from t2twin.primitives_cad.solids import write_ball
from t2twin.sim.optical.units import UnitRanges, sample_unit
from t2twin.sim.sensors.pair import SensorPair

BALL_MM = 4.7


def simulate(folder: Path, number: int) -> tuple[Path, Path]:
    """Write a background frame and presses of a ball, and return the file and the folder."""
    rng = np.random.default_rng(7)
    camera = SensorPair().camera
    camera = camera.with_unit(sample_unit(rng, camera.spec, UnitRanges()))
    sensors = SensorPair(source=camera)
    presses = folder / "presses"
    presses.mkdir(parents=True, exist_ok=True)
    ball = write_ball(folder / "ball.step", BALL_MM)
    for index in range(number):
        x_mm, y_mm = rng.uniform((-2.5, -3.5), (2.5, 3.5))
        force_n = rng.uniform(1.5, 5.0)
        command = t2twin.PressCommand(ball.name, float(x_mm), float(y_mm), 0.0, float(force_n))
        touch = sensors.press(ball, command, rng, only=camera.name)
        Image.fromarray(touch.image).save(presses / f"press_{index:02d}.png")
    Image.fromarray(camera.background_frame(rng)).save(folder / "background.png")
    return folder / "background.png", presses


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--background", type=Path)
    parser.add_argument("--presses", type=Path)
    parser.add_argument("--ball-diameter-mm", type=float, default=BALL_MM)
    parser.add_argument("--minutes", type=float, default=12.0)
    parser.add_argument("--calibrate-only", action="store_true", help="without training")
    parser.add_argument("--out", type=Path, default=Path("runs/mine"))
    given = parser.parse_args()
    background, presses = given.background, given.presses
    if presses is None:
        background, presses = simulate(given.out.parent / "stand_ins", 16)
    if given.calibrate_only:
        report = t2twin.calibrate(background, presses, given.ball_diameter_mm, tolerance=None)
        print(f"held-out presses: {report.scores['calibrated'].psnr_db:.1f} dB")
    else:
        t2twin.adapt(background, presses, given.ball_diameter_mm, given.out, minutes=given.minutes)
