"""Accuracy of the contact solver on difficult shapes.

    python -m benchmarks contact_cases [--cases N]

Presses CASES shapes of `contact_shapes` on the flat linear layers of `press`, about half of them on
each sensor. Force, position and yaw are sampled by the case's number. A force that pushes a shape
through the layer is halved.

The reference is the solver `oracle` on the exact shape, with cells of a quarter of the contact
solver's usual smallest pin. Its depth is extrapolated from two grids, whose difference bounds the
error. Where this bound exceeds MAX_BOUND, the depth is extrapolated from finer grids. References
are cached by the gaps, the force and the oracle's code, so that a repetition is faster.

The contact solver presses a height map of FINE_MAP_MM, whose effect is negligible: the errors in
`sensors` are those of the contact solver. `usual_map` contains the errors with a
height map of the pitch that shapes from files have. Its outlines are known to half a point only.
"""

from argparse import Namespace
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from scipy.interpolate import RectBivariateSpline
from tqdm import tqdm

from benchmarks.contact import oracle
from benchmarks.contact.contact_shapes import FAMILIES, Case, make_case
from benchmarks.contact.flat_pad import DEEPEST_MM, TOLERANCE, FlatPad
from benchmarks.contact.press import SENSORS, block_forces, distance
from benchmarks.evidence import Argument, Benchmark, Figure
from t2twin.core.cache_dir import cached_array
from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad.shape import Shape
from t2twin.primitives_cad.tilt import rotation_of
from t2twin.sim.contact.contact_solver import solve_contact
from t2twin.sim.contact.types import Contact, PressCommand
from t2twin.sim.taxels.layout import DEFAULT_LAYOUT, load_layout
from t2twin.sim.taxels.pads import pad_pressure_mpa

CASES = 200

BENCHMARK = Benchmark(
    module="benchmarks.contact.contact_cases",
    minutes=12,
    sources=("primitives_cad", "sim/contact", "sim/taxels"),
    figures=(
        Figure("sensors.*.within_percent", "%", least=95.0),
        Figure("sensors.*.beyond", most=0),
        Figure("sensors.*.worst.*"),
        Figure("usual_map.*.within_percent", "%"),
        Figure("usual_map.*.beyond"),
    ),
    arguments=(
        Argument("--cases", "press the first N only; keeps nothing", int, CASES, partial=True),
    ),
)

INNER = {"depth": 0.02, "surface": 0.05, "pressure": 0.05, "pad": 0.02}
OUTER = {"depth": 0.04, "surface": 0.09, "pressure": 0.1, "pad": 0.04}
"""Errors that 95 % of the cases may have, and that each may have. Surface and pressure: relative
L2. pad: largest error of a taxel pad, relative to the largest pad pressure."""

PITCHES_MM = (0.0625, 0.03125)
"""Cells of the reference, mm: a half and a quarter of the smallest pin."""

MAX_BOUND = 0.01
"""Relative bound of the error of a reference's depth, above which its cells are halved."""

FINEST_MM = 0.0156
"""Smallest cells of the reference, mm."""

FORCES_N = (0.5, 12.0)
"""Range of the sampled forces, N, log-uniform."""

FINE_MAP_MM = 0.0125
"""Pitch of a height map whose effect is negligible, mm."""

OFFSET_MM = 0.5
"""Largest offset of a press along x and y, mm."""

BETWEEN = np.linspace(-1.5, 1.5, 61)
"""Distances from the highest cell of a tilted case, in cells, at which its highest point is
searched."""

FORCE_SEED = 2
"""Distinguishes the generator of the presses from that of the shapes."""


@dataclass(frozen=True)
class Fields:
    """What is compared. surface_mm: on the contact's grid. forces_n: of blocks. pads_mpa: mean
    pressure of the taxel pads, empty on the DIGIT."""

    depth_mm: float
    surface_mm: np.ndarray
    forces_n: np.ndarray
    pads_mpa: np.ndarray

    def errors(self, expected: "Fields") -> dict[str, float]:
        """By the keys of INNER."""
        found = {
            "depth": abs(self.depth_mm / expected.depth_mm - 1),
            "surface": distance(self.surface_mm, expected.surface_mm),
            "pressure": distance(self.forces_n, expected.forces_n),
        }
        if expected.pads_mpa.size:
            off = np.abs(self.pads_mpa - expected.pads_mpa).max()
            found["pad"] = float(off / expected.pads_mpa.max())
        return found


