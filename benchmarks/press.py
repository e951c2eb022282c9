"""Fidelity and speed of the press, against the oracle: `python -m benchmarks.press`.

Every primitive on a flat layer of each sensor's elastomer, linear, at four forces, turned so that
it lines up with no grid: depth, surface, pressure and taxel pads' mean pressure against
`benchmarks.oracle`, and the force carried. The oracle's depth is extrapolated from two grids, for
a punch's edge is of first order; its fields are the finer grid's. Then what needs no oracle: the
grid halved, the twelve orientations, Hertz, exponents of depth with force, and the time.
`--shapes N` takes every Nth primitive only, and keeps nothing.
"""

import argparse
import json
import os
from dataclasses import dataclass, replace
from pathlib import Path
from unittest.mock import patch

import numpy as np
from scipy.interpolate import RectBivariateSpline
from scipy.special import j1
from tqdm import tqdm

from benchmarks.oracle import Answer, Waves, kernel, solve
from benchmarks.solids import ball, punch
from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.shape import Shape
from t2twin.sim.cyskin.layout import DEFAULT_LAYOUT, load_layout
from t2twin.sim.cyskin.taxels import pad_pressure_mpa
from t2twin.sim.dataset import protocol
from t2twin.sim.press import engine
from t2twin.sim.press.elastomer import CYSKIN_COVER, DIGIT_GEL, Elastomer
from t2twin.sim.press.engine import CYSKIN_PITCH_MM, DIGIT_PITCH_MM, press
from t2twin.sim.press.records import Contact, PressCommand

FORCES_N = (1.0, 2.0, 4.0, 8.0)
ORACLE_PITCHES_MM = (0.125, 0.0625)
YAW_RAD = 0.4
"""A turn that lines up with no grid."""

REACH_MM = 9.0
"""Half the oracle's square, mm: wider than every primitive."""

BLOCK_MM = 1.0
"""Resolution at which pressures are compared, mm."""

PAD_REACH_MM = 24.0
"""Half the square on which the oracle's base stress is spread, mm."""

HERTZ_RADIUS_MM, HERTZ_LAYER_MM, HERTZ_PITCH_MM = 6.0, 50.0, 0.1
HERTZ_FORCES_N = (0.1, 0.5)
EXPONENT_FORCES_N, EXPONENT_PITCH_MM = (0.1, 0.2, 0.4, 0.8), 0.2
PUNCH_RADIUS_MM = 3.0

HALVED = {
    "FINER": (*engine.FINER, 2 * engine.FINER[-1]),
    "FEWEST_PINS": 4 * engine.FEWEST_PINS,
    "STAGES": tuple((pitch / 2, at_rest) for pitch, at_rest in engine.STAGES),
}
"""The engine's choices that halve its pins and its layer's grid, with half the contact's grid."""

RESULTS = Path("benchmarks/results/press.json")


@dataclass(frozen=True)
class Sensor:
    """own: the elastomer as it is. flat: linear and flat, stiff enough to hold at 8 N."""

    own: Elastomer
    flat: Elastomer
    pitch_mm: float


SENSORS = {
    "digit": Sensor(
        DIGIT_GEL,
        replace(DIGIT_GEL, law="linear", dome_width_radius_mm=np.inf, dome_length_radius_mm=np.inf),
        DIGIT_PITCH_MM,
    ),
    # 0.3 MPa is an effective modulus at the working strain.
    "cyskin": Sensor(
        CYSKIN_COVER, replace(CYSKIN_COVER, law="linear", young_mpa=0.3), CYSKIN_PITCH_MM
    ),
}


