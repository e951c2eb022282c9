"""Accuracy and speed of the contact solver, compared with the oracle.

    python -m benchmarks press [--shapes N]

Presses every primitive on a flat linear layer of each sensor's elastomer at four forces, turned so
that it is aligned with no grid. Depth, surface, pressure and the mean pressure of the taxel pads
are compared with the solver `oracle`, and the force is checked. The oracle has cells only where the
contact solver has its pad (`flat_pad`), so that both cut long shapes at the same place.
The oracle's depth is extrapolated from two grids, because the error at the edge of a punch is of
first order. Its fields are those of the finer grid.

The same is done with random shapes, the first of all seeds. Further figures need no oracle: a
halved grid, the twelve orientations on a wide layer, Hertz, exponents of depth and force, and the
time.
"""

from argparse import Namespace
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any
from unittest.mock import patch

import numpy as np
from scipy.interpolate import RectBivariateSpline
from tqdm import tqdm

from benchmarks.contact.flat_pad import FlatPad
from benchmarks.contact.solids import punch
from benchmarks.evidence import Argument, Benchmark, Figure
from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.random_shapes import random_shape
from t2twin.primitives_cad.shape import Shape, ball
from t2twin.sim.contact import pin_layout
from t2twin.sim.contact.contact_solver import solve_contact
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.types import Contact, PressCommand
from t2twin.sim.sampling import protocol
from t2twin.sim.sensors.pair import SensorPair
from t2twin.sim.taxels.pads import pad_pressure_mpa

BENCHMARK = Benchmark(
    module="benchmarks.contact.press",
    minutes=12,
    sources=("primitives_cad", "sim/contact", "sim/taxels", "sim/sampling"),
    figures=(
        Figure("sensors.*.worst.depth_error", most=0.013),
        Figure("sensors.*.worst.surface_error", most=0.04),
        Figure("sensors.*.worst.pressure_error", most=0.03),
        Figure("sensors.cyskin.worst.pad_error", most=0.008),
        Figure("sensors.*.worst.force_error", most=0.001),
        Figure("sensors.*.random.within_limits_percent", "%", least=90.0),
        Figure("sensors.*.random.worst.*"),
        Figure("sensors.*.worst.halved_grid"),
        Figure("sensors.*.worst.orientations"),
        Figure("sensors.*.protocol.unsettled", most=0),
        Figure("sensors.*.protocol.median_ms", "ms"),
        Figure("sensors.*.protocol.p95_ms", "ms"),
        Figure("hertz_worst.depth_error", most=0.05),
        Figure("hertz_worst.peak_pressure_error", most=0.05),
        Figure("exponents.ball"),
        Figure("exponents.punch"),
    ),
    arguments=(
        Argument("--shapes", "take every Nth primitive only; keeps nothing", int, 1, partial=True),
    ),
)

FORCES_N = (1.0, 2.0, 4.0, 8.0)
ORACLE_PITCHES_MM = (0.0625, 0.03125)
"""Coarse and fine cells of the oracle, mm: a half and a quarter of the smallest pin. With cells of
0.0625 mm the surface around a punch is up to 2.5 % off."""

YAW_RAD = 0.4
"""A turn that lines up with no grid."""

BLOCK_MM = 1.0
"""Resolution at which pressures are compared, mm."""

FLAT_WIDTH_MM = 18.0
"""Width of the DIGIT's flat layer, mm: the gel's 18.4 to whole cells of every grid here, so that
all of them cut a shape at the same place."""

WIDE_MM = 44.0
"""Side of the layer on which shapes are turned, mm: the longest line is 40 mm."""

HERTZ_RADIUS_MM, HERTZ_LAYER_MM, HERTZ_PITCH_MM = 6.0, 50.0, 0.1
HERTZ_FORCES_N = (0.1, 0.5)
EXPONENT_FORCES_N, EXPONENT_PITCH_MM = (0.1, 0.2, 0.4, 0.8), 0.2
PUNCH_RADIUS_MM = 3.0

