"""Sensors in MuJoCo models: the same press by a Twin, wrenches, tilt, and read time.

    python -m benchmarks.motion.attach

- Bodies pressed in MuJoCo and the same shapes pressed by a Twin: meshes of primitives, and geoms
  with a formula.
- Force and torque of a touch, and those of MuJoCo's contacts, of bodies that are also pushed.
- Depth when the compliance of MuJoCo's contacts changes tenfold.
- Tilted bodies, against the contact of the same height map on a grid of half the pitch.
- Processor time of a height map, and of a read by each of two sensors in threads at 60 Hz.
"""

import time
from argparse import Namespace
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from itertools import product
from typing import Any
from unittest.mock import patch

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation
from tqdm import tqdm

import t2twin
from benchmarks.contact.press import HALVED
from benchmarks.contact.solids import formula
from benchmarks.evidence.record import Benchmark, Figure
from benchmarks.evidence.run import main
from benchmarks.motion.attach_scenes import (
    FACE_DOWN,
    Body,
    compile_grip,
    compile_scene,
    contact_of,
    contact_wrench,
    geom,
    mesh_body,
    settle,
)
from t2twin.attachment.geometry import Region, body_surface
from t2twin.attachment.sensor import NOTHING, AttachedSensor
from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.height_map import rasterize_triangles
from t2twin.primitives_cad.shape import NOTHING_MM, HeightMap, Shape
from t2twin.sim.contact import pin_layout
from t2twin.sim.contact.contact_solver import solve_contact
from t2twin.sim.contact.types import Contact, PressCommand
from t2twin.sim.touch import Touch

BENCHMARK = Benchmark(
    module="benchmarks.motion.attach",
    measures="Sensors in MuJoCo models: accuracy against a Twin and MuJoCo, read time.",
    minutes=25,
    sources=("t2twin/attachment", "sim/contact", "primitives_cad"),
    figures=(
        Figure("same_press.worst.digit.depth_error", most=0.01),
        Figure("same_press.worst.digit.image_db", "dB", least=40.0),
        Figure("same_press.worst.cyskin.depth_error", most=0.01),
        Figure("same_press.worst.cyskin.counts_error", most=0.01),
        Figure("wrench.worst.*.*", most=0.01),
        Figure("compliance.worst.*", most=0.02),
        Figure("tilt.worst.*.depth_error", most=0.03),
        Figure("tilt.worst.*.centroid_mm", "mm", most=0.2),
        Figure("height_maps.*", "ms"),
        Figure("two_sensors.median_ms", "ms"),
        Figure("two_sensors.p99_ms", "ms"),
    ),
)

SENSORS = ("digit", "cyskin")

