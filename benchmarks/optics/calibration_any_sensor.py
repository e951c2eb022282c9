"""Calibration of gel cameras on simulated frames of units whose light is not that of their file.

    python -m benchmarks.optics.calibration_any_sensor

The LEDs of each unit are turned around the gel by a quarter or a half, their colors are exchanged,
and their heights and brightness vary. A ball is pressed into each unit by the contact solver. The
last presses are held out. The fit starts from the sensor's file, which describes another light.
"""

from argparse import Namespace
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from msgspec import structs
from PIL import Image

from benchmarks.evidence.record import Argument, Benchmark, Figure
from benchmarks.evidence.run import main
from t2twin.primitives_cad.export import write_ball
from t2twin.sim.calibrate.calibrate import Score, calibrate, mean_score, sensor_and_camera
from t2twin.sim.contact.types import PressCommand
from t2twin.sim.optical.gel_camera import GelCamera

SENSORS = ("digit", "gelsight-mini")
BENCHMARK = Benchmark(
    module="benchmarks.optics.calibration_any_sensor",
    measures="Calibration of gel cameras on simulated frames of units of another light.",
    minutes=25,
    sources=("sim/calibrate", "sim/optical", "sim/sensors"),
    figures=(
        *(Figure(f"{name}.mean.psnr_db", "dB") for name in SENSORS),
        *(Figure(f"{name}.mean.ssim") for name in SENSORS),
        *(Figure(f"{name}.do_nothing.psnr_db", "dB") for name in SENSORS),
        # A sensor of any size and light is fitted as well as the first.
        Figure("behind_first_db", "dB", most=1.0),
    ),
    arguments=(
        Argument("--units", "units of each sensor", int, 2, partial=True),
        Argument("--presses", "presses of the ball into each unit", int, 22, partial=True),
        Argument("--held-out", "scored presses, the last ones", int, 7, partial=True),
    ),
)

BALL_MM = 4.7
FORCES_N = (1.0, 6.0)
TURNS_DEG = (90.0, 180.0)
"""Turns of the LEDs around the gel, one unit after the other."""
EDGE_MM = 1.5
"""Smallest distance of a press to the edge of the image, mm (assumed)."""
GOLDEN = (np.sqrt(5.0) - 1.0) / 2.0


def unit_of(sensor: GelCamera, number: int) -> GelCamera:
    """The sensor with LEDs turned as a whole, brighter or dimmer, in exchanged colors."""
    rng, turn_deg = np.random.default_rng((3, number)), TURNS_DEG[number % len(TURNS_DEG)]
    cosine, sine = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    leds = []
    for led in sensor.spec.light.leds:
        x_mm, y_mm, z_mm = led.aim_mm
        color = np.roll(led.color, number + 1) * rng.uniform(0.7, 1.3)
        leds.append(
            structs.replace(
                led,
                angle_deg=float((led.angle_deg + turn_deg + rng.uniform(-5, 5)) % 360.0),
                z_mm=led.z_mm * rng.uniform(0.8, 1.2),
                aim_mm=(cosine * x_mm + sine * y_mm, cosine * y_mm - sine * x_mm, z_mm),
                color=tuple(color.tolist()),
            )
        )
    light = structs.replace(sensor.spec.light, leds=tuple(leds), optics=None)
    return GelCamera(structs.replace(sensor.spec, light=light))


def write_frames(folder: Path, unit: GelCamera, presses: int, number: int) -> None:
    """background.png and press_*.png, each with the noise of one frame."""
    rng, ball = np.random.default_rng((4, number)), write_ball(folder / "ball.step", BALL_MM)
    one_frame = unit.with_options({"frames": 1})
    Image.fromarray(one_frame.background_frame(rng)).save(folder / "background.png")
    half = np.array(unit.camera.seen_half_extent_mm()) - EDGE_MM
    for index, place in enumerate(rng.permutation(presses)):
        spread = np.array([GOLDEN * (place + number) % 1.0, (place + 0.5) / presses])
        x_mm, y_mm = ((2.0 * spread - 1.0) * half).tolist()
        command = PressCommand(ball.name, x_mm, y_mm, 0.0, float(rng.uniform(*FORCES_N)))
        image = one_frame.image(unit.press(ball, command), rng)
        Image.fromarray(image).save(folder / f"press_{index:02d}.png")


def fitted(sensor: GelCamera, options: Namespace) -> dict[str, Any]:
    """Scores of the units of one sensor, and their means."""
    units: list[tuple[Score, Score]] = []
    for number in range(options.units):
        with TemporaryDirectory() as name:
            folder = Path(name)
            write_frames(folder, unit_of(sensor, number), options.presses, number)
            report = calibrate(
                folder / "background.png", folder, BALL_MM, options.held_out, tolerance=None,
                sensor=sensor,
            )  # fmt: skip
        units.append((report.scores.calibrated, report.scores.do_nothing))
    ours, still = zip(*units, strict=True)
    return {
        "mean": asdict(mean_score(ours)),
        "do_nothing": asdict(mean_score(still)),
        "each": [asdict(score) for score in ours],
    }


def measure(options: Namespace) -> dict[str, Any]:
    found = {name: fitted(sensor_and_camera(name, None)[0], options) for name in SENSORS}
    psnr_db = [found[name]["mean"]["psnr_db"] for name in SENSORS]
    return {**found, "behind_first_db": psnr_db[0] - min(psnr_db[1:])}


if __name__ == "__main__":
    main(BENCHMARK)
