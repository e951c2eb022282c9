"""Effect of the gel's dome and free sides, compared with finite elements of the real gel.

    python -m benchmarks.contact.dome [--shapes N]

The contact solver models the DIGIT's gel as a laterally unbounded layer of the local thickness.
This benchmark makes the same presses on that layer and on finite elements of the real gel
(`solid`). Both are linear, with vertical forces, in the middle and towards the rim.

A flat, wide block is the control: its differences are due to the grids. The depth of the solid is
extrapolated from two meshes, because the error at the edge of a punch is of first order. Its fields
are those of the finer mesh. The results also have the distance of the finer mesh's depth from the
extrapolated one, and the effect of forces along the gel's normal.
"""

from argparse import Namespace
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.interpolate import RectBivariateSpline
from tqdm import tqdm

from benchmarks.contact.solid import Answer, Gel, solve
from benchmarks.evidence.record import Argument, Benchmark, Figure
from benchmarks.evidence.run import main
from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.shape import Shape, ball
from t2twin.sim.contact.contact_solver import solve_contact
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.heights import heights_at
from t2twin.sim.contact.types import PressCommand
from t2twin.sim.sampling import protocol
from t2twin.sim.sensors.pair import SensorPair

BENCHMARK = Benchmark(
    module="benchmarks.contact.dome",
    measures="Effect of the gel's dome and free sides, against finite elements of the real gel.",
    minutes=12,
    sources=("primitives_cad", "sim/contact", "sim/sampling"),
    figures=(
        Figure("summary.flat.worst_depth_error"),
        Figure("summary.middle.median_surface_error"),
        Figure("summary.to_rim.*.worst_depth_error"),
        Figure("summary.to_rim.*.median_surface_error"),
        Figure("summary.to_rim.*.worst_surface_error"),
        Figure("protocol_near_rim.*.share_of_presses.2"),
        Figure("protocol_near_rim.*.share_of_force.2"),
    ),
    arguments=(
        Argument("--shapes", "take every Nth shape only; keeps nothing", int, 1, partial=True),
    ),
)

SHAPES = ("hemisphere-2", "square-2", "line-smooth-2", "circle-empty-2", "line-sharp-2")
"""Shapes that lie on the gel whole when they are pressed in its middle."""

BALL_MM = 4.0
"""Radius of the ball that is pressed beside the catalogue's shapes, mm."""

BALL_PITCH_MM = 0.04
"""Pitch of the ball's height map, mm."""

PLACES_MM = (
    (0, 0), (2, 0), (4, 0), (6, 0), (8, 0), (0, 2), (0, 4), (0, 6), (0, 8), (0, 10), (0, 11),
)  # fmt: skip
"""Where is pressed, mm: multiples of every pitch, so that all grids meet the shape alike."""

FORCES_N = (1.0, 8.0)
YAW_RAD = 0.4
"""A turn that lines up with no grid."""

COARSE_MM, FINE_MM = 0.5, 0.25
"""The solid's two meshes: pitch of their columns, mm."""

WIDE_MM, WIDE_FINE_MM = 80.0, 10.0
"""The control's side, and how far from its middle it is fine, mm. A nearly incompressible layer
feels its sides over h sqrt((1 - nu) / (1.5 (1 - 2 nu))), 10 mm: the sides are four of that away."""

TOUCH_STEP_MM = 0.02
"""Grid on which a shape's first touch is looked for, the same for both, mm."""

BLOCK_MM = 1.0
"""Resolution at which surfaces and pressures are compared, mm: no edge is finer in the meshes."""

SPREAD = 4
"""Points a side by which a node's force is spread over the part of the top nearest to it."""

RIM_MM = (1.0, 2.0, 3.0)
"""Distances from the rim within which the protocol's contacts are counted, mm."""

DRAWN = 20
"""Presses of each shape drawn from the protocol."""

CAMERA = SensorPair().camera
GEL = CAMERA.own_gel
DOMED = replace(GEL, law="linear")
FLAT = replace(DOMED, dome_width_radius_mm=np.inf, dome_length_radius_mm=np.inf)
WIDE = replace(FLAT, width_mm=WIDE_MM, length_mm=WIDE_MM)


