"""Whether attached sensors read or name each force of MuJoCo's contacts.

    python -m benchmarks.motion.attach_forces [--scenes N]

- Bodies that are dropped on a sensor: the weight that is read at rest.
- A gripper that closes on objects and lifts them: MuJoCo's force, and what is read.
- Random scenes: geoms and meshes, also hollow, thin and heavy ones, with explicit pairs, collision
  masks and sleep. MuJoCo's force on the sensor must be that of the touch and of its notices.
  Contacts that are smaller than the grid (unresolved) or did not settle must have a note.
"""

# MuJoCo defines its names at import, where pyright does not find them.
# pyright: reportAttributeAccessIssue=false

import warnings
from argparse import Namespace
from collections import Counter
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import product
from multiprocessing import get_context
from typing import Any

import mujoco
import numpy as np
import trimesh
from scipy.spatial.transform import Rotation
from tqdm import tqdm

import t2twin
from benchmarks.evidence import Argument, Benchmark, Figure, main
from benchmarks.motion.attach_scenes import (
    FACE_DOWN,
    Body,
    compile_scene,
    contact_of,
    geom,
    mesh_body,
    settle,
)
from t2twin.attachment.sensor import NOTHING, AttachedSensor
from t2twin.core.errors import T2TwinWarning
from t2twin.core.machine import cores
from t2twin.primitives_cad import catalogue
from t2twin.sim.contact.contact_notes import SMALL, UNSETTLED
from t2twin.sim.touch import Touch

BENCHMARK = Benchmark(
    module="benchmarks.motion.attach_forces",
    measures="Forces of MuJoCo's contacts on attached sensors: read, named, or lost.",
    minutes=20,
    sources=("t2twin/attachment", "sim/contact", "primitives_cad"),
    figures=(
        Figure("drops.drops"),
        Figure("drops.wrong", most=0),
        Figure("grasps.grasps"),
        Figure("grasps.wrong", most=0),
        Figure("random.scenes"),
        Figure("random.reads"),
        Figure("random.noticed"),
        Figure("random.lost", most=0),
        Figure("random.exceptions", most=0),
        Figure("random.warnings", most=0),
        Figure("random.unresolved"),
        Figure("random.unsettled", most=0),
        Figure("random.unnamed", most=0),
    ),
    arguments=(Argument("--scenes", "random scenes", int, 2000, partial=True),),
)

SENSORS = ("digit", "cyskin")

KINDS = ("exceptions", "warnings", "unresolved", "unsettled", "unnamed", "noticed", "lost")
"""What is counted of random scenes."""

LIMITS = (SMALL, UNSETTLED)
"""Notes of a contact that is not settled."""

GRAVITY = 9.81
"""m/s2"""

WEIGHT = np.array([0.0, 0.0, -GRAVITY])
"""Of 1 kg on a sensor that faces up, N."""

DROPPED = {
    "sphere": ("6", 6.0),
    "ellipsoid": ("7 6 5", 5.0),
    "box": ("6 6 4", 4.0),
    "cylinder": ("6 5", 5.0),
    "capsule": ("3 6", 9.0),
}
"""Sizes of dropped geoms and the heights of their centers, mm."""

DROPS_MM, MASSES_KG, STEPS_S = (
    (1.0, 10.0, 30.0, 60.0, 100.0),
    (0.02, 0.1, 0.5),
    (0.001, 0.002, 0.005),
)
DROP_S, WEIGHT_SHARE, AT_REST = 2.0, 0.01, 1e-3
"""Simulated time, s; tolerance on the weight; speed, m/s and rad/s, below which a body rests."""

OBJECTS = {
    "box": geom("box", 12.0, 12.0, 20.0),
    "cylinder": geom("cylinder", 12.0, 20.0),
    "ball": geom("sphere", 18.0),
    "plate": geom("box", 2.0, 12.0, 20.0),
}
GAINS, GRASP_STEPS_S, GRASP_MASSES_KG = (300.0, 1000.0, 4000.0), (0.001, 0.002, 0.004), (0.05, 0.2)
CLOSING_M_S, GRASP_S, LIFT_M = 0.08, 1.2, 0.05
"""Of the gripper: speed, duration, and lift in its second half."""

SHARE, MIN_LOST_N = 0.01, 0.01
"""Of MuJoCo's force, for each body, which may be neither read nor named."""

ROUNDING = 1e-3
"""Share of the whole force by which the force along the sensor may differ where a body falls
asleep."""

MIN_MASS_KG = 1e-3
"""Of bodies that press by their weight, kg (assumed: MuJoCo refuses thin bodies of less)."""