def measure(options: Namespace) -> dict[str, Any]:
    rows = [measure_case(number) for number in tqdm(range(options.cases), unit="case")]
    by_sensor = {sensor: [row for row in rows if row["sensor"] == sensor] for sensor in SENSORS}
    return {
        "sensors": {name: summary(of, "errors") for name, of in by_sensor.items() if of},
        "usual_map": {
            name: summary(of, "usual_map_errors") for name, of in by_sensor.items() if of
        },
        "cases": rows,
    }


def summary(rows: Sequence[dict[str, Any]], key: str) -> dict[str, Any]:
    """Share within INNER, the number beyond OUTER, the medians and the worst.

    key: of the errors in a row.
    """
    kinds = list(rows[0][key])
    errors = np.array([[row[key][kind] for kind in kinds] for row in rows])
    inner = errors <= [INNER[kind] for kind in kinds]
    outer = errors <= [OUTER[kind] for kind in kinds]
    return {
        "presses": len(rows),
        "within_percent": 100.0 * float(inner.all(axis=1).mean()),
        "beyond": int((~outer.all(axis=1)).sum()),
        "median": dict(zip(kinds, np.median(errors, axis=0).tolist(), strict=True)),
        "worst": dict(zip(kinds, errors.max(axis=0).tolist(), strict=True)),
    }


