"""How near the baked DIGIT picture is to the rendered reference, and what each costs.

    python benchmarks/digit_render.py

Presses one version of each primitive family at 8 N into the DIGIT's gel, renders each deflection
both ways, and scores the baked picture on the 100 x 100 pixels at the contact, beside the row
for showing the untouched background instead. Writes benchmarks/results/digit_render.json.
"""

import json
import os
import platform
import statistics
import sys
import time
from pathlib import Path

import numpy as np
from skimage.metrics import structural_similarity

from primitives_cad.catalogue import load
from sim.digit.camera import COLUMNS, DIGIT_CAMERA, ROWS, optical_grid
from sim.digit.optics import DigitOptics
from sim.digit.reference import ReferenceRenderer
from sim.press.elastomer import DIGIT_GEL
from sim.press.engine import DIGIT_PITCH_MM, press
from sim.press.surface import surface_on
from sim.records import Press

SHAPES = (
    "line-smooth-1",
    "square-2",
    "circle-empty-4",
    "circle-1",
    "bump-2",
    "square-empty-4",
    "hemisphere-1",
    "line-sharp-2",
)
FORCE_N = 8.0
HALF_CROP_PX = 50
REPEATS = 40
RESULTS = Path(__file__).parent / "results" / "digit_render.json"


def deflections() -> list[tuple[Press, np.ndarray]]:
    """The presses, each a little off the middle and turned, and the gel's deflection under it."""
    rng = np.random.default_rng(0)
    pressed = []
    for name in SHAPES:
        shape = load(name)
        x_mm, y_mm = rng.uniform(-1.5, 1.5, size=2)
        command = Press(name, float(x_mm), float(y_mm), float(rng.uniform(0.0, 6.28)), FORCE_N)
        contact = press(shape, command, DIGIT_GEL, DIGIT_PITCH_MM)
        surface = surface_on(contact, shape, command, DIGIT_GEL, *optical_grid())
        pressed.append((command, surface))
    return pressed


def contact_crop(picture: np.ndarray, command: Press) -> np.ndarray:
    """The 100 x 100 pixels around a press, as far in as the picture allows."""
    row, column = (
        int(np.clip(round(float(value)), HALF_CROP_PX, count - HALF_CROP_PX))
        for value, count in zip(
            DIGIT_CAMERA.project(np.array(command.x_mm), np.array(command.y_mm), np.array(0.0)),
            (ROWS, COLUMNS),
            strict=True,
        )
    )
    return picture[
        row - HALF_CROP_PX : row + HALF_CROP_PX, column - HALF_CROP_PX : column + HALF_CROP_PX
    ].astype(float)


def psnr(wanted: np.ndarray, given: np.ndarray) -> float:
    """Peak signal-to-noise ratio, dB, of 8-bit grey levels."""
    return float(10.0 * np.log10(255.0**2 / np.mean((wanted - given) ** 2)))


def ssim(wanted: np.ndarray, given: np.ndarray) -> float:
    """Mean structural similarity over the colours."""
    return float(np.mean(structural_similarity(wanted, given, channel_axis=2, data_range=255)))


def main() -> None:
    presses = deflections()
    optics = DigitOptics.load()
    rng = np.random.default_rng(1)
    rows, baked_ms, noisy_ms, reference_ms = [], [], [], []
    optics.render(presses[0][1], rng)  # loads the compiled loops
    with ReferenceRenderer() as renderer:
        renderer.render(presses[0][1])
        for command, surface in presses:
            started = time.perf_counter()
            wanted = renderer.render(surface)
            reference_ms.append(1e3 * (time.perf_counter() - started))
            given = optics.render(surface)
            for generator, times in ((None, baked_ms), (rng, noisy_ms)):
                for _ in range(REPEATS):
                    started = time.perf_counter()
                    optics.render(surface, generator)
                    times.append(1e3 * (time.perf_counter() - started))
            truth, baked, still = (
                contact_crop(picture, command) for picture in (wanted, given, optics.background)
            )
            rows.append(
                {
                    "shape": command.shape,
                    "psnr_db": psnr(truth, baked),
                    "ssim": ssim(truth, baked),
                    "background_psnr_db": psnr(truth, still),
                    "background_ssim": ssim(truth, still),
                }
            )
    print(f"{'shape':16s} {'PSNR dB':>8s} {'SSIM':>7s}   background: {'PSNR dB':>8s} {'SSIM':>7s}")
    for row in rows:
        print(
            f"{row['shape']:16s} {row['psnr_db']:8.2f} {row['ssim']:7.4f}"
            f"               {row['background_psnr_db']:8.2f} {row['background_ssim']:7.4f}"
        )
    timings = {
        "baked_ms": statistics.median(baked_ms),
        "baked_best_ms": min(baked_ms),
        "baked_noisy_ms": statistics.median(noisy_ms),
        "baked_noisy_best_ms": min(noisy_ms),
        "reference_ms": statistics.median(reference_ms),
    }
    for name, value in timings.items():
        print(f"digit_render.{name:22s} {value:10.2f}")
    RESULTS.parent.mkdir(exist_ok=True)
    part = RESULTS.with_suffix(".json.part")
    part.write_text(
        json.dumps(
            {
                "command": "python benchmarks/digit_render.py",
                "python": platform.python_version(),
                "cores": os.cpu_count(),
                "load_average": os.getloadavg()[0],
                "crop": "100 x 100 px at the contact",
                "rows": rows,
                "least_psnr_db": min(row["psnr_db"] for row in rows),
                "least_ssim": min(row["ssim"] for row in rows),
                **timings,
            },
            indent=2,
        )
        + "\n"
    )
    part.replace(RESULTS)
    print(f"wrote {RESULTS}")


if __name__ == "__main__":
    sys.exit(main())