class Oracle:
    """The oracle's answers on one flat layer."""

    def __init__(self, elastomer: Elastomer) -> None:
        self.elastomer = elastomer
        self.cells = {pitch: round(2 * REACH_MM / pitch) for pitch in ORACLE_PITCHES_MM}
        self.kernels = {
            pitch: kernel(
                cells, cells, pitch,
                elastomer.thickness_mm, elastomer.young_mpa, elastomer.poisson,
            )
            for pitch, cells in self.cells.items()
        }  # fmt: skip
        self.waves = Waves(elastomer.thickness_mm, elastomer.young_mpa, elastomer.poisson)

    def axis_mm(self, pitch: float) -> np.ndarray:
        cells = self.cells[pitch]
        return (np.arange(cells) - (cells - 1) / 2) * pitch

    def answer(self, shape: Shape, command: PressCommand, pitch: float) -> Answer:
        x, y = np.meshgrid(self.axis_mm(pitch), self.axis_mm(pitch))
        cos, sin = np.cos(command.yaw_rad), np.sin(command.yaw_rad)
        heights = shape.surface.sample(cos * x + sin * y, sin * x - cos * y)
        gap = heights.max() - np.maximum(heights, heights.max() - 10.0)
        return solve(gap, command.force_n, pitch, self.kernels[pitch], tolerance=1e-4)

    def pad_pressure_mpa(self, pressure_mpa: np.ndarray, pitch: float) -> np.ndarray:
        """Mean base stress on each pad of the default layout, from a pressure on the grid."""
        layout = load_layout(DEFAULT_LAYOUT)
        cells = round(2 * PAD_REACH_MM / pitch)
        wide = np.zeros((cells, cells))
        first = (cells - len(pressure_mpa)) // 2
        wide[first : first + len(pressure_mpa), first : first + len(pressure_mpa)] = pressure_mpa
        base = 2 * np.pi * np.fft.fftfreq(cells, pitch)
        k = np.hypot(base[None, :], base[:, None])
        radius = float(layout.pad_diameter_mm[0]) / 2
        reach = np.maximum(k * radius, 1e-9)
        disc = 2 * j1(reach) / reach
        means = np.fft.ifft2(np.fft.fft2(wide) * self.waves.base_stress(k) * disc).real
        axis = (np.arange(cells) - (cells - 1) / 2) * pitch
        spline = RectBivariateSpline(axis, axis, means)
        return spline(layout.y_mm, layout.x_mm, grid=False)


def compare(shape: Shape, sensor: Sensor, oracle: Oracle) -> list[dict]:
    """Rows of figures of one shape on one flat layer, one a force."""
    rows = []
    for force in FORCES_N:
        command = PressCommand(shape.name, 0.0, 0.0, YAW_RAD, force)
        contact = press(shape, command, sensor.flat, sensor.pitch_mm)
        with patch.multiple(engine, **HALVED):
            halved = press(shape, command, sensor.flat, sensor.pitch_mm / 2)
        coarse, fine = (oracle.answer(shape, command, pitch) for pitch in ORACLE_PITCHES_MM)
        pitch = ORACLE_PITCHES_MM[-1]
        axis = oracle.axis_mm(pitch)
        row = {
            "force_n": force,
            "depth_mm": contact.depth_mm,
            "depth_error": contact.depth_mm / (2 * fine.depth_mm - coarse.depth_mm) - 1,
            "oracle_grid_error": fine.depth_mm / (2 * fine.depth_mm - coarse.depth_mm) - 1,
            "surface_error": _surface_error(contact, axis, fine.deflection_mm),
            "pressure_error": _pressure_error(contact, axis, fine.pressure_mpa),
            "force_error": contact.force_n / force - 1,
            "halved_grid": halved.depth_mm / contact.depth_mm - 1,
        }
        if sensor.own is CYSKIN_COVER:
            truth = oracle.pad_pressure_mpa(fine.pressure_mpa, pitch)
            found = pad_pressure_mpa(contact, load_layout(DEFAULT_LAYOUT), sensor.flat)
            row["pad_error"] = float(np.abs(found - truth).max() / truth.max())
        rows.append(row)
    return rows


def _surface_error(contact: Contact, axis: np.ndarray, truth: np.ndarray) -> float:
    inside_x = contact.x_mm[np.abs(contact.x_mm) < REACH_MM - 0.5]
    inside_y = contact.y_mm[np.abs(contact.y_mm) < REACH_MM - 0.5]
    expected = RectBivariateSpline(axis, axis, truth)(inside_y, inside_x)
    rows, columns = np.isin(contact.y_mm, inside_y), np.isin(contact.x_mm, inside_x)
    found = contact.surface_mm[np.ix_(rows, columns)]
    return float(np.linalg.norm(found - expected) / np.linalg.norm(expected))


