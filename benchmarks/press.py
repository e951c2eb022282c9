"""Fidelity and speed of the press, against the oracle: `python -m benchmarks.press`.

Every primitive on a flat layer of each sensor's elastomer, linear, at four forces: depth, surface
and pressure errors against `benchmarks.oracle`, the force carried, and the time. The oracle's depth
is extrapolated from two grids; its fields are the finer grid's.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
from tqdm import tqdm

from benchmarks.oracle import kernel, solve
from primitives_cad import catalogue
from primitives_cad.shape import Shape
from sim import protocol
from sim.press.elastomer import CYSKIN_COVER, DIGIT_GEL, Elastomer
from sim.press.engine import CYSKIN_PITCH_MM, DIGIT_PITCH_MM, press
from sim.records import Contact, Press

FORCES_N = (1.0, 2.0, 4.0, 8.0)
ORACLE_PITCHES_MM = (0.25, 0.125)
YAW_RAD = 0.4
"""A turn that lines up with no grid."""

REACH_MM = 9.0
"""Half the oracle's square, mm: wider than every primitive."""

BLOCK_MM = 1.0
"""Resolution at which pressures are compared, mm."""

BAR_KPA = 1e3

SENSORS = {
    # Effective moduli at the working strain, so that a linear layer holds at 8 N.
    "digit": (replace(DIGIT_GEL, law="linear", dome_width_radius_mm=np.inf,
                      dome_length_radius_mm=np.inf), DIGIT_PITCH_MM),
    "cyskin": (replace(CYSKIN_COVER, law="linear", young_mpa=0.3), CYSKIN_PITCH_MM),
}  # fmt: skip


def compare(shape: Shape, elastomer: Elastomer, pitch_mm: float, kernels: dict) -> list[dict]:
    """Rows of figures of one shape on one layer, one a force."""
    rows = []
    for force in FORCES_N:
        command = Press(shape.name, 0.0, 0.0, YAW_RAD, force)
        press(shape, command, elastomer, pitch_mm)
        contact = press(shape, command, elastomer, pitch_mm)
        answers = [_oracle(shape, command, pitch, kernels) for pitch in ORACLE_PITCHES_MM]
        (_, _, coarse), (x, y, fine) = answers
        depth = 2 * fine.depth_mm - coarse.depth_mm
        rows.append(
            {
                "force_n": force,
                "depth_error": contact.depth_mm / depth - 1,
                "surface_error": _surface_error(contact, x, y, fine.deflection_mm),
                "pressure_error": _pressure_error(contact, x, y, fine.pressure_mpa),
                "force_error": contact.force_n / force - 1,
                "milliseconds": contact.milliseconds,
            }
        )
    return rows


def _oracle(shape: Shape, command: Press, pitch: float, kernels: dict):
    n = round(2 * REACH_MM / pitch)
    axis = (np.arange(n) - (n - 1) / 2) * pitch
    x, y = np.meshgrid(axis, axis)
    cos, sin = np.cos(command.yaw_rad), np.sin(command.yaw_rad)
    heights = shape.surface.sample(cos * x + sin * y, sin * x - cos * y)
    gap = heights.max() - np.maximum(heights, heights.max() - 10.0)
    return axis, axis, solve(gap, command.force_n, pitch, kernels[pitch], tolerance=1e-4)


def _surface_error(contact: Contact, x: np.ndarray, y: np.ndarray, truth: np.ndarray) -> float:
    from scipy.interpolate import RectBivariateSpline

    inside_x = contact.x_mm[np.abs(contact.x_mm) < REACH_MM - 0.5]
    inside_y = contact.y_mm[np.abs(contact.y_mm) < REACH_MM - 0.5]
    expected = RectBivariateSpline(y, x, truth)(inside_y, inside_x)
    rows, columns = np.isin(contact.y_mm, inside_y), np.isin(contact.x_mm, inside_x)
    found = contact.surface_mm[np.ix_(rows, columns)]
    return float(np.linalg.norm(found - expected) / np.linalg.norm(expected))


def _pressure_error(contact: Contact, x: np.ndarray, y: np.ndarray, truth: np.ndarray) -> float:
    edges = np.arange(-REACH_MM, REACH_MM + BLOCK_MM / 2, BLOCK_MM)

    def blocks(axis_x, axis_y, pressure):
        grid_x, grid_y = np.meshgrid(axis_x, axis_y)
        force = pressure * (axis_x[1] - axis_x[0]) ** 2
        return np.histogram2d(
            grid_y.ravel(), grid_x.ravel(), (edges, edges), weights=force.ravel()
        )[0]

    found = blocks(contact.x_mm, contact.y_mm, contact.pressure_kpa / BAR_KPA)
    expected = blocks(x, y, truth)
    return float(np.linalg.norm(found - expected) / np.linalg.norm(expected))


def protocol_milliseconds(elastomer: Elastomer, pitch_mm: float) -> dict[str, float]:
    """Median and 95th percentile of a press's time over the small protocol, ms."""
    times = []
    for name in catalogue.NAMES:
        shape = catalogue.load(name)
        for index in protocol.indices(name, protocol.SCALES["smoke"]):
            times.append(
                press(shape, protocol.press_at(shape, index), elastomer, pitch_mm).milliseconds
            )
    return {"median_ms": float(np.median(times)), "p95_ms": float(np.percentile(times, 95))}


def main() -> None:
    found: dict = {"command": "python -m benchmarks.press", "sensors": {}}
    for sensor, (elastomer, pitch) in SENSORS.items():
        kernels = {
            p: kernel(
                round(2 * REACH_MM / p),
                round(2 * REACH_MM / p),
                p,
                elastomer.thickness_mm,
                elastomer.young_mpa,
                elastomer.poisson,
            )
            for p in ORACLE_PITCHES_MM
        }
        shapes = {}
        for name in tqdm(catalogue.PRIMITIVES, desc=sensor, unit="shape"):
            shapes[name] = compare(catalogue.load(name), elastomer, pitch, kernels)
        own = DIGIT_GEL if sensor == "digit" else CYSKIN_COVER
        found["sensors"][sensor] = {
            "worst": {
                key: max(abs(row[key]) for rows in shapes.values() for row in rows)
                for key in ("depth_error", "surface_error", "pressure_error", "force_error")
            },
            "protocol": protocol_milliseconds(own, pitch),
            "shapes": shapes,
        }
        print(
            f"{sensor:7} {'shape':16} {'depth':>8} {'surface':>8} {'pressure':>8} {'ms':>6}  at 8 N"
        )
        for name, rows in shapes.items():
            last = rows[-1]
            print(
                f"{sensor:7} {name:16} {last['depth_error']:8.2%} {last['surface_error']:8.2%} "
                f"{last['pressure_error']:8.2%} {last['milliseconds']:6.1f}"
            )
        print(json.dumps({k: v for k, v in found["sensors"][sensor].items() if k != "shapes"}))
    Path("benchmarks/results/press.json").write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
