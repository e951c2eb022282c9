"""How near the baked DIGIT picture is to the rendered reference, and what each costs.

    python -m benchmarks.digit_render [--presses 100]

Presses the shapes of the catalogue in turn at 8 N into the DIGIT's gel, renders each deflection
both ways, and scores the baked picture on the 100 x 100 pixels at the contact, beside the row
for showing the untouched background instead. Writes benchmarks/results/digit_render.json.
"""

import argparse
import json
import os
import platform
import statistics
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from skimage.metrics import structural_similarity

from t2twin.primitives_cad.catalogue import NAMES, load
from t2twin.sim.digit.camera import COLUMNS, DIGIT_CAMERA, ROWS, optical_grid
from t2twin.sim.digit.optics import DigitOptics
from t2twin.sim.digit.reference import ReferenceRenderer
from t2twin.sim.press.elastomer import DIGIT_GEL
from t2twin.sim.press.engine import DIGIT_PITCH_MM, press
from t2twin.sim.press.records import PressCommand
from t2twin.sim.press.surface import surface_on

FORCE_N = 8.0
HALF_CROP_PX = 50
REPEATS = 10
LEAST_PSNR_DB, LEAST_SSIM, MOST_MS = 32.0, 0.95, 5.0
TACTO_MS = 51.0
"""TACTO's renderer, ms a frame of 240 x 320, a plain ball without shadows, software GL on two
cores (measured with TACTO as published; not part of this run)."""
RESULTS = Path(__file__).parent / "results" / "digit_render.json"


def deflections(presses: int) -> Iterator[tuple[PressCommand, np.ndarray]]:
    """The presses, each a little off the middle and turned, and the gel's deflection under it."""
    rng = np.random.default_rng(0)
    names = list(NAMES)
    rng.shuffle(names)
    for number in range(presses):
        name = names[number % len(names)]
        shape = load(name)
        x_mm, y_mm = rng.uniform(-1.5, 1.5, size=2)
        command = PressCommand(
            name, float(x_mm), float(y_mm), float(rng.uniform(0.0, 6.28)), FORCE_N
        )
        contact = press(shape, command, DIGIT_GEL, DIGIT_PITCH_MM)
        surface = surface_on(contact, shape, command, DIGIT_GEL, *optical_grid())
        yield command, surface


def contact_crop(picture: np.ndarray, command: PressCommand) -> np.ndarray:
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
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--presses", type=int, default=100)
    presses = parser.parse_args().presses
    optics = DigitOptics.load()
    rng = np.random.default_rng(1)
    rows, baked_ms, noisy_ms, reference_ms = [], [], [], []
    print(f"{'shape':22s} {'PSNR dB':>8s} {'SSIM':>7s}   background: {'PSNR dB':>8s} {'SSIM':>7s}")
    with ReferenceRenderer() as renderer:
        for number, (command, surface) in enumerate(deflections(presses)):
            if number == 0:  # loads the compiled loops and the shaders
                optics.render(surface, rng)
                renderer.render(surface)
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
            row = rows[-1]
            print(
                f"{number + 1:4d} {row['shape']:17s} {row['psnr_db']:8.2f} {row['ssim']:7.4f}"
                f"               {row['background_psnr_db']:8.2f} {row['background_ssim']:7.4f}",
                flush=True,
            )
    timings = {
        "baked_ms": statistics.median(baked_ms),
        "baked_best_ms": min(baked_ms),
        "baked_noisy_ms": statistics.median(noisy_ms),
        "baked_noisy_best_ms": min(noisy_ms),
        "reference_ms": statistics.median(reference_ms),
    }
    timings["reference_over_baked"] = timings["reference_ms"] / timings["baked_ms"]
    timings["tacto_published_ms"] = TACTO_MS
    timings["tacto_over_baked"] = TACTO_MS / timings["baked_ms"]
    psnrs, ssims = ([row[name] for row in rows] for name in ("psnr_db", "ssim"))
    scores = {
        "least_psnr_db": min(psnrs),
        "median_psnr_db": statistics.median(psnrs),
        "least_ssim": min(ssims),
        "median_ssim": statistics.median(ssims),
        "share_under_32_db": float(np.mean(np.array(psnrs) < LEAST_PSNR_DB)),
        "share_under_0.95": float(np.mean(np.array(ssims) < LEAST_SSIM)),
    }
    for name, value in {**scores, **timings}.items():
        print(f"digit_render.{name:22s} {value:10.4g}")
    print(
        f"TACTO: {TACTO_MS:g} ms a frame at 240 x 320 without shadows, software GL, two cores; "
        f"ours: {timings['baked_ms']:.2f} ms with shadows on one (limit {MOST_MS:g} ms)"
    )
    RESULTS.parent.mkdir(exist_ok=True)
    part = RESULTS.with_suffix(".json.part")
    part.write_text(
        json.dumps(
            {
                "command": f"python -m benchmarks.digit_render --presses {presses}",
                "python": platform.python_version(),
                "cores": os.cpu_count(),
                "load_average": os.getloadavg()[0],
                "crop": "100 x 100 px at the contact",
                "rows": rows,
                **scores,
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
