"""Simulated recordings with the imperfections "recorded", compared with real ones of a CySkin.

    python -m benchmarks.taxels.recordings [--arrays N]

The real figures are those of 373 public recordings of fingers on a robot's skin, 3 s at 10 Hz
(repository ladylou899/ros2_ws_cyskin_project, src/cyskin_acquisition/data). The simulated fingers
are soft balls that press one array of 20 taxels, hold and release it; another array is untouched.
Each figure is the ratio of the simulated value to the real one.
"""

from argparse import Namespace
from collections.abc import Iterator
from typing import Any

import numpy as np
from msgspec import structs
from tqdm import tqdm

from benchmarks.evidence import Argument, Benchmark, Figure, main
from t2twin.primitives_cad.shape import ball
from t2twin.sim.contact.types import PressCommand
from t2twin.sim.sensors.pair import SensorPair
from t2twin.sim.taxels import reading
from t2twin.sim.taxels.reading import Imperfections
from t2twin.sim.taxels.taxel_array import TaxelArray

REAL: dict[str, dict[str, float]] = {
    "untouched_noise_counts": {"10": 6, "25": 26, "50": 74, "75": 160, "90": 262, "99": 448},
    "untouched_offset_counts": {"10": 4, "50": 51, "90": 319, "99": 781},
    "pressed_noise_percent": {"10": 2.6, "25": 4.3, "50": 6.8, "75": 10.6, "90": 16.1},
    "pressed_noise_counts": {"3000": 380, "10000": 440},
    "kept_percent": {"100": 4.0, "200": 3.5, "500": 2.7, "1000": 2.1},
    "kept_quartiles_percent": {"100 low": 1.6, "100 high": 7.5, "1000 high": 4.9},
    "drift_percent": {"800": 0.3},
}
"""Figures of the real recordings.

untouched_noise_counts, untouched_offset_counts: standard deviation and mean of a taxel's frames,
percentiles over the taxels. pressed_noise_percent: standard deviation of a pressed taxel's frames
over its level, percentiles. pressed_noise_counts: the same in counts, medians from these levels on
(the real ones are given as about 380 to 440 at levels of 3,000 to 14,000). kept_percent: share of
the level that remains these milliseconds after release, medians and quartiles. The lower quartile
after 1 s, 0.1 %, has no useful ratio. drift_percent: rise of a held level in 800 ms, median."""

TOLERANCE = 0.2
"""Largest accepted relative difference from a real figure."""

BENCHMARK = Benchmark(
    module="benchmarks.taxels.recordings",
    measures="Simulated recordings of the array against figures of real ones.",
    minutes=1,
    sources=("sim/taxels", "sim/contact"),
    figures=(
        Figure("largest_counts.*", "counts"),
        Figure("untouched_zero_percent", "%", most=8),
        *(
            Figure(f"ratio.{name}.{key}", most=1 + TOLERANCE, least=1 - TOLERANCE)
            for name, figures in REAL.items()
            for key in figures
        ),
    ),
    arguments=(Argument("--arrays", "simulated arrays for each finger", int, 6),),
)

FINGERS = 60
"""Fingers, each with its own radius, force and place."""

RADII_MM = (8.0, 10.0)
"""Range of the fingers' radii, mm."""

FINGER_YOUNG_MPA = 0.1
"""Modulus of a finger's pulp, MPa (assumed, range 0.05 to 0.2)."""

FORCES_N = (5.0, 7.5)
"""Range of the fingers' forces, N, log-uniform: the largest count of a recording is usually 11,000
to 13,500, as in the real ones."""

PLACE_MM = 8.0
"""Largest distance of a finger from the array's middle along x and y, mm (assumed)."""

UNTOUCHED, HELD, RELEASED = 5, 14, 11
"""Frames of a recording before the press, while held, and after release (assumed; 3 s in all)."""

PRESSED_COUNTS = 3_000
"""Least level of a pressed taxel, counts: the lowest one of pressed_noise_counts."""

SEED = 0


def measure(options: Namespace) -> dict[str, Any]:
    array = SensorPair.of(imperfections="recorded").array
    simulated = simulate(array, options.arrays)
    return {
        "recordings": FINGERS * options.arrays,
        "real": REAL,
        **simulated,
        "ratio": {
            name: {key: simulated["simulated"][name][key] / real for key, real in figures.items()}
            for name, figures in REAL.items()
        },
    }


