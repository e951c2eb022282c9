"""Counts of a fingertip that slides over grooves, recorded and simulated.

    python -m benchmarks grooves BOARDS

BOARDS is the folder data/board of the repository wngfra/FabricSlide (Wang et al., Frontiers in
Neurorobotics 2022), which is not part of the project. It has slides of a capacitive fingertip at
5 to 30 mm/s over two boards, whose grooves are as wide as the ridges. The depth of the grooves, the
forces, the finger's layers and the places of its taxels are not published.

The twin makes the same motion with `fingertip.toml`, at a constant force, or at the height of this
force on a ridge. The counts over one period are repeated and read at the recordings' rate. Both are
evaluated alike: a constant, a trend and harmonics of the period are fitted to each taxel's counts.
"""

import re
from argparse import Namespace
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import structs

from benchmarks.contact.solids import formula
from benchmarks.evidence import Argument, Benchmark, Figure
from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad.shape import Shape
from t2twin.sim.contact.contact_solver import force_at_depth
from t2twin.sim.contact.sliding import advance
from t2twin.sim.contact.types import PressCommand
from t2twin.sim.sensors.files import load_sensor
from t2twin.sim.taxels.reading import read_after
from t2twin.sim.taxels.taxel_array import TaxelArray

BENCHMARK = Benchmark(
    module="benchmarks.motion.grooves",
    minutes=1,
    sources=("sim/contact", "sim/taxels"),
    figures=(Figure("*.blur"), Figure("*.wide.amplitude"), Figure("*.narrow.amplitude")),
    arguments=(Argument("boards", "folder data/board of wngfra/FabricSlide", Path),),
)

PERIODS_MM = {"wide": 20.0, "narrow": 4.0}
NEAR, HARMONICS = np.linspace(0.98, 1.02, 41), 3  # periods that are tried, as shares
SPEEDS_MM_S, LENGTH_MM = (5.0, 10.0, 20.0, 30.0), 151.0
FORCE_N, GROOVE_MM, FLANK_MM = 6.0, 1.0, 0.1  # depth of the grooves, width of their walls (assumed)
STEP_MM, LEAD_MM = 0.4, 4.0  # of the slide, and its length before the evaluated period
THICK_MM, SHALLOW_MM = 3.5, 0.3  # cover and depth of grooves, fitted to the recordings


@dataclass(frozen=True)
class Slide:
    """One slide. way_mm: (n,). ahead: (n,) a signal that no taxel delays. counts: (n, taxels)."""

    speed_mm_s: float
    way_mm: np.ndarray
    ahead: np.ndarray
    counts: np.ndarray

    def figures(self, period_mm: float) -> dict[str, float]:
        """Of the period that fits best, medians over the taxels."""
        signals = np.column_stack([self.ahead, self.counts])
        best = min(period_mm * NEAR, key=lambda period: self._fitted(signals, period)[1])
        fit, _ = self._fitted(signals, best)
        waves, mean = fit[2::2] - 1j * fit[3::2], self.counts.mean(axis=0)
        sizes, whole = np.abs(waves[:, 1:]), waves[0, 1:].sum()
        percent = 50 * sizes**2 / self.counts.var(axis=0)
        found = {
            "amplitude": sizes[0] / mean,
            "together": abs(whole) / sizes[0].sum(),
            "period_percent": percent[0],
            "harmonics_percent": percent[1:].sum(axis=0),
            "drift_percent": 100 * LENGTH_MM * np.abs(fit[1, 1:]) / mean,
            "noise_counts": np.diff(self.counts, 2, axis=0).std(axis=0) / np.sqrt(6),
            "behind_mm": -np.angle(whole / waves[0, 0]) * best / (2 * np.pi),
        }
        return {name: float(np.median(each)) for name, each in found.items()}

    def _fitted(self, signals: np.ndarray, period_mm: float) -> tuple[np.ndarray, float]:
        """Constant, trend, and cosine and sine of each harmonic; the counts' squared residual."""
        phases = 2 * np.pi / period_mm * self.way_mm * np.arange(1, HARMONICS + 1)[:, None]
        waves = np.stack([np.cos(phases), np.sin(phases)], axis=1).reshape(2 * HARMONICS, -1)
        terms = np.stack([np.ones(self.way_mm.size), self.way_mm, *waves], axis=1)
        fit = np.linalg.lstsq(terms, signals)[0]
        return fit, float(np.square((signals - terms @ fit)[:, 1:]).sum())


def measure(options: Namespace) -> dict[str, Any]:
    finger = load_sensor(Path(__file__).with_name("fingertip.toml"))
    assert isinstance(finger, TaxelArray)
    finger = finger.for_dataset()
    cover = structs.replace(finger.spec.cover, thickness_mm=THICK_MM)
    thick = replace(finger, spec=structs.replace(finger.spec, cover=cover))
    slides = {
        "recorded": partial(recorded, options.boards),
        "force": partial(simulated, finger, is_held=False),
        "height": partial(simulated, finger, is_held=True),
        "fitted": partial(simulated, thick, is_held=True, groove_mm=SHALLOW_MM),
    }
    content = {}
    for name, of in slides.items():
        boards = {board: summary(of(period), period) for board, period in PERIODS_MM.items()}
        wide, narrow = (each["amplitude"] for each in boards.values())
        content[name] = boards | {"blur": wide / narrow}
    return content


