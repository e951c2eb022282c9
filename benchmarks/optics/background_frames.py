"""Accuracy of lights that are estimated from the background frame of a real DIGIT.

    python -m benchmarks background_frames FRAMES

FRAMES is a folder with background.png and press_*.png of a 4.70 mm ball. It is not part of the
project. Every light renders the presses at the places and depths that the fitted light finds.

- The default light, with its own and with the unit's background.
- The sampled unit whose LEDs explain that background best, with and without a color correction.
- The mean of the best units, and the mean of all (as in `t2twin calibrate --background`).
- The light fitted to the first presses.

All are scored on the last presses.
"""

from argparse import Namespace
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import nnls

from benchmarks.evidence import Argument, Benchmark, Figure
from benchmarks.optics.fitted_optics import BALL_DIAMETER_MM, HELD_OUT
from t2twin.sim.calibrate.calibrate import calibrate, mean_light, sample_lights
from t2twin.sim.calibrate.frames import Score, contact_patch, crop_scores, mean_score, read_frames
from t2twin.sim.optical.image_renderer import ImageRenderer
from t2twin.sim.optical.optics import Optics
from t2twin.sim.optical.response import linear
from t2twin.sim.optical.units import light_at_rest
from t2twin.sim.sensors.pair import SensorPair

BENCHMARK = Benchmark(
    module="benchmarks.optics.background_frames",
    minutes=2,
    sources=("sim/calibrate", "sim/optical"),
    figures=(Figure("held_out_presses.*.psnr_db", "dB"), Figure("held_out_presses.*.ssim")),
    arguments=(Argument("frames", "folder of background.png and press_*.png", Path),),
)

DRAWN = 1000
"""Sampled units."""
NEAREST = 30
"""Number of the best units that are averaged."""
BLOCK_PX = 10
"""Side of the blocks of pixels that are compared, px."""

SENSOR = SensorPair().camera
GEL, LEDS = SENSOR.own_gel, SENSOR.spec.light.leds


@dataclass(frozen=True)
class Explained:
    """A sampled unit fitted to the background frame.

    gains: (3,) of the LEDs' colors, in addition to an even light in each color. off_grey: RMSE of
    the fit, grey levels.
    """

    light: Optics
    gains: np.ndarray
    off_grey: float

    @property
    def bent(self) -> Optics:
        """The light with the fitted gains of the colors."""
        return replace(self.light, response=self.light.response * self.gains[None, :, None, None])


def measure(options: Namespace) -> dict[str, Any]:
    background = options.frames / "background.png"
    report = calibrate(background, options.frames, BALL_DIAMETER_MM, HELD_OUT, tolerance=None)
    background, _, _ = read_frames(background, options.frames, SENSOR.camera)
    patches = np.array([contact_patch(frame, background) for frame in report.real])

    def score(light: Optics) -> Score:
        renderer = ImageRenderer(light, GEL, SENSOR.spec.camera.noise_grey)
        shown = np.array([renderer.render(surface_mm) for surface_mm in report.surfaces_mm])
        return mean_score(crop_scores(report.real, shown, patches))

    explained = sorted(_explained(background), key=lambda one: one.off_grey)
    shipped, best = SENSOR.optics, [one.light for one in explained[:NEAREST]]
    lights = {
        "shipped": shipped,
        "shipped_on_own_background": replace(shipped, background=background),
        "nearest": best[0],
        "nearest_bent": explained[0].bent,
        "mean_of_nearest": mean_light(best),
        "mean_of_all": mean_light(sample_lights(background, SENSOR, SENSOR.camera)),
        "fitted": report.scored_by,
    }
    return {
        "held_out": [press.name for press in report.held_out],
        "drawn": DRAWN,
        "averaged": NEAREST,
        "held_out_presses": {name: asdict(score(light)) for name, light in lights.items()},
    }


def _explained(background: np.ndarray) -> list[Explained]:
    rows, columns = SENSOR.camera.rows, SENSOR.camera.columns
    blocks = background.reshape(rows // BLOCK_PX, BLOCK_PX, columns // BLOCK_PX, BLOCK_PX, 3)
    grey = blocks.mean(axis=(1, 3))
    rows, columns = (BLOCK_PX * np.arange(n) + (BLOCK_PX - 1) / 2 for n in grey.shape[:2])
    explained = []
    for unit in sample_lights(background, SENSOR, SENSOR.camera, DRAWN):
        lit = light_at_rest(unit, GEL, columns, rows).reshape(-1, 3)
        wanted = linear(grey, unit.gamma).reshape(-1, 3)
        fits = [
            nnls(np.stack([lit[:, c], np.ones(len(lit))], axis=1), wanted[:, c]) for c in range(3)
        ]
        off = 255.0 * np.sqrt(np.sum([error**2 for _, error in fits]) / wanted.size)
        explained.append(Explained(unit, np.array([gain for (gain, _), _ in fits]), float(off)))
    return explained