HALVED = {
    "FINER": (*pin_layout.FINER, 2 * pin_layout.FINER[-1]),
    "MIN_PINS": 4 * pin_layout.MIN_PINS,
    "STAGES": tuple((pitch_mm / 2, tolerance) for pitch_mm, tolerance in pin_layout.STAGES),
}
"""The settings that halve the pins and the grid of the layer, for half the grid of the contact."""

RANDOM_SHAPES = 20
"""Seeds from 0 on."""

ROUNDS = 3
"""Rounds of the small protocol, of which each press's best time counts."""


@dataclass(frozen=True)
class Sensor:
    """own: the elastomer as it is. flat: linear and flat, stiff enough to hold at 8 N."""

    own: Elastomer
    flat: Elastomer
    pitch_mm: float


PAIR = SensorPair()
GEL, COVER = PAIR.camera.own_gel, PAIR.array.elastomer

SENSORS = {
    "digit": Sensor(
        GEL,
        replace(
            GEL,
            law="linear",
            width_mm=FLAT_WIDTH_MM,
            dome_width_radius_mm=np.inf,
            dome_length_radius_mm=np.inf,
            dome_flat_mm=0.0,
        ),
        PAIR.camera.pitch_mm,
    ),
    # 0.3 MPa is an effective modulus at the working strain.
    "cyskin": Sensor(COVER, replace(COVER, law="linear", young_mpa=0.3), PAIR.array.pitch_mm),
}

LIMITS = {
    "depth_error": 0.02,
    "surface_error": 0.05,
    "pressure_error": 0.05,
    "pad_error": 0.02,
    "force_error": 0.001,
}
"""Errors that a press of a random shape may have."""

ERRORS = (*LIMITS, "halved_grid")


def measure(options: Namespace) -> dict[str, Any]:
    with ProcessPoolExecutor(len(SENSORS)) as pool:
        every = [options.shapes] * len(SENSORS)
        found = pool.map(of_sensor, SENSORS, SENSORS.values(), every)
        sensors = dict(zip(SENSORS, found, strict=True))
    for name, sensor in SENSORS.items():  # times, with nothing beside
        sensors[name]["protocol"] = protocol_times(sensor)
    return {"sensors": sensors, **hertz(), "exponents": exponents()}


def of_sensor(name: str, sensor: Sensor, every: int) -> dict[str, Any]:
    """Figures of the primitives on one sensor's elastomer, and the worst of each. every: N, where
    every Nth primitive is taken."""
    pads = [
        FlatPad(sensor.flat, sensor.flat.width_mm, sensor.flat.length_mm, pitch)
        for pitch in ORACLE_PITCHES_MM
    ]
    shapes = {}
    for primitive in tqdm(catalogue.PRIMITIVES[::every], desc=name, unit="shape"):
        shape = catalogue.load(primitive)
        rows = [
            compare(shape, sensor, pads, force) | halved(shape, sensor, force) for force in FORCES_N
        ]
        shapes[primitive] = {"forces": rows, "orientations": orientations(shape, sensor)}
    rows = [row for shape in shapes.values() for row in shape["forces"]]
    turned = {"orientations": max(shape["orientations"] for shape in shapes.values())}
    return {
        "worst": _worst(rows) | turned,
        "shapes": shapes,
        "random": of_random_shapes(name, sensor, pads, every),
    }


def of_random_shapes(name: str, sensor: Sensor, pads: list[FlatPad], every: int) -> dict[str, Any]:
    """The same errors of random shapes, and how many presses are within LIMITS. A force that pushes
    a shape through the linear layer is left out."""
    shapes: dict[str, list[dict[str, float]]] = {}
    for seed in tqdm(range(0, RANDOM_SHAPES, every), desc=f"{name}, random", unit="shape"):
        shape = random_shape(seed)
        shapes[shape.name] = []
        for force in FORCES_N:
            with suppress(T2TwinError):
                shapes[shape.name].append(compare(shape, sensor, pads, force))
    rows = [row for of_shape in shapes.values() for row in of_shape]
    within = [
        all(abs(row[key]) <= most for key, most in LIMITS.items() if key in row) for row in rows
    ]
    return {
        "presses": len(rows),
        "pushed_through": len(shapes) * len(FORCES_N) - len(rows),
        "worst": _worst(rows),
        "median": {key: float(np.median([abs(row[key]) for row in rows])) for key in _worst(rows)},
        "within_limits_percent": 100.0 * float(np.mean(within)),
        "shapes": shapes,
    }


