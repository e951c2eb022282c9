"""Reads of bodies that random forces push, tilt, turn and roll over a sensor, as in a robot's loop.

    python -m benchmarks pushed [--sensors NAME ...] [--seconds S]

Bodies of 100 g lie on a sensor. Forces of a few newtons change all the time, and some of them act
beside the body's center. The sensor is read FRAME_HZ times a second of simulated time. Reads do not
change the simulation, so that each version of the code reads the same states.

- Processor time of the reads in contact of each scene, and of those without contact.
- Share that did not settle, and the reasons of all notices.
"""

# MuJoCo defines its names at import, where pyright does not find them.
# pyright: reportAttributeAccessIssue=false

import gc
import time
import warnings
from argparse import Namespace
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from tqdm import tqdm

import t2twin
from benchmarks.evidence import Argument, Benchmark, Figure
from t2twin.core.errors import T2TwinWarning

SENSORS = ("digit", "cyskin")

BENCHMARK = Benchmark(
    module="benchmarks.motion.pushed",
    minutes=4,
    sources=("t2twin/attachment", "sim/contact", "primitives_cad"),
    figures=(
        Figure("scenes.*.*.median_ms", "ms"),
        Figure("scenes.*.*.p99_ms", "ms"),
        Figure("scenes.*.*.worst_ms", "ms"),
        Figure("scenes.*.*.unsettled", most=0),
        Figure("without_contact_ms", "ms", most=1.0),
    ),
    arguments=(
        Argument("--sensors", "names or files of sensors", nargs="+", default=list(SENSORS),
                 partial=True),
        Argument("--seconds", "of simulated time in each scene", float, 5.0, partial=True),
    ),
)  # fmt: skip

FRAME_HZ = 60.0

MASS_KG, GRAVITY = 0.1, 9.81

CHANGE_S = 0.15
"""Time in which the forces change, s (assumed: that of a hand or an arm that corrects)."""

PRESS_N, PUSH_N = (3.0, 1.5), 1.5
"""Mean and standard deviation of the force into the sensor besides the weight, and standard
deviation of each force along it, N."""

TURN_NMM = 3.0
"""Standard deviation of the torque about the sensor's axis, N mm."""

CENTERING_N_PER_MM, FAR_MM = 0.3, 6.0
"""Stiffness of what keeps a body over the pad, N/mm, and distance from its start from which it is
put back, mm."""

WARM_UP = 5
"""First reads of a scene, which do not count."""


GAP_M = 5e-5
"""Height of a body's bounding box over the sensor's apex at the start, m."""


@dataclass(frozen=True)
class Body:
    """A geom that moves freely: its kind, size and place on the pad, mm."""

    kind: str
    size_mm: tuple[float, ...]
    place_mm: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Scene:
    """Bodies over a sensor. beside_mm: standard deviation of the place where a force presses, from
    the body's center."""

    bodies: tuple[Body, ...]
    beside_mm: float = 0.0


SCENES = {
    "pushed": Scene((Body("box", (5.0, 4.0, 4.0)),)),
    "tilted": Scene((Body("box", (5.0, 4.0, 4.0)),), beside_mm=4.0),
    "rolling": Scene((Body("cylinder", (4.0, 5.0)),), beside_mm=1.0),
    "several": Scene(
        (Body("box", (3.0, 2.5, 2.5), (-3.5, -2.0)), Body("sphere", (3.0,), (3.5, 3.0))),
        beside_mm=1.0,
    ),
}
"""Boxes that lie flat, boxes that stand on an edge or a corner too, a cylinder that stands and
falls over, and a box and a ball."""


def measure(options: Namespace) -> dict[str, Any]:
    scenes: dict[str, dict[str, Any]] = {}
    away: list[float] = []
    for sensor in options.sensors:
        for name in tqdm(SCENES, desc=str(sensor), unit="scene"):
            found, own = read_scene(sensor, name, options.seconds)
            scenes.setdefault(str(sensor), {})[name] = found
            away += own
    return {"scenes": scenes, "without_contact_ms": float(np.median(away)) if away else None}


def read_scene(sensor: str, name: str, seconds: float) -> tuple[dict[str, Any], list[float]]:
    """Figures of a scene's reads in contact, and the times of those without contact, ms."""
    reasons = Counter[str]()
    times: list[float] = []
    away: list[float] = []
    tally: Counter[str] = Counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", T2TwinWarning)
        for number, (attached, model, data) in enumerate(states(sensor, name, seconds)):
            start = time.thread_time()
            touch = attached.read(model, data)
            spent_ms = 1e3 * (time.thread_time() - start)
            if number < WARM_UP:
                gc.freeze()  # as the documents advise for a loop
                continue
            contact = next(iter(touch.contacts.values()), None)
            (away if contact is None else times).append(spent_ms)
            tally["unsettled"] += contact is not None and not contact.settled
            reasons.update(each.reason for each in touch.notices)
    found = {
        "reads": len(times),
        "median_ms": float(np.median(times)),
        "p99_ms": float(np.percentile(times, 99)),
        "worst_ms": max(times),
        "unsettled": tally["unsettled"],
        "reasons": dict(reasons),
    }
    return found, away