def measure_case(number: int, tilt_deg: float = 0.0) -> dict[str, Any]:
    """Errors of one case with both height maps, and of its reference. tilt_deg: of the press."""
    case = make_case(number)
    sensor = tuple(SENSORS)[number // len(FAMILIES) % len(SENSORS)]
    shape, top_mm = case.shape(FINE_MAP_MM)
    contact = press(shape, sensor, sample_command(case, number, tilt_deg))
    command = contact.command
    usual = solve_contact(case.shape()[0], command, SENSORS[sensor].flat, SENSORS[sensor].pitch_mm)
    coarse, fine = references(case, top_mm, sensor, contact)
    depth_mm, bound = extrapolated(case, top_mm, sensor, command, [coarse.depth_mm, fine.depth_mm])
    expected = replace(fine, depth_mm=depth_mm)
    return {
        "name": case.name,
        "family": case.family,
        "sensor": sensor,
        "parameters": case.parameters,
        "force_n": command.force_n,
        "depth_mm": depth_mm,
        "settled": contact.settled and usual.settled,
        "errors": fields_of(contact, sensor).errors(expected),
        "usual_map_errors": fields_of(usual, sensor).errors(expected),
        "reference_errors": coarse.errors(fine) | {"depth": bound},
        "depth_over_reference": contact.depth_mm / depth_mm,
        "usual_map_depth_over_reference": usual.depth_mm / depth_mm,
    }


def sample_command(case: Case, number: int, tilt_deg: float = 0.0) -> PressCommand:
    rng = np.random.default_rng((number, case.seed, FORCE_SEED))
    x_mm, y_mm = rng.uniform(-OFFSET_MM, OFFSET_MM, 2).tolist()
    yaw_rad, log_force = rng.uniform(0.0, 2 * np.pi), rng.uniform(*np.log(FORCES_N))
    towards = rng.uniform(0.0, 2 * np.pi)
    tilt = np.radians(tilt_deg) * np.array((np.cos(towards), np.sin(towards)))
    force_n = float(np.exp(log_force))
    return PressCommand(case.name, x_mm, y_mm, float(yaw_rad), force_n, *tilt.tolist())


def press(shape: Shape, sensor: str, command: PressCommand) -> Contact:
    """The contact, with the largest halved force that does not push the shape through."""
    own = SENSORS[sensor]
    try:
        return solve_contact(shape, command, own.flat, own.pitch_mm)
    except T2TwinError:
        return press(shape, sensor, replace(command, force_n=command.force_n / 2))


def fields_of(contact: Contact, sensor: str) -> Fields:
    """Of a contact on a sensor's flat layer."""
    forces = block_forces(
        contact.x_mm, contact.y_mm, 1e-3 * contact.pressure_kpa, SENSORS[sensor].flat
    )
    pads = np.zeros(0)
    if sensor == "cyskin":
        pads = pad_pressure_mpa(contact, load_layout(DEFAULT_LAYOUT))
    return Fields(contact.depth_mm, contact.surface_mm, forces, pads)


def references(case: Case, top_mm: float, sensor: str, contact: Contact) -> list[Fields]:
    """Of the oracle, on both grids of PITCHES_MM. top_mm: of the exact shape."""
    found, pressure = [], None
    for pitch_mm in PITCHES_MM:
        pad = flat_pad(sensor, pitch_mm)
        gap_mm = gaps(pad, case, top_mm, contact.command)
        pressure = pad.pressure_mpa(gap_mm, contact.command.force_n, pressure)
        found.append(_fields_of_reference(pad, sensor, pad.answer(gap_mm, pressure), contact))
    return found


@cache
def flat_pad(sensor: str, pitch_mm: float) -> FlatPad:
    flat = SENSORS[sensor].flat
    return FlatPad(flat, flat.width_mm, flat.length_mm, pitch_mm)


def gaps(pad: FlatPad, case: Case, top_mm: float, command: PressCommand) -> np.ndarray:
    """Distance of the exact shape from the pad's cells at first touch, (rows, columns), mm."""
    x, y = np.meshgrid(pad.x_mm - command.x_mm, pad.y_mm - command.y_mm)
    cos, sin = np.cos(command.yaw_rad), np.sin(command.yaw_rad)
    places = cos * x + sin * y, sin * x - cos * y
    if command.tilt_rad == (0.0, 0.0):
        return np.minimum(top_mm - case.tilted_mm(*places), DEEPEST_MM)
    turn = rotation_of(*command.tilt_rad)
    heights = case.turned_mm(*places, top_mm, turn)
    # The highest point is a corner or an edge between the cells.
    at, (step_x, step_y) = heights.argmax(), np.meshgrid(BETWEEN, BETWEEN)
    around = places[0].flat[at] + pad.pitch_mm * step_x, places[1].flat[at] + pad.pitch_mm * step_y
    highest = case.turned_mm(*around, top_mm, turn).max()
    return np.minimum(highest - heights, DEEPEST_MM)


def extrapolated(
    case: Case, top_mm: float, sensor: str, command: PressCommand, depths_mm: list[float]
) -> tuple[float, float]:
    """Depth of a shape, mm, and the relative bound of its error. depths_mm: with PITCHES_MM."""
    pitch_mm, (coarse_mm, fine_mm) = PITCHES_MM[-1], depths_mm
    while True:
        depth_mm = 2 * fine_mm - coarse_mm
        bound = abs(fine_mm / depth_mm - 1)
        if bound <= MAX_BOUND or pitch_mm / 2 < FINEST_MM:
            return depth_mm, bound
        pitch_mm /= 2
        pad = flat_pad(sensor, pitch_mm)
        coarse_mm, fine_mm = fine_mm, depth_on(pad, gaps(pad, case, top_mm, command), command)


def depth_on(pad: FlatPad, gap_mm: np.ndarray, command: PressCommand) -> float:
    """Depth of the oracle with a kernel for the touchable cells only, mm."""
    gap_mm, layer = gap_mm[pad.touchable(gap_mm)], pad.elastomer

    def solve() -> np.ndarray:
        rows, columns = gap_mm.shape
        kernel = oracle.kernel(
            rows, columns, pad.pitch_mm, layer.thickness_mm, layer.young_mpa, layer.poisson
        )
        answer = oracle.solve(gap_mm, command.force_n, pad.pitch_mm, kernel, TOLERANCE)
        return np.array(answer.depth_mm)

    key = pad.key(gap_mm, command.force_n)
    return float(cached_array("reference-depths", key, oracle.__file__, solve))


def _fields_of_reference(
    pad: FlatPad, sensor: str, answer: oracle.Answer, contact: Contact
) -> Fields:
    surface = RectBivariateSpline(pad.y_mm, pad.x_mm, answer.deflection_mm)
    forces = block_forces(pad.x_mm, pad.y_mm, answer.pressure_mpa, pad.elastomer)
    pads = np.zeros(0)
    if sensor == "cyskin":
        pads = pad.pad_pressure_mpa(answer.pressure_mpa, load_layout(DEFAULT_LAYOUT))
    return Fields(answer.depth_mm, surface(contact.y_mm, contact.x_mm), forces, pads)