def simulate(array: TaxelArray, arrays: int) -> dict[str, Any]:
    """The figures of REAL of simulated recordings, and percentiles of their largest counts."""
    rng, quiet = np.random.default_rng(SEED), without_noise(array.flaws)
    pressed, released, drifts, untouched, largest = [], [], [], [], []
    for true_counts in tqdm(list(fingers(array, rng)), desc="recordings", unit="finger"):
        for _ in range(arrays):
            seed = int(rng.integers(2**32))
            frames = recording(true_counts, array, array.flaws, rng, seed)
            untouched.append(recording(0 * true_counts, array, array.flaws, rng, seed + 1))
            largest.append(frames.max())
            held = frames[UNTOUCHED : UNTOUCHED + HELD]
            is_pressed = true_counts >= PRESSED_COUNTS
            level = held.mean(axis=0)[is_pressed]
            # Of differences of frames, as the levels rise a little while held.
            noise = np.diff(held[1:, is_pressed], axis=0).std(axis=0) / np.sqrt(2)
            pressed.append(np.stack([level, noise]))
            after = frames[UNTOUCHED + HELD :] - frames[:UNTOUCHED].mean(axis=0)
            released.append(100 * after[:, is_pressed] / level)
            noiseless = recording(true_counts, array, quiet, rng, seed)[:, is_pressed]
            first = UNTOUCHED
            rise = noiseless[first + _frames("800")] - noiseless[first]
            drifts.append(100 * rise / noiseless[first])
    level, noise = np.concatenate(pressed, axis=1)
    kept = np.concatenate(released, axis=1)
    at_rest = np.concatenate(untouched, axis=1)
    return {
        "untouched_zero_percent": float(100 * (at_rest == 0).mean()),  # of real ones 3 %
        "largest_counts": percentiles(np.array(largest), ("25", "50", "75")),
        "simulated": {
            "untouched_noise_counts": _like("untouched_noise_counts", at_rest.std(axis=0)),
            "untouched_offset_counts": _like("untouched_offset_counts", at_rest.mean(axis=0)),
            "pressed_noise_percent": _like("pressed_noise_percent", 100 * noise / level),
            "pressed_noise_counts": {
                "3000": float(np.median(noise[level < 4000])),
                "10000": float(np.median(noise[level >= 10000])),
            },
            "kept_percent": {
                key: float(np.median(kept[_frames(key) - 1])) for key in REAL["kept_percent"]
            },
            "kept_quartiles_percent": {
                f"{key} {name}": float(np.percentile(kept[_frames(key) - 1], at))
                for key in ("100", "1000")
                for name, at in (("low", 25), ("high", 75))
            },
            "drift_percent": {"800": float(np.median(np.concatenate(drifts)))},
        },
    }


def fingers(array: TaxelArray, rng: np.random.Generator) -> Iterator[np.ndarray]:
    """Noiseless counts of random fingers, (n,) each.

    A soft ball on a soft layer has the pressure of a larger rigid ball. Its radius is larger by the
    ratio of the moduli plus one (Hertz contact with equal Poisson's ratios, Johnson 1985).
    """
    softness = 1 + array.elastomer.young_mpa / FINGER_YOUNG_MPA
    for _ in range(FINGERS):
        radius_mm, (x_mm, y_mm) = rng.uniform(*RADII_MM), rng.uniform(-PLACE_MM, PLACE_MM, 2)
        force_n = np.exp(rng.uniform(*np.log(FORCES_N)))
        shape = ball(softness * radius_mm)
        command = PressCommand(shape.name, float(x_mm), float(y_mm), 0.0, float(force_n))
        yield np.rint(array.noiseless(array.press(shape, command), array.layout))


def recording(
    true_counts: np.ndarray,
    array: TaxelArray,
    flaws: Imperfections,
    rng: np.random.Generator,
    array_seed: int,
) -> np.ndarray:
    """The frames of a press of an array with these noiseless counts, held and released, (30, n)."""
    memory, frames, frame_s = None, [], 1.0 / array.spec.counts.rate_hz
    for frame in range(UNTOUCHED + HELD + RELEASED):
        is_held = UNTOUCHED <= frame < UNTOUCHED + HELD
        counts, memory = reading.read_after(
            memory,
            is_held * true_counts,
            array.layout,
            flaws,
            array.spec.counts,
            rng,
            array_seed,
            frame_s,
            1,
        )
        frames.append(counts.astype(float))
    return np.array(frames)


def without_noise(flaws: Imperfections) -> Imperfections:
    """The imperfections with the memory alone."""
    return structs.replace(flaws, noise_counts=(), offset_counts=(), load_noise_counts=0.0)


def percentiles(values: np.ndarray, at: Any) -> dict[str, float]:
    """The percentiles of these names."""
    return {key: float(np.percentile(values, float(key))) for key in at}


def _frames(milliseconds: str) -> int:
    """The number of frames in a time."""
    return round(1e-3 * float(milliseconds) * SensorPair().array.spec.counts.rate_hz)


def _like(name: str, values: np.ndarray) -> dict[str, float]:
    """The percentiles that REAL has of a figure."""
    return percentiles(values, REAL[name])


if __name__ == "__main__":
    main(BENCHMARK)