def _worst(rows: list[dict[str, float]]) -> dict[str, float]:
    """The largest of each error, its sign left out."""
    return {key: max(abs(row[key]) for row in rows) for key in ERRORS if key in rows[0]}


def compare(shape: Shape, sensor: Sensor, pads: list[FlatPad], force_n: float) -> dict[str, float]:
    """Figures of one press on one flat layer. pads: the oracle's coarse and fine one."""
    command = PressCommand(shape.name, 0.0, 0.0, YAW_RAD, force_n)
    contact = solve_contact(shape, command, sensor.flat, sensor.pitch_mm)
    coarse = pads[0].press(shape, command)
    fine = pads[1].press(shape, command, coarse)
    depth_mm = 2 * fine.depth_mm - coarse.depth_mm
    row = {
        "force_n": force_n,
        "depth_mm": contact.depth_mm,
        "depth_error": contact.depth_mm / depth_mm - 1,
        "oracle_grid_error": fine.depth_mm / depth_mm - 1,
        "surface_error": _surface_error(contact, pads[-1], fine.deflection_mm),
        "pressure_error": _pressure_error(contact, pads[-1], fine.pressure_mpa),
        "force_error": contact.force_n / force_n - 1,
    }
    if sensor.own == COVER:
        layout = PAIR.array.layout
        expected = pads[-1].pad_pressure_mpa(fine.pressure_mpa, layout)
        off = np.abs(pad_pressure_mpa(contact, layout) - expected).max()
        row["pad_error"] = float(off / expected.max())
    return row


def halved(shape: Shape, sensor: Sensor, force_n: float) -> dict[str, float]:
    """How a depth changes when all grids are halved."""
    command = PressCommand(shape.name, 0.0, 0.0, YAW_RAD, force_n)
    contact = solve_contact(shape, command, sensor.flat, sensor.pitch_mm)
    with patch.multiple(pin_layout, **HALVED):
        finer = solve_contact(shape, command, sensor.flat, sensor.pitch_mm / 2)
    return {"halved_grid": finer.depth_mm / contact.depth_mm - 1}


def _surface_error(contact: Contact, pad: FlatPad, deflection_mm: np.ndarray) -> float:
    expected = RectBivariateSpline(pad.y_mm, pad.x_mm, deflection_mm)(contact.y_mm, contact.x_mm)
    return distance(contact.surface_mm, expected)


def _pressure_error(contact: Contact, pad: FlatPad, pressure_mpa: np.ndarray) -> float:
    given = block_forces(contact.x_mm, contact.y_mm, 1e-3 * contact.pressure_kpa, pad.elastomer)
    return distance(given, block_forces(pad.x_mm, pad.y_mm, pressure_mpa, pad.elastomer))


def block_forces(
    x_mm: np.ndarray, y_mm: np.ndarray, pressure_mpa: np.ndarray, layer: Elastomer
) -> np.ndarray:
    """Forces, N, of a pressure on a grid's cells on blocks of BLOCK_MM that cover a layer."""
    edges = [_block_edges(length) for length in (layer.length_mm, layer.width_mm)]
    x, y = np.meshgrid(x_mm, y_mm)
    force = pressure_mpa * (x_mm[1] - x_mm[0]) ** 2
    return np.histogram2d(y.ravel(), x.ravel(), edges, weights=force.ravel())[0]


