"""Whether attached sensors read or name each force of MuJoCo's contacts.

    python -m benchmarks.motion.attach_forces [--scenes N]

Random scenes have geoms and meshes, also hollow, thin and heavy ones, with explicit pairs,
collision masks and sleep. MuJoCo's force on the sensor must be that of the touch and of its
notices. Contacts that are smaller than the grid (unresolved) or did not settle must have a note.
"""

# MuJoCo defines its names at import, where pyright does not find them.
# pyright: reportAttributeAccessIssue=false

import warnings
from argparse import Namespace
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from typing import Any

import mujoco
import numpy as np
import trimesh
from scipy.spatial.transform import Rotation
from tqdm import tqdm

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
from t2twin.sim.contact.types import SMALL, UNSETTLED
from t2twin.sim.touch import Touch

BENCHMARK = Benchmark(
    module="benchmarks.motion.attach_forces",
    measures="Forces of MuJoCo's contacts on attached sensors: read, named, or lost.",
    minutes=20,
    sources=("t2twin/attachment", "sim/contact", "primitives_cad"),
    figures=(
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
    return {"random": random_scenes(options.scenes)}


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
    with ProcessPoolExecutor(cores(), mp_context=get_context("spawn")) as pool:
        outcomes = pool.map(random_outcome, range(count), chunksize=CHUNK)
        for tally, failed in tqdm(outcomes, total=count, unit="scene"):
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