def touch_mm(shape: Shape, command: PressCommand, elastomer: Elastomer) -> float:
    """Shape's depth below the gel's apex at its first touch, mm."""
    axes = []
    for middle, size in ((command.x_mm, elastomer.width_mm), (command.y_mm, elastomer.length_mm)):
        axis = np.arange(-10.0, 10.0, TOUCH_STEP_MM) + middle
        axes.append(axis[np.abs(axis) <= size / 2])
    heights = heights_at(shape.surface, command, *axes)
    return float((-heights - elastomer.rest_surface_mm(*np.meshgrid(*axes))).min())


def on_solid(gel: Gel, shape: Shape, command: PressCommand) -> Answer:
    """The press on the solid; depth_mm is below the gel's apex."""
    heights = heights_at(shape.surface, command, gel.x_mm, gel.y_mm)
    return solve(gel, -gel.rest_mm - heights, command.force_n)


@dataclass(frozen=True)
class Ground:
    """What is pressed into: the engine's elastomer, its solid with a coarse and a fine mesh, and,
    where it is domed, the coarse one under forces along the normal."""

    elastomer: Elastomer
    coarse: Gel
    fine: Gel
    normal: Gel | None = None


def wide_block() -> Ground:
    return Ground(FLAT, *(Gel(WIDE, pitch, WIDE_FINE_MM) for pitch in (COARSE_MM, FINE_MM)))


def domed_gel(coarse_mm: float = COARSE_MM, fine_mm: float = FINE_MM) -> Ground:
    coarse, fine = (Gel(DOMED, pitch) for pitch in (coarse_mm, fine_mm))
    return Ground(DOMED, coarse, fine, Gel(DOMED, coarse_mm, along_normal=True))


def compare(shape: Shape, command: PressCommand, ground: Ground) -> dict[str, Any]:
    """Figures of one press, the engine against the solid; less force where 8 N goes through."""
    while True:
        try:
            contact = solve_contact(shape, command, ground.elastomer, CAMERA.pitch_mm)
            break
        except T2TwinError:
            command = replace(command, force_n=command.force_n / 2)
    fine = ground.fine
    touch = touch_mm(shape, command, ground.elastomer)
    on_coarse, on_fine = (on_solid(gel, shape, command) for gel in (ground.coarse, fine))
    coarse_mm, fine_mm = on_coarse.depth_mm - touch, on_fine.depth_mm - touch
    depth = 2 * fine_mm - coarse_mm
    x, y = contact.x_mm, contact.y_mm
    force_n = 1e-3 * contact.pressure_kpa * contact.pitch_mm**2
    surface = RectBivariateSpline(fine.y_mm, fine.x_mm, on_fine.deflection_mm)(y, x)
    row = {
        "shape": shape.name,
        "x_mm": command.x_mm,
        "y_mm": command.y_mm,
        "force_n": command.force_n,
        "to_rim_mm": _to_rim_mm(fine, on_fine.force_n > 0),
        "depth_mm": depth,
        "depth_error": (contact.shape_depth_mm - touch) / depth - 1,
        "surface_error": _distance(_sum(x, y, contact.surface_mm), _sum(x, y, surface)),
        "pressure_error": _distance(_sum(x, y, force_n), _blocks(fine, on_fine.force_n)),
        "force_error": contact.force_n / command.force_n - 1,
        "settled": contact.settled,
        "mesh_error": fine_mm / depth - 1,
    }
    if ground.normal is not None:
        along = on_solid(ground.normal, shape, command)
        row["normal_depth_change"] = (along.depth_mm - on_coarse.depth_mm) / coarse_mm
        row["normal_pressure_change"] = _distance(
            _blocks(ground.normal, along.force_n), _blocks(ground.coarse, on_coarse.force_n)
        )
    return row


def _to_rim_mm(gel: Gel, touching: np.ndarray) -> float:
    x, y = np.meshgrid(gel.x_mm, gel.y_mm)
    return float(np.minimum(gel.x_mm[-1] - np.abs(x), gel.y_mm[-1] - np.abs(y))[touching].min())


def _distance(given: np.ndarray, expected: np.ndarray) -> float:
    return float(np.linalg.norm(given - expected) / np.linalg.norm(expected))


def _blocks(gel: Gel, force_n: np.ndarray) -> np.ndarray:
    """Forces on blocks, each node's spread evenly over the part of the top nearest to it."""
    total = np.zeros(())
    steps = (np.arange(SPREAD) + 0.5) / SPREAD
    ends = [
        (np.append(axis[0], middle), np.append(middle, axis[-1]))
        for axis in (gel.x_mm, gel.y_mm)
        for middle in [(axis[1:] + axis[:-1]) / 2]
    ]
    (left, right), (near, far) = ends
    for to_y in steps:
        for to_x in steps:
            x, y = left + to_x * (right - left), near + to_y * (far - near)
            total = total + _sum(x, y, force_n) / SPREAD**2
    return total