def _block_edges(length_mm: float) -> np.ndarray:
    """Edges of the blocks that cover a length about zero, mm."""
    reach = np.ceil(length_mm / 2 / BLOCK_MM)
    return BLOCK_MM * np.arange(-reach, reach + 1)


def distance(given: np.ndarray, expected: np.ndarray) -> float:
    """Relative L2 distance of two arrays of equal shape."""
    return float(np.linalg.norm(given - expected) / np.linalg.norm(expected))


def orientations(shape: Shape, sensor: Sensor) -> float:
    """Greatest departure of a depth from the mean over the protocol's orientations."""
    wide = replace(sensor.flat, width_mm=WIDE_MM, length_mm=WIDE_MM)
    depths = [
        solve_contact(
            shape, PressCommand(shape.name, 0.0, 0.0, yaw, 8.0), wide, sensor.pitch_mm
        ).depth_mm
        for yaw in np.linspace(0, protocol.LAST_YAW_RAD, protocol.PRIMITIVE_GRID[1])
    ]
    return float(np.abs(np.array(depths) / np.mean(depths) - 1).max())


def thick_layer() -> Elastomer:
    """A layer so thick that it is a half-space to a small contact."""
    own = GEL
    return Elastomer("thick", HERTZ_LAYER_MM, own.young_mpa, own.poisson, 18.0, 18.0, law="linear")


def hertz() -> dict[str, Any]:
    """A ball on a thick layer against Hertz, by force, and the worst."""
    thick = thick_layer()
    modulus = thick.young_mpa / (1 - thick.poisson**2)
    rows = []
    for force in HERTZ_FORCES_N:
        command = PressCommand("ball", 0.0, 0.0, 0.0, force)
        contact = solve_contact(ball(HERTZ_RADIUS_MM), command, thick, HERTZ_PITCH_MM)
        radius = (3 * force * HERTZ_RADIUS_MM / (4 * modulus)) ** (1 / 3)
        peak_kpa = 1e3 * 1.5 * force / (np.pi * radius**2)
        rows.append(
            {
                "force_n": force,
                "depth_error": contact.depth_mm / (radius**2 / HERTZ_RADIUS_MM) - 1,
                "peak_pressure_error": float(contact.pressure_kpa.max()) / peak_kpa - 1,
            }
        )
    keys = ("depth_error", "peak_pressure_error")
    return {"hertz": rows, "hertz_worst": {k: max(abs(row[k]) for row in rows) for k in keys}}


def exponents() -> dict[str, float]:
    """The powers of the force that depth on a thick layer grows with."""
    powers = {}
    for name, shape in (("ball", ball(HERTZ_RADIUS_MM)), ("punch", punch(PUNCH_RADIUS_MM))):
        commands = [PressCommand(name, 0.0, 0.0, 0.0, force) for force in EXPONENT_FORCES_N]
        depths = [
            solve_contact(shape, command, thick_layer(), EXPONENT_PITCH_MM).depth_mm
            for command in commands
        ]
        powers[name] = float(np.polyfit(np.log(EXPONENT_FORCES_N), np.log(depths), 1)[0])
    return powers


def protocol_times(sensor: Sensor) -> dict[str, float]:
    """Time of a press over the smoke protocol, ms: each press's best of ROUNDS."""
    commands = [
        (catalogue.load(name), index)
        for name in catalogue.NAMES
        for index in protocol.indices(name, protocol.SCALES["smoke"])
    ]
    best = np.full(len(commands), np.inf)
    unsettled = 0
    for _ in range(ROUNDS):
        for row, (shape, index) in enumerate(commands):
            command = protocol.press_of(shape.name, shape.spacing_mm, index)
            contact = solve_contact(shape, command, sensor.own, sensor.pitch_mm)
            best[row] = min(best[row], contact.milliseconds)
            unsettled += not contact.settled
    return {
        "presses": len(commands),
        "unsettled": unsettled,
        "median_ms": float(np.median(best)),
        "p95_ms": float(np.percentile(best, 95)),
    }