def _pressure_error(contact: Contact, axis: np.ndarray, truth: np.ndarray) -> float:
    edges = np.arange(-REACH_MM, REACH_MM + BLOCK_MM / 2, BLOCK_MM)

    def blocks(x: np.ndarray, y: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        grid_x, grid_y = np.meshgrid(x, y)
        force = pressure * (x[1] - x[0]) ** 2
        return np.histogram2d(
            grid_y.ravel(), grid_x.ravel(), (edges, edges), weights=force.ravel()
        )[0]

    found = blocks(contact.x_mm, contact.y_mm, 1e-3 * contact.pressure_kpa)
    expected = blocks(axis, axis, truth)
    return float(np.linalg.norm(found - expected) / np.linalg.norm(expected))


def orientations(shape: Shape, sensor: Sensor) -> float:
    """Greatest departure of a depth from the mean over the protocol's orientations."""
    depths = [
        press(
            shape, PressCommand(shape.name, 0.0, 0.0, yaw, 8.0), sensor.flat, sensor.pitch_mm
        ).depth_mm
        for yaw in np.linspace(0, protocol.LAST_YAW_RAD, protocol.PRIMITIVE_GRID.orientations)
    ]
    return float(np.abs(np.array(depths) / np.mean(depths) - 1).max())


def hertz() -> dict:
    """A ball on a thick layer against Hertz, and how depth grows with force."""
    thick = Elastomer(
        "thick", HERTZ_LAYER_MM, DIGIT_GEL.young_mpa, DIGIT_GEL.poisson, 18.0, 18.0, law="linear"
    )
    modulus = thick.young_mpa / (1 - thick.poisson**2)
    rows = []
    for force in HERTZ_FORCES_N:
        contact = press(
            ball(HERTZ_RADIUS_MM), PressCommand("ball", 0.0, 0.0, 0.0, force), thick, HERTZ_PITCH_MM
        )
        radius = (3 * force * HERTZ_RADIUS_MM / (4 * modulus)) ** (1 / 3)
        peak = 1e3 * 1.5 * force / (np.pi * radius**2)
        rows.append(
            {
                "force_n": force,
                "depth_error": contact.depth_mm / (radius**2 / HERTZ_RADIUS_MM) - 1,
                "peak_pressure_error": float(contact.pressure_kpa.max()) / peak - 1,
            }
        )
    exponents = {}
    for name, shape in (("ball", ball(HERTZ_RADIUS_MM)), ("punch", punch(PUNCH_RADIUS_MM))):
        depths = [
            press(
                shape, PressCommand(name, 0.0, 0.0, 0.0, force), thick, EXPONENT_PITCH_MM
            ).depth_mm
            for force in EXPONENT_FORCES_N
        ]
        exponents[name] = float(np.polyfit(np.log(EXPONENT_FORCES_N), np.log(depths), 1)[0])
    return {"hertz": rows, "exponents": exponents}


def protocol_times(sensor: Sensor, rounds: int = 3) -> dict:
    """Time of a press over the small protocol, ms: each press's best of a few rounds."""
    commands = [
        (catalogue.load(name), index)
        for name in catalogue.NAMES
        for index in protocol.indices(name, protocol.SCALES["smoke"])
    ]
    best = np.full(len(commands), np.inf)
    unsettled = 0
    for _ in range(rounds):
        for row, (shape, index) in enumerate(commands):
            contact = press(shape, protocol.press_at(shape, index), sensor.own, sensor.pitch_mm)
            best[row] = min(best[row], contact.milliseconds)
            unsettled += not contact.settled
    return {
        "presses": len(commands),
        "unsettled": unsettled,
        "median_ms": float(np.median(best)),
        "p95_ms": float(np.percentile(best, 95)),
    }


ERRORS = (
    "depth_error", "surface_error", "pressure_error", "pad_error", "force_error", "halved_grid",
)  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--shapes", type=int, default=1, help="take every Nth primitive")
    every = parser.parse_args().shapes
    found: dict = {"command": "python -m benchmarks.press", "cores": os.cpu_count()}
    found["sensors"] = {}
    for name, sensor in SENSORS.items():
        oracle = Oracle(sensor.flat)
        shapes = {}
        for primitive in tqdm(catalogue.PRIMITIVES[::every], desc=name, unit="shape"):
            shape = catalogue.load(primitive)
            shapes[primitive] = {
                "forces": compare(shape, sensor, oracle),
                "orientations": orientations(shape, sensor),
            }
        rows = [row for shape in shapes.values() for row in shape["forces"]]
        found["sensors"][name] = {
            "worst": {key: max(abs(row[key]) for row in rows) for key in ERRORS if key in rows[0]}
            | {"orientations": max(shape["orientations"] for shape in shapes.values())},
            "protocol": protocol_times(sensor),
            "shapes": shapes,
        }
        keys = [key for key in ERRORS if key in rows[0]]
        print(f"{name:7} {'worst of 1 to 8 N':16}" + "".join(f"{key:>15}" for key in keys))
        for primitive, shape in shapes.items():
            worst = [max(abs(row[key]) for row in shape["forces"]) for key in keys]
            print(f"{name:7} {primitive:17}" + "".join(f"{error:15.2%}" for error in worst))
        print(json.dumps({k: v for k, v in found["sensors"][name].items() if k != "shapes"}))
    found |= hertz()
    print(json.dumps({key: found[key] for key in ("hertz", "exponents")}))
    if every == 1:
        RESULTS.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