def _sum(x_mm: np.ndarray, y_mm: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Sums of values (ny, nx) over square blocks."""
    edges = np.arange(-20.0, 20.0 + BLOCK_MM / 2, BLOCK_MM)
    x, y = np.meshgrid(x_mm, y_mm)
    return np.histogram2d(y.ravel(), x.ravel(), (edges, edges), weights=values.ravel())[0]


def near_rim(names: Iterable[str], rng: np.random.Generator) -> dict[str, Any]:
    """Of presses drawn from the protocol's: the shares with contact near the rim, and the shares
    of the force that lie there, by distance from the rim, mm."""
    touching, carried = [], []
    for name in tqdm(names, desc="protocol", unit="shape"):
        shape = catalogue.load(name)
        grid = protocol.grid_of(name)
        for index in rng.choice(grid.points**2 * grid.orientations, DRAWN, replace=False):
            command = protocol.press_at(shape, int(index))
            contact = solve_contact(shape, command, GEL, CAMERA.pitch_mm)
            to_rim = np.minimum(
                GEL.width_mm / 2 - np.abs(contact.x_mm)[None, :],
                GEL.length_mm / 2 - np.abs(contact.y_mm)[:, None],
            )
            pressure = contact.pressure_kpa
            near = [to_rim < distance for distance in RIM_MM]
            touching.append([bool((pressure[part] > 0).any()) for part in near])
            carried.append([float(pressure[part].sum() / pressure.sum()) for part in near])
    return {
        "presses": len(touching),
        "within_mm": RIM_MM,
        "share_of_presses": np.mean(touching, axis=0).tolist(),
        "share_of_force": np.mean(carried, axis=0).tolist(),
    }


def commands(shape: Shape) -> Iterator[PressCommand]:
    for x, y in PLACES_MM:
        for force in FORCES_N:
            yield PressCommand(shape.name, float(x), float(y), YAW_RAD, force)


def summary(control: list[dict[str, Any]], domed: list[dict[str, Any]]) -> dict[str, Any]:
    """The figures that say how far off the layer is: on the flat block, in the gel's middle, and
    by the contact's distance from the rim."""
    bands = {
        "beyond_3_mm": (3.0, np.inf),
        "2_to_3_mm": (2.0, 3.0),
        "1_to_2_mm": (1.0, 2.0),
        "within_1_mm": (-np.inf, 1.0),
    }
    middle = [row for row in domed if row["x_mm"] == row["y_mm"] == 0]
    return {
        "flat": _figures(control),
        "middle": _figures(middle),
        "to_rim": {
            name: _figures([row for row in domed if low <= row["to_rim_mm"] < high])
            for name, (low, high) in bands.items()
        },
    }


def _figures(rows: list[dict[str, Any]]) -> dict[str, float] | None:
    """None of no rows."""
    if not rows:
        return None
    return {
        "presses": len(rows),
        "worst_depth_error": max(abs(row["depth_error"]) for row in rows),
        "median_surface_error": float(np.median([row["surface_error"] for row in rows])),
        "worst_surface_error": max(row["surface_error"] for row in rows),
    }


def measure(options: Namespace) -> dict[str, Any]:
    pressed = replace(ball(BALL_MM, BALL_PITCH_MM), name=f"ball-{BALL_MM:g}mm")
    shapes = [pressed, *(catalogue.load(name) for name in SHAPES)][:: options.shapes]
    block = wide_block()
    control = [
        compare(shape, command, block)
        for shape in tqdm(shapes, desc="flat", unit="shape")
        for command in commands(shape)
        if command.x_mm == command.y_mm == 0
    ]
    gel = domed_gel()
    domed = [
        compare(shape, command, gel)
        for shape in tqdm(shapes, desc="domed", unit="shape")
        for command in commands(shape)
    ]
    domed.sort(key=lambda row: -row["to_rim_mm"])
    near = {
        kind: near_rim(names[:: options.shapes], np.random.default_rng(seed))
        for seed, (kind, names) in enumerate(
            {"primitives": catalogue.PRIMITIVES, "objects": catalogue.OBJECTS}.items()
        )
    }
    return {
        "summary": summary(control, domed),
        "protocol_near_rim": near,
        "flat": control,
        "domed": domed,
    }


if __name__ == "__main__":
    main(BENCHMARK)