def states(sensor: str, name: str, seconds: float) -> Iterator[tuple[Any, Any, Any]]:
    """The attached sensor, the model and the data of a scene in each frame."""
    scene = SCENES[name]
    attached, model, data = compile_scene(sensor, scene.bodies)
    rng = np.random.default_rng((list(SCENES).index(name), 57))
    frames = round(seconds * FRAME_HZ)
    start, steps = data.qpos.copy(), round(1 / FRAME_HZ / model.opt.timestep)
    bodies = [model.body(f"body-{number}").id for number in range(len(scene.bodies))]
    home = data.xpos[bodies].copy()
    state = rng.normal(size=(len(bodies), 6))
    keeps = float(np.exp(-model.opt.timestep / CHANGE_S))
    for _ in range(frames):
        for _ in range(steps):
            # An Ornstein-Uhlenbeck process: forces with a mean, a deviation and a time of change.
            state = keeps * state + np.sqrt(1 - keeps**2) * rng.normal(size=state.shape)
            _push(data, bodies, home, state, scene.beside_mm)
            mujoco.mj_step(model, data)
        away_mm = 1e3 * np.abs(data.xpos[bodies] - home)[:, :2].max()
        if away_mm > FAR_MM or (data.xpos[bodies, 2] < home[:, 2] - 0.01).any():
            data.qpos[:], data.qvel[:] = start, 0.0
        mujoco.mj_forward(model, data)
        yield attached, model, data


def compile_scene(sensor: str, bodies: tuple[Body, ...]) -> tuple[Any, Any, Any]:
    """A sensor on a pedestal, and body-0 and so on, face down and GAP_M above its apex."""
    spec = mujoco.MjSpec()
    spec.option.gravity = [0.0, 0.0, -GRAVITY]
    spec.option.cone, spec.option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, 10
    spec.worldbody.add_body(name="pedestal").add_site(name="pad")
    for number, body in enumerate(bodies):
        x, y = body.place_mm
        added = spec.worldbody.add_body(
            name=f"body-{number}", pos=[1e-3 * x, 1e-3 * y, 0.1], quat=[0.0, 1.0, 0.0, 0.0]
        )
        kind = getattr(mujoco.mjtGeom, f"mjGEOM_{body.kind.upper()}")
        size = [1e-3 * each for each in (*body.size_mm, 0.0, 0.0)][:3]
        added.add_geom(name=f"body-{number}-0", type=kind, size=size, mass=MASS_KG)
        added.add_freejoint()
    attached = t2twin.attach(spec, site="pad", sensor=sensor)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    level = attached.pose(model, data)[2, 3] + GAP_M
    for joint, body in enumerate(model.jnt_bodyid):
        geom = int(np.flatnonzero(model.geom_bodyid == body)[0])
        turn = data.geom_xmat[geom].reshape(3, 3)
        center, half = np.split(model.geom_aabb[geom], 2)
        lowest = data.geom_xpos[geom, 2] + turn[2] @ center - np.abs(turn[2]) @ half
        data.qpos[model.jnt_qposadr[joint] + 2] += level - lowest
    mujoco.mj_forward(model, data)
    return attached, model, data


def _push(
    data: "mujoco.MjData", bodies: list[int], home: np.ndarray, state: np.ndarray, beside_mm: float
) -> None:
    """Set the forces and torques on bodies from six normal random numbers each."""
    for body, at, numbers in zip(bodies, home, state, strict=True):
        mean, deviation = PRESS_N
        pressing = max(mean + deviation * numbers[2], -0.5)
        back = -1e3 * CENTERING_N_PER_MM * (data.xpos[body, :2] - at[:2])
        along = PUSH_N * numbers[:2] + back
        beside = beside_mm * numbers[3:5]
        data.xfrc_applied[body, :2], data.xfrc_applied[body, 2] = along, -pressing
        # The torque of a force at a distance, N m.
        data.xfrc_applied[body, 3] = -1e-3 * beside[1] * pressing
        data.xfrc_applied[body, 4] = 1e-3 * beside[0] * pressing
        data.xfrc_applied[body, 5] = 1e-3 * TURN_NMM * numbers[5]