CHUNK = 25
"""Random scenes that a process does at once."""


def measure(options: Namespace) -> dict[str, Any]:
    return {"drops": drops(), "grasps": grasps(), "random": random_scenes(options.scenes)}


def in_processes(
    call: Callable[[Any], Any], jobs: Iterable[Any], total: int, name: str
) -> Iterable[Any]:
    with ProcessPoolExecutor(cores(), mp_context=get_context("spawn")) as pool:
        yield from tqdm(pool.map(call, jobs, chunksize=CHUNK), total=total, desc=name)


def drops() -> dict[str, Any]:
    """Drops after which a body at rest is not read with its weight, or is inside the sensor."""
    cases = list(product(SENSORS, DROPPED, MASSES_KG, DROPS_MM, STEPS_S))
    found = [each for each in in_processes(drop, cases, len(cases), "drops") if each is not None]
    return {"drops": len(cases), "wrong": len(found), "failures": found}


def drop(case: tuple[str, str, float, float, float]) -> dict[str, Any] | None:
    sensor, kind, mass_kg, drop_mm, step_s = case
    size, half_mm = DROPPED[kind]
    spec = mujoco.MjSpec()
    spec.option.timestep = step_s
    base = spec.worldbody.add_body(name="base")
    base.add_geom(**geom("box", 30.0, 30.0, 5.0, pos=[0.0, 0.0, -0.005]))
    base.add_site(name="pad")
    attached = t2twin.attach(spec, site="pad", sensor=sensor)
    height_m = 1e-3 * (attached.elastomer.thickness_mm + half_mm + drop_mm)
    body = spec.worldbody.add_body(name="dropped", pos=[0.0, 0.0, height_m])
    body.add_freejoint()
    body.add_geom(mass=mass_kg, **geom(kind, *map(float, size.split())))
    model = spec.compile()
    data = mujoco.MjData(model)
    settle(model, data, round(DROP_S / step_s))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", T2TwinWarning)
        touch = attached.read(model, data)
    force_n = contact_of(touch).force_n if touch.contacts else 0.0
    pose = attached.pose(model, data)
    z_mm = 1e3 * (data.body("dropped").xpos - pose[:3, 3])[2]
    is_on_pad = bool(
        (np.abs(1e3 * data.body("dropped").xpos[:2]) < attached.elastomer.width_mm / 3).all()
    )
    is_at_rest = bool(np.abs(data.qvel).max() < AT_REST)
    weight_n = GRAVITY * mass_kg
    inside = any("back" in notice.reason for notice in touch.notices)
    wrong = abs(force_n / weight_n - 1) > WEIGHT_SHARE and is_at_rest and is_on_pad
    if not (wrong or inside):
        return None
    names = ("sensor", "geom", "mass_kg", "drop_mm", "step_s")
    return dict(zip(names, case, strict=True)) | {"z_mm": float(z_mm), "force_n": force_n}


def grasps() -> dict[str, Any]:
    """Grasps whose force along a sensor differs from MuJoCo's by more than 2 % and 0.03 N."""
    cases = list(product(OBJECTS, GRASP_MASSES_KG, GAINS, GRASP_STEPS_S, SENSORS))
    found = [each for each in in_processes(grasp, cases, len(cases), "grasps") if each is not None]
    return {"grasps": len(cases), "wrong": len(found), "failures": found}


