"""What the gel's dome and free sides change: `python -m benchmarks.dome`.

The press takes the DIGIT's gel for a laterally unbounded layer of the local thickness. Here the
same presses are made on it and on finite elements of the real gel (`benchmarks.solid`), both
linear, with vertical forces: on the middle, and away from it up to the rim. A flat, wide block is
the control: what differs there is the grids', not the gel's shape. The solid's depth is
extrapolated from two meshes, for the error of a punch's edge is of first order; its fields are the
finer one's. How far the finer mesh's depth is from the extrapolated one is told too, and so is what
forces along the gel's normal would change.
"""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.interpolate import RectBivariateSpline
from tqdm import tqdm

from benchmarks.solid import Answer, Gel, solve
from benchmarks.solids import ball
from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.errors import T2TwinError
from t2twin.primitives_cad.shape import Shape
from t2twin.sim.dataset import protocol
from t2twin.sim.press.elastomer import DIGIT_GEL, Elastomer
from t2twin.sim.press.engine import DIGIT_PITCH_MM, press
from t2twin.sim.press.footprint import heights_at
from t2twin.sim.press.records import PressCommand

SHAPES = ("hemisphere-2", "square-2", "line-smooth-2", "circle-empty-2", "line-sharp-4")
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

WIDE_MM, WIDE_FINE_MM = 80.0, 9.0
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

DOMED = replace(DIGIT_GEL, law="linear")
FLAT = replace(DOMED, dome_width_radius_mm=np.inf, dome_length_radius_mm=np.inf)
WIDE = replace(FLAT, width_mm=WIDE_MM, length_mm=WIDE_MM)

RESULTS = Path("benchmarks/results/dome.json")


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


def compare(
    shape: Shape,
    command: PressCommand,
    elastomer: Elastomer,
    coarse: Gel,
    fine: Gel,
    normal: Gel | None,
) -> dict:
    """Figures of one press, the engine against the solid; less force where 8 N goes through."""
    while True:
        try:
            contact = press(shape, command, elastomer, DIGIT_PITCH_MM)
            break
        except T2TwinError:
            command = replace(command, force_n=command.force_n / 2)
    touch = touch_mm(shape, command, elastomer)
    on_coarse, on_fine = (on_solid(gel, shape, command) for gel in (coarse, fine))
    coarse_mm, fine_mm = on_coarse.depth_mm - touch, on_fine.depth_mm - touch
    depth = 2 * fine_mm - coarse_mm
    x, y = contact.x_mm, contact.y_mm
    cell = contact.pitch_mm**2
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
        "pressure_error": _distance(
            _sum(x, y, 1e-3 * contact.pressure_kpa * cell), _blocks(fine, on_fine.force_n)
        ),
        "force_error": contact.force_n / command.force_n - 1,
        "settled": contact.settled,
        "mesh_error": fine_mm / depth - 1,
    }
    if normal is not None:
        along = on_solid(normal, shape, command)
        row["normal_depth_change"] = (along.depth_mm - on_coarse.depth_mm) / coarse_mm
        row["normal_pressure_change"] = _distance(
            _blocks(normal, along.force_n), _blocks(coarse, on_coarse.force_n)
        )
    return row


def _to_rim_mm(gel: Gel, touching: np.ndarray) -> float:
    x, y = np.meshgrid(gel.x_mm, gel.y_mm)
    return float(np.minimum(gel.x_mm[-1] - np.abs(x), gel.y_mm[-1] - np.abs(y))[touching].min())


def _distance(found: np.ndarray, expected: np.ndarray) -> float:
    return float(np.linalg.norm(found - expected) / np.linalg.norm(expected))


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


def near_rim(names: tuple[str, ...], rng: np.random.Generator) -> dict:
    """Of presses drawn from the protocol's: the shares with contact near the rim, and the shares
    of the force that lie there, by distance from the rim, mm."""
    touching, carried = [], []
    for name in tqdm(names, desc="protocol", unit="shape"):
        shape = catalogue.load(name)
        grid = protocol.grid_of(name)
        for index in rng.choice(grid.points**2 * grid.orientations, DRAWN, replace=False):
            command = protocol.press_at(shape, int(index))
            contact = press(shape, command, DIGIT_GEL, DIGIT_PITCH_MM)
            to_rim = np.minimum(
                DIGIT_GEL.width_mm / 2 - np.abs(contact.x_mm)[None, :],
                DIGIT_GEL.length_mm / 2 - np.abs(contact.y_mm)[:, None],
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


def show(rows: list[dict]) -> None:
    print(
        f"{'shape':15} {'x':>3} {'y':>3} {'N':>4} {'to rim':>6} {'depth mm':>8} {'depth':>7} "
        f"{'surface':>7} {'pressure':>8} {'force':>7} {'mesh':>6} {'normal':>7}"
    )
    for row in rows:
        print(
            f"{row['shape']:15} {row['x_mm']:3g} {row['y_mm']:3g} {row['force_n']:4g} "
            f"{row['to_rim_mm']:6.2f} {row['depth_mm']:8.3f} {row['depth_error']:7.1%} "
            f"{row['surface_error']:7.1%} {row['pressure_error']:8.1%} {row['force_error']:7.2%} "
            f"{row['mesh_error']:6.1%} {row.get('normal_depth_change', 0.0):7.1%}"
        )


def main() -> None:
    pressed = replace(ball(BALL_MM, BALL_PITCH_MM), name=f"ball-{BALL_MM:g}mm")
    shapes = [pressed, *(catalogue.load(name) for name in SHAPES)]
    coarse, fine = (Gel(WIDE, pitch, WIDE_FINE_MM) for pitch in (COARSE_MM, FINE_MM))
    control = [
        compare(shape, command, FLAT, coarse, fine, None)
        for shape in tqdm(shapes, desc="flat", unit="shape")
        for command in commands(shape)
        if command.x_mm == command.y_mm == 0
    ]
    coarse, fine = (Gel(DOMED, pitch) for pitch in (COARSE_MM, FINE_MM))
    normal = Gel(DOMED, COARSE_MM, along_normal=True)
    domed = [
        compare(shape, command, DOMED, coarse, fine, normal)
        for shape in tqdm(shapes, desc="domed", unit="shape")
        for command in commands(shape)
    ]
    domed.sort(key=lambda row: -row["to_rim_mm"])
    print("flat, wide block")
    show(control)
    print("the gel")
    show(domed)
    found = {
        "command": "python -m benchmarks.dome",
        "protocol_near_rim": {
            "primitives": near_rim(catalogue.PRIMITIVES, np.random.default_rng(0)),
            "objects": near_rim(catalogue.OBJECTS, np.random.default_rng(1)),
        },
        "flat": control,
        "domed": domed,
    }
    print(json.dumps(found["protocol_near_rim"]))
    temporary = RESULTS.with_suffix(".part")
    temporary.write_text(json.dumps(found, indent=1) + "\n")
    temporary.replace(RESULTS)


if __name__ == "__main__":
    main()