def recorded(folder: Path, period_mm: float) -> list[Slide]:
    """The recorded slides; `ahead` is the second proximity sensor, among the taxels."""
    found = []
    for path in sorted(folder.glob("Board*mm_F*_V*mmps_*.csv")):
        width_mm, _, speed_mm_s, _ = map(float, re.findall(r"\d+", path.stem))
        if 2 * width_mm == period_mm:
            rows = np.loadtxt(path, delimiter=",", skiprows=1)
            way_mm = 1e-3 * speed_mm_s * (rows[:, 0] - rows[0, 0])
            found.append(Slide(speed_mm_s, way_mm, rows[:, 2], rows[:, 3:]))
    if not found:
        raise T2TwinError(
            f"{folder} has no Board{period_mm / 2:g}mm_*.csv; expected the folder data/board of "
            "wngfra/FabricSlide, which is not part of the project"
        )
    return found


def simulated(
    array: TaxelArray, period_mm: float, is_held: bool, groove_mm: float = GROOVE_MM
) -> list[Slide]:
    """The twin's slides; `ahead` is the mean of the noiseless counts."""
    shape = board(period_mm, groove_mm, LEAD_MM + period_mm + array.elastomer.width_mm)
    levels, rng = levels_over(array, shape, period_mm, is_held), np.random.default_rng(0)
    table, found = array.spec.counts, []
    for speed_mm_s in SPEEDS_MM_S:
        way_mm = np.arange(0.0, LENGTH_MM, speed_mm_s / (table.rate_hz or 1.0))
        places = STEP_MM * np.arange(len(levels))
        true = np.transpose(
            [np.interp(way_mm, places, each, period=period_mm) for each in levels.T]
        )
        counts, memory = np.empty_like(true), None
        for row, level in enumerate(true):
            counts[row], memory = read_after(memory, level, array.layout, array.flaws, table, rng)
        found.append(Slide(speed_mm_s, way_mm, true.mean(axis=1), counts))
    return found


def levels_over(array: TaxelArray, shape: Shape, period_mm: float, is_held: bool) -> np.ndarray:
    """(n, taxels) noiseless counts along one period, STEP_MM apart, after LEAD_MM. is_held: at the
    height of the first press, on a ridge, instead of at its force."""
    cover, levels = array.elastomer, []
    start = PressCommand(shape.name, 0.0, 0.0, 0.0, FORCE_N)
    first = contact = array.press(shape, start)
    axis = np.linspace(-cover.width_mm / 2, cover.width_mm / 2, 721)
    rest_mm = cover.rest_surface_mm(axis, 0 * axis)
    for x_mm in np.arange(STEP_MM, LEAD_MM + period_mm + STEP_MM / 2, STEP_MM):
        force_n = FORCE_N
        if is_held:
            met_mm = float((rest_mm + shape.surface.sample(axis - x_mm, 0 * axis)).max())
            there = replace(start, x_mm=float(x_mm))
            force_n = force_at_depth(partial(array.press, shape), there, first.depth_mm + met_mm)
        contact = advance(contact, STEP_MM, 0.0, 0.0, force_n, array.friction)
        levels.append(array.noiseless(contact, array.layout))
    return np.array(levels[-round(period_mm / STEP_MM) :])


def board(period_mm: float, groove_mm: float, reach_mm: float) -> Shape:
    """Grooves along y, half a period wide; a ridge is in the middle."""

    def heights(x: np.ndarray, _: np.ndarray) -> np.ndarray:
        off_mm = period_mm * np.abs((x / period_mm + 0.5) % 1 - 0.5)
        return -groove_mm * np.clip((off_mm - period_mm / 4) / FLANK_MM + 0.5, 0.0, 1.0)

    return formula(heights, f"grooves of {period_mm / 2:g} mm", reach_mm=reach_mm)


def summary(slides: list[Slide], period_mm: float) -> dict[str, float]:
    """Medians over slides. The noise is that of the slowest, where the signal changes least. The
    ratio of speeds is that of amplitudes. The lag follows from the way behind at all speeds."""
    rows = [slide.figures(period_mm) for slide in slides]
    speeds = np.array([slide.speed_mm_s for slide in slides])
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    sizes, slow, fast = columns["amplitude"], speeds == speeds.min(), speeds == speeds.max()
    found = {name: float(np.median(each)) for name, each in columns.items()}
    return found | {
        "mean_counts": float(np.mean([slide.counts.mean() for slide in slides])),
        "noise_counts": float(np.median(columns["noise_counts"][slow])),
        "fast_over_slow": float(np.median(sizes[fast]) / np.median(sizes[slow])),
        "lag_ms": float(1e3 * np.polyfit(speeds, columns["behind_mm"], 1)[0]),
    }