def grasp(case: tuple[str, float, float, float, str]) -> dict[str, Any] | None:
    """A gripper with two light fingers closes on an object and lifts it."""
    name, mass_kg, gain, step_s, sensor = case
    spec = mujoco.MjSpec()
    spec.option.timestep, spec.option.cone = step_s, mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1.0, 1.0, 0.1])
    stand = spec.worldbody.add_body(pos=[0.0, 0.0, 0.02])
    stand.add_geom(**geom("box", 10.0, 10.0, 20.0))
    hand = spec.worldbody.add_body(name="hand", pos=[0.0, 0.0, 0.06])
    hand.add_joint(name="lift", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1], damping=20)
    hand.add_geom(mass=0.5, contype=0, conaffinity=0, pos=[0, 0, 0.05], **geom("box", 60, 20, 10))
    for side in (-1, 1):
        finger = hand.add_body(pos=[0.04 * side, 0.0, 0.0])
        slide = {"type": mujoco.mjtJoint.mjJNT_SLIDE, "axis": [-side, 0, 0], "damping": 5}
        finger.add_joint(name=f"slide{side:+d}", **slide)
        finger.add_geom(mass=0.05, pos=[0.004 * side, 0, 0], **geom("box", 4.0, 15.0, 20.0))
        half = np.sqrt(0.5)
        finger.add_site(name=f"pad{side:+d}", quat=[half, 0.0, -side * half, 0.0])
    held = spec.worldbody.add_body(name="held", pos=[0.0, 0.0, 0.06])
    held.add_freejoint()
    held.add_geom(mass=mass_kg, friction=[1.0, 0.01, 0.0001], **OBJECTS[name])
    for joint, kp in (("slide-1", gain), ("slide+1", gain), ("lift", 2000.0)):
        servo = spec.add_actuator(target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        servo.set_to_position(kp=kp)
    sensors = [t2twin.attach(spec, site=f"pad{side:+d}", sensor=sensor) for side in (-1, 1)]
    model = spec.compile()
    data = mujoco.MjData(model)
    steps = round(GRASP_S / step_s)
    for step in range(steps):
        data.ctrl[:2] = min(0.04, CLOSING_M_S * step * step_s)
        data.ctrl[2] = LIFT_M * (2 * step > steps)
        mujoco.mj_step(model, data)
    values = []
    for each in sensors:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", T2TwinWarning)
            touch = each.read(model, data)
        contact = contact_of(touch)
        expected = -sum(force[2] for force in forces_on(model, data, each).values())
        values.append((float(expected), contact.force_n if contact else 0.0))
    if all(abs(true - read) <= max(0.02 * abs(true), 0.03) for true, read in values):
        return None
    names = ("object", "mass_kg", "gain", "step_s", "sensor")
    return dict(zip(names, case, strict=True)) | {"mujoco_and_read_n": values}


def forces_on(
    model: "mujoco.MjModel", data: "mujoco.MjData", sensor: AttachedSensor
) -> dict[int, np.ndarray]:
    """(3,) sums of MuJoCo's contact forces of each body on one sensor, in its frame, N."""
    frame, own = sensor.pose(model, data)[:3, :3], np.zeros(6)
    found: dict[int, np.ndarray] = {}
    surface = model.geom(f"{sensor.name}/surface").id
    for number in np.flatnonzero((data.contact.geom == surface).any(axis=1)):
        contact = data.contact[int(number)]
        mujoco.mj_contactForce(model, data, number, own)
        is_second = contact.geom[1] == surface
        sign = 1 if is_second else -1
        body = int(model.geom_bodyid[contact.geom[0 if is_second else 1]])
        force = sign * own[:3] @ (contact.frame.reshape(3, 3) @ frame)
        found[body] = found.get(body, np.zeros(3)) + force
    return found


def random_scenes(count: int) -> dict[str, Any]:
    """Outcomes of random scenes, and those that failed."""
    totals: Counter[str] = Counter(dict.fromkeys(KINDS, 0))
    failures: list[dict[str, Any]] = []
    for tally, failed in in_processes(random_outcome, range(count), count, "random scenes"):
        totals.update(tally)
        failures += failed
    return {"scenes": count, **totals, "failures": failures}


def random_outcome(number: int) -> tuple[Counter[str], list[dict[str, Any]]]:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", T2TwinWarning)
            return random_scene(number)
    except Exception as error:
        kind = "warnings" if isinstance(error, Warning) else "exceptions"
        failure = {"scene": number, "error": f"{type(error).__name__}: {error}"}
        return Counter({kind: 1}), [failure]


def random_scene(number: int) -> tuple[Counter[str], list[dict[str, Any]]]:
    """Reads of up to three random bodies on a random sensor, on the way to rest and there."""
    rng = np.random.default_rng((number, 52))
    sensor: str = SENSORS[number % 2]
    bodies = [random_body(rng, sensor) for _ in range(rng.integers(1, 4))]
    sleeps = rng.random() < 0.1
    if sleeps:  # weights press instead of forces on the joints, which would wake the bodies
        bodies = [
            replace(
                body,
                mass_kg=max(MIN_MASS_KG, -body.force_n[2] / GRAVITY),
                force_n=(0.0, 0.0, 0.0),
            )
            for body in bodies
        ]
    chances = {body: rng.random() for body in range(len(bodies))}

    def change(spec: "mujoco.MjSpec") -> None:
        for body, chance in chances.items():
            own = spec.geom(f"body-{body}-0")
            if chance < 0.1:  # by an explicit pair only
                own.contype = own.conaffinity = 0
                spec.add_pair(geomname1=f"{sensor}/surface", geomname2=own.name, condim=3)
            elif chance < 0.2:
                own.contype = own.conaffinity = 2
        if sleeps:
            spec.option.gravity = [0.0, 0.0, -GRAVITY]
            spec.option.enableflags |= mujoco.mjtEnableBit.mjENBL_SLEEP

    attached, model, data = compile_scene(sensor, bodies, change=change)
    tally: Counter[str] = Counter()
    failures: list[dict[str, Any]] = []
    known: dict[int, np.ndarray] = {}
    between: set[int] = set()  # bodies that touch another one that moves
    moves = model.body_dofnum > 0
    for steps in (5, 15, 40, 100, 400) if sleeps else (5, 15, 40, 100):
        for _ in range(steps if sleeps else 1):
            settle(model, data, 1 if sleeps else steps)
            # MuJoCo has no contacts of bodies that sleep, and stops them before they are at rest
            known = {
                body: force if body in between else WEIGHT * model.body_mass[body]
                for body, force in known.items()
                if not data.body_awake[body]
            } | forces_on(model, data, attached)
            touching = model.geom_bodyid[data.contact.geom]
            between = {body for body in between if not data.body_awake[body]}
            between |= set(touching[moves[touching].all(axis=1)].ravel().tolist())
        touch = attached.read(model, data)
        tally["reads"] += 1
        tally["noticed"] += bool(touch.notices)
        contact = contact_of(touch)
        if contact is not None and not contact.settled:
            kind = "unresolved" if contact.smaller_than_grid else "unsettled"
            tally[kind] += 1
            tally["unnamed"] += not any(limit in note for note in touch.notes for limit in LIMITS)
            if kind == "unsettled":
                failures.append({"scene": number, "time_s": data.time, "unsettled": str(contact)})
        tally["asleep"] += bool((data.tree_asleep >= 0).any())
        force_n = np.sum([*known.values(), np.zeros(3)], axis=0)
        lost_n = lost(touch, force_n, len(bodies))
        if lost_n > 0:
            tally["lost"] += 1
            failures.append({"scene": number, "lost_n": lost_n, "mujoco_n": force_n.tolist()})
    return tally, failures


def lost(touch: Touch, force_n: np.ndarray, bodies: int) -> float:
    """Force of MuJoCo that is neither read nor named beyond the tolerance, N."""
    contact = contact_of(touch)
    read_n = np.zeros(3) if contact is None else np.array([*contact.shear_n, -contact.force_n])
    rest_n = force_n - read_n - np.sum([each.force_n for each in touch.notices] or [0.0], axis=0)
    normal = abs(rest_n[2]) - max(SHARE * abs(force_n[2]), MIN_LOST_N * bodies)
    across = np.hypot(*rest_n[:2]) - ROUNDING * np.linalg.norm(force_n)
    across -= max(SHARE * float(np.hypot(*force_n[:2])), MIN_LOST_N * bodies)
    return float(max(normal, across, 0.0))


def random_body(rng: np.random.Generator, sensor: str) -> Body:
    """A geom, a primitive or a ring at any turn, or face down and tilted by up to 10 degrees."""
    a, b, c = rng.uniform(1.0, 10.0, 3)
    kinds = ("sphere", "capsule", "ellipsoid", "cylinder", "box")
    kind = int(rng.integers(len(kinds) + 3))
    if rng.random() < 0.3:
        turn = Rotation.from_quat(rng.normal(size=4))
    else:
        yaw, about, tilted = rng.uniform(0.0, 2 * np.pi), rng.normal(size=3), np.radians(10.0)
        about *= rng.uniform(0.0, tilted) / np.linalg.norm(about)
        turn = Rotation.from_rotvec(about) * Rotation.from_euler("z", yaw) * FACE_DOWN
    force_n = float(np.exp(rng.uniform(np.log(0.003), np.log(200.0))))
    half_x, half_y = (6.0, 9.0) if sensor == "digit" else (11.0, 18.0)
    options = {
        "place_mm": (float(rng.uniform(-half_x, half_x)), float(rng.uniform(-half_y, half_y))),
        "turn": turn,
        "force_n": (*(force_n * rng.uniform(-0.5, 0.5, 2) * (rng.random() < 0.5)), -force_n),
    }
    if kind == len(kinds):
        ring = trimesh.creation.annulus(a, a + b, c, sections=24)
        return mesh_body(replace(NOTHING, name=f"ring-{a:.6f}", mesh=ring), **options)
    if kind > len(kinds):
        shape = catalogue.load(catalogue.PRIMITIVES[rng.integers(len(catalogue.PRIMITIVES))])
        return mesh_body(shape, **options)
    if rng.random() < 0.15:  # thinner than a cell of the grid
        a = float(rng.uniform(0.05, 0.15))
    return Body([geom(kinds[kind], a, b, c)], **options)


if __name__ == "__main__":
    main(BENCHMARK)