PRIMITIVES = catalogue.PRIMITIVES[:: max(1, len(catalogue.PRIMITIVES) // 15)][:15]
"""Shapes whose meshes are pressed in MuJoCo."""

CAPSULE_MM, ELLIPSOID_MM, BLOCK_MM, PUNCH_MM, BALL_MM = (4.0, 6.0), (9.0, 6.0, 5.0), 7.0, 4.0, 6.0
"""Radius and half length; half axes; side; radius; radius."""

MAP_PITCH_MM, MAP_REACH_MM = 0.0125, 21.0
"""Of the height maps that a Twin presses: a quarter of the usual pitch. At the usual one a round
outline is half a pitch too small, which changes the depth of a ring by 2 %."""

FORCES_N = (1.0, 12.0)
COMPLIANCES_S = (0.005, 0.05)
"""First values of MuJoCo's solref, whose square is proportional to the compliance."""

TILTS_DEG = (0.0, 2.0, 4.0, 8.0)
TILT_FORCES_N = (1.0, 8.0)

PUSHES = ((0.3, 0.0), (0.0, -0.3), (0.2, 0.3))
"""Tangential forces on a body, in shares of the normal force."""

FRAMES, FRAME_S = 240, 1 / 60
"""Reads of each of two sensors, and the simulated time between them."""

WARM_UP, GRIP_N = 10, 8.0
"""Reads of each before, and force on the box, N."""

PATCH_MM = 7.0
"""Half the side of the patch whose height map is timed."""


def measure(options: Namespace) -> dict[str, Any]:
    return {
        "same_press": same_press(),
        "wrench": wrench(),
        "compliance": compliance(),
        "tilt": tilt(),
        "height_maps": height_maps(),
        "two_sensors": two_sensors(),
    }


def pairs() -> list[tuple[Shape, Body]]:
    """Shapes with a height map of MAP_PITCH_MM, and the same solids as bodies of MuJoCo."""
    lying = [np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0]
    half = BLOCK_MM / 2
    bodies = {
        "ball": Body([geom("sphere", BALL_MM)]),
        "block": Body([geom("box", half, half, half)]),
        "punch": Body([geom("cylinder", PUNCH_MM, PUNCH_MM)]),
        "capsule": Body([geom("capsule", *CAPSULE_MM, quat=lying)]),
        "ellipsoid": Body([geom("ellipsoid", *ELLIPSOID_MM)]),
    }
    meshes = [(refined(shape), mesh_body(shape)) for shape in map(catalogue.load, PRIMITIVES)]
    return meshes + [
        (formula(heights, name, MAP_PITCH_MM), bodies[name]) for name, heights in FORMULAS.items()
    ]


def refined(shape: Shape) -> Shape:
    """A shape whose height map has MAP_PITCH_MM, up to MAP_REACH_MM."""
    side = round(MAP_REACH_MM / MAP_PITCH_MM)
    heights = rasterize_triangles(np.array(shape.mesh.triangles), MAP_PITCH_MM, side, side)
    axis = np.arange(-side - 1, side + 2) * MAP_PITCH_MM
    surface = HeightMap(heights.astype(np.float32), axis, axis)
    return Shape(shape.name, shape.mesh, surface, shape.spacing_mm)  # replace() keeps the map


def _capsule(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    radius, half = CAPSULE_MM
    return _round(radius, (y / radius) ** 2 + (np.maximum(np.abs(x) - half, 0.0) / radius) ** 2)


def _ellipsoid(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    a, b, c = ELLIPSOID_MM
    return _round(c, (x / a) ** 2 + (y / b) ** 2)


def _round(height_mm: float, square: np.ndarray) -> np.ndarray:
    upper = height_mm * (np.sqrt(np.maximum(1.0 - square, 0.0)) - 1.0)
    return np.where(square < 1.0, upper, NOTHING_MM)


FORMULAS: dict[str, Callable[[np.ndarray, np.ndarray], np.ndarray]] = {
    "ball": lambda x, y: _round(BALL_MM, (x**2 + y**2) / BALL_MM**2),
    "block": lambda x, y: np.where(
        np.maximum(np.abs(x), np.abs(y)) <= BLOCK_MM / 2, 0.0, NOTHING_MM
    ),
    "punch": lambda x, y: np.where(np.hypot(x, y) <= PUNCH_MM, 0.0, NOTHING_MM),
    "capsule": _capsule,
    "ellipsoid": _ellipsoid,
}
"""Heights of the geoms with a formula, mm."""


def read_at_rest(sensor: str, body: Body, **options: Any) -> Touch:
    """The touch of a body that has come to rest. options: of all geoms."""
    attached, model, data = compile_scene(sensor, [body], **options)
    settle(model, data)
    return attached.read(model, data)


def pressed(body: Body, force_n: float, yaw_deg: float = 0.0, **options: Any) -> Body:
    turn = Rotation.from_euler("z", yaw_deg, degrees=True) * FACE_DOWN
    return replace(body, turn=turn, force_n=(0.0, 0.0, -force_n), **options)


def same_press(count: int | None = None) -> dict[str, Any]:
    """Pairs pressed at the apex with a random force and yaw. count: None for all pairs."""
    twin, rng = t2twin.Twin(imperfections="none"), np.random.default_rng(0)
    rows: dict[str, list[dict[str, Any]]] = {sensor: [] for sensor in SENSORS}
    for shape, body in tqdm(pairs()[-(count or 0) :], desc="same press", unit="shape"):
        force_n, yaw_deg = float(rng.uniform(*FORCES_N)), float(rng.uniform(0.0, 360.0))
        for sensor in SENSORS:
            attached, model, data = compile_scene(
                sensor, [pressed(body, force_n, yaw_deg)], geometry="visual"
            )
            settle(model, data)
            touch = attached.read(model, data)
            # MuJoCo's first contacts push the body aside; then friction holds it.
            x_mm, y_mm, _ = (1e3 * data.body("body-0").xpos).tolist()
            expected = twin.press(shape, force_n=force_n, x_mm=x_mm, y_mm=y_mm, yaw_deg=yaw_deg)
            row = {"shape": shape.name, "force_n": force_n, "yaw_deg": yaw_deg}
            depths = [getattr(each, sensor).depth_mm for each in (touch, expected)]
            row["depth_error"] = depths[0] / depths[1] - 1
            if sensor == "digit":
                row["image_db"] = psnr_db(touch.image, expected.image)
            else:
                difference = touch.counts.astype(float) - expected.counts
                row["counts_error"] = (
                    float(np.abs(difference).max()) / twin.sensors.array.full_scale
                )
            rows[sensor].append(row)
    return {"worst": {sensor: worst(rows[sensor]) for sensor in SENSORS}, "presses": rows}


def psnr_db(image: np.ndarray, expected: np.ndarray) -> float:
    square = float(np.mean((image.astype(float) - expected) ** 2))
    return 10 * np.log10(255.0**2 / max(square, 1e-3))  # equal images: 78 dB


def worst(rows: list[dict[str, Any]]) -> dict[str, float]:
    """The largest of each error, without its sign, and the least image_db."""
    keys = [key for key in rows[0] if key.endswith(("_error", "centroid_mm", "_db"))]
    return {
        key: min(row[key] for row in rows)
        if key == "image_db"
        else max(abs(row[key]) for row in rows)
        for key in keys
    }


def wrench() -> dict[str, Any]:
    """Force and torque of bodies that are pushed, after every eighth of the settling.

    Errors are shares of MuJoCo's force, and of its torque or 1 mm times the force.
    """
    rows: dict[str, list[dict[str, Any]]] = {sensor: [] for sensor in SENSORS}
    bodies = {shape.name: body for shape, body in pairs()[-5:]}
    for (name, body), share in product(bodies.items(), PUSHES):
        for sensor, force_n in product(SENSORS, TILT_FORCES_N):
            options = {"place_mm": (1.5, -2.0)}
            each = pressed(body, force_n, 30.0, **options)
            pushed = replace(each, force_n=(*(force_n * np.array(share)), -force_n))
            attached, model, data = compile_scene(sensor, [pushed], friction=[1.2, 0.005, 0.0001])
            settle(model, data)
            touch = attached.read(model, data)
            contact = contact_of(touch)
            force, torque = contact_wrench(model, data, attached.pose(model, data))
            found = np.array([*contact.shear_n, -contact.force_n])
            size = float(np.linalg.norm(force))
            rows[sensor].append(
                {
                    "shape": name,
                    "push": share,
                    "force_n": force_n,
                    "slip_share": contact.slip_share,
                    "force_error": float(np.linalg.norm(found - force)) / size,
                    "torque_error": (contact.torque_nmm - torque[2]) / max(abs(torque[2]), size),
                }
            )
    return {"worst": {sensor: worst(rows[sensor]) for sensor in SENSORS}, "touches": rows}


def compliance() -> dict[str, Any]:
    """Changes of depth at equal force between both of COMPLIANCES_S."""
    rows = []
    for shape, body in pairs()[::4]:
        row: dict[str, Any] = {"shape": shape.name}
        for sensor in SENSORS:
            depths = [
                contact_of(read_at_rest(sensor, pressed(body, 8.0), solref=[each, 1.0])).depth_mm
                for each in COMPLIANCES_S
            ]
            row[f"{sensor}_error"] = depths[1] / depths[0] - 1
        rows.append(row)
    return {"worst": worst(rows), "shapes": rows}


def tilt() -> dict[str, Any]:
    """Depth and centroid of pressure of tilted bodies, and of the same on a halved grid."""
    every = [pairs()[number] for number in (2, -5, -4, -3)]  # a mesh, ball, block and punch
    rows: dict[str, list[dict[str, Any]]] = {sensor: [] for sensor in SENSORS}
    for (shape, body), degrees, force_n in product(every, TILTS_DEG, TILT_FORCES_N):
        turn = Rotation.from_euler("zx", [20.0, degrees], degrees=True) * FACE_DOWN
        for sensor in SENSORS:
            body_now = replace(body, turn=turn, place_mm=(1.0, 2.0))
            attached, model, data = compile_scene(sensor, [body_now])
            pose, elastomer = attached.pose(model, data), attached.elastomer
            place = pose[:3, :3], pose[:3, 3], Region.of(elastomer)
            found = body_surface(model, data, model.body("body-0").id, *place)
            command = PressCommand(shape.name, 0.0, 0.0, 0.0, force_n)
            assert found is not None
            its_shape = replace(NOTHING, name=shape.name, surface=found.surface)
            pitch_mm = attached.device.pitch_mm
            coarse = solve_contact(its_shape, command, elastomer, pitch_mm)
            with patch.multiple(pin_layout, **HALVED):
                fine = solve_contact(its_shape, command, elastomer, pitch_mm / 2)
            apart = np.subtract(centroid_mm(coarse), centroid_mm(fine))
            rows[sensor].append(
                {
                    "shape": shape.name,
                    "tilt_deg": degrees,
                    "force_n": force_n,
                    "depth_error": coarse.depth_mm / fine.depth_mm - 1,
                    "centroid_mm": float(np.hypot(*apart)),
                }
            )
    return {"worst": {sensor: worst(rows[sensor]) for sensor in SENSORS}, "presses": rows}


def centroid_mm(contact: Contact) -> tuple[float, float]:
    """Center of pressure."""
    pressure, total = contact.pressure_kpa, contact.pressure_kpa.sum()
    return (
        float(pressure.sum(axis=0) @ contact.x_mm / total),
        float(pressure.sum(axis=1) @ contact.y_mm / total),
    )


def height_maps() -> dict[str, float]:
    """Processor time, ms, of the height map of a solid over a patch of 2 PATCH_MM on the DIGIT."""
    found = {}
    r = PATCH_MM
    shapes = {
        "sphere": (r,),
        "capsule": (r, 0.1 * r),
        "ellipsoid": (r, r, r / 2),
        "cylinder": (r, r),
        "box": (r, r, r),
    }
    solids = {kind: Body([geom(kind, *sizes)]) for kind, sizes in shapes.items()}
    for faces, solid in (
        ("20k", trimesh.creation.icosphere(5)),
        ("82k", trimesh.creation.icosphere(6)),
    ):
        solid.apply_scale(r)
        solids[f"mesh_{faces}"] = mesh_body(replace(NOTHING, name="ball", mesh=solid))
    turn = Rotation.from_euler("x", 5.0, degrees=True) * FACE_DOWN
    for name, body in solids.items():
        attached, model, data = compile_scene("digit", [replace(body, turn=turn)])
        pose, region = attached.pose(model, data), Region.of(attached.elastomer)
        place = pose[:3, :3], pose[:3, 3], region
        find = partial(body_surface, model, data, model.body("body-0").id, *place)
        found[f"{name}_ms"] = 1e3 * min(thread_time(find) for _ in range(20))
    return found


def thread_time(call: Callable[[], Any]) -> float:
    """Processor time of a call, s."""
    started = time.thread_time()
    call()
    return time.thread_time() - started


def two_sensors() -> dict[str, float]:
    """Processor time of a read, ms, of two DIGITs that hold a box, which is pushed to and fro."""
    sensors, model, data = compile_grip(GRIP_N)
    times: list[float] = []

    def read(sensor: AttachedSensor) -> float:
        return thread_time(partial(sensor.read, model, data))

    steps = round(FRAME_S / model.opt.timestep)
    settle(model, data)
    with ThreadPoolExecutor(len(sensors)) as pool:
        for frame in range(FRAMES + WARM_UP):
            data.xfrc_applied[model.body("held").id, :2] = (
                GRIP_N * PUSHES[0][0] * np.array([np.sin(0.1 * frame), np.cos(0.07 * frame)])
            )
            settle(model, data, steps)
            times += pool.map(read, sensors)
    times_ms = 1e3 * np.array(times[2 * WARM_UP :])
    return {
        "median_ms": float(np.median(times_ms)),
        "p99_ms": float(np.percentile(times_ms, 99)),
        "max_ms": float(times_ms.max()),
    }


if __name__ == "__main__":
    main(BENCHMARK)
