"""A sensor that is attached to a MuJoCo model.

The sensor frame has its origin at the apex of the undeformed surface. x is to the right in the
DIGIT's image, y is down, z is out of the sensor.
"""

# MuJoCo defines its names at import, where pyright does not find them.
# pyright: reportAttributeAccessIssue=false

from dataclasses import dataclass, field, replace
from math import floor, inf
from threading import Lock
from typing import Literal, get_args
from weakref import WeakKeyDictionary

import mujoco
import numpy as np
from trimesh import Trimesh

from t2twin.attachment.contacts import Pose, Wrench, relative_motion, wrenches
from t2twin.attachment.geometry import Geometry, Region, body_surface
from t2twin.attachment.stiffness import fit_stiffness
from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad.shape import NOTHING_MM, HeightMap, Shape
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.loads.carry import carry
from t2twin.sim.contact.loads.prescribed import Load
from t2twin.sim.contact.pin_layout import OffPadError
from t2twin.sim.contact.sliding import MAX_FRICTION
from t2twin.sim.contact.types import FORCE_RANGE_N, Contact, PressCommand
from t2twin.sim.sensors import CySkin, Digit
from t2twin.sim.touch import Touch

SensorName = Literal["digit", "cyskin"]

BODY, SURFACE, FRAME = "body", "surface", "frame"
"""Names of a sensor's elements in the model, after the sensor's name and a slash."""

NOTHING = Shape(
    "nothing",
    Trimesh(),
    HeightMap(np.full((2, 2), NOTHING_MM, np.float32), np.array([0.0, 1.0]), np.array([0.0, 1.0])),
    (1.0, 1.0),
)
"""The shape of a touch without contact."""

MAX_RATE_HZ = 1e6
"""Largest rate of readings, Hz (assumed: beyond any simulation's steps)."""

OWN_SOLMIX = 1e6
"""Weight of the contact parameters of a sensor's geom with `set_stiffness`; others have 1."""

MAX_FORCE_N = 0.9999 * FORCE_RANGE_N[1]
"""Largest force of all bodies together, N: below the limit on a press by more than rounding."""

MAX_JUMP_MM = 2.0
"""Distance between the places of contact in two readings up to which the second one continues the
tractions of the first, mm (assumed: less than most contacts are wide)."""

ROUNDING = 1e-6
"""Share of a period by which a reading may be early, for rounding errors of the time."""


@dataclass
class _State:
    """What a sensor has read from one MjData.

    time_s, period: of the last reading. reads: their number. seen: the poses and forces, as bytes.
    touch, touch_s: the last touch and its time. poses, centers_mm: of the touching bodies and of
    their places of contact, in the sensor frame, by the body's id.
    """

    time_s: float = -inf
    period: int = -1
    reads: int = 0
    seen: bytes = b""
    poses: dict[int, Pose] = field(default_factory=dict)
    centers_mm: dict[int, np.ndarray] = field(default_factory=dict)
    touch: Touch | None = None
    touch_s: float = 0.0


class AttachedSensor:
    """A DIGIT or a CySkin in a MuJoCo model, made by `t2twin.attach`.

    name: prefix of its elements in the model. sensor: "digit" or "cyskin". device: the simulated
    sensor. geometry, rate_hz, seed: as for `attach`.
    Several threads may use one sensor at the same time.
    Under MUJOCO_GL=egl, MuJoCo cannot be imported with PyOpenGL 3.1.0, which pyrender requires. Run
    `pip install --no-deps PyOpenGL==3.1.10`. Images of the sensor need no OpenGL.
    Raises T2TwinError for invalid arguments.
    """

    def __init__(
        self,
        name: str,
        sensor: SensorName,
        device: Digit | CySkin,
        geometry: Geometry = "collision",
        rate_hz: float | None = None,
        seed: int | None = None,
    ) -> None:
        arguments.choice(geometry, "geometry", get_args(Geometry))
        if rate_hz is not None:
            rate_hz = arguments.number(rate_hz, "rate_hz", 1 / MAX_RATE_HZ, MAX_RATE_HZ)
        if seed is not None:
            arguments.check_seed(seed)
        self.name, self.sensor, self.device = name, sensor, device
        self.geometry: Geometry = geometry
        self.rate_hz, self.seed = rate_hz, seed
        self._states: WeakKeyDictionary[object, _State] = WeakKeyDictionary()
        self._lock = Lock()

    @property
    def elastomer(self) -> Elastomer:
        """The DIGIT's gel or the CySkin's cover."""
        device = self.device
        return device.elastomer if isinstance(device, Digit) else device.cover

    def reset(self) -> None:
        """Forget all contacts and readings; the next reading is the first one."""
        with self._lock:
            self._states.clear()

    def pose(self, model: "mujoco.MjModel", data: "mujoco.MjData") -> np.ndarray:
        """(4, 4) transform from the sensor frame to the world, m. Raises T2TwinError as `read`."""
        return self._frame(model, data).matrix

    def read(self, model: "mujoco.MjModel", data: "mujoco.MjData") -> Touch:
        """The touch in the current state of a simulation, which does not change.

        model: compiled from the spec of `attach`. data: after `mj_step`, `mj_step1` and 2, or
        `mj_forward`, which compute the contact forces. Contacts and poses are those at the
        beginning of the last step, as for MuJoCo's own sensors.
        The touch has the fields of this sensor, and None for the other's. `sensor_to_world` is the
        sensor's pose. A body that presses with less than 0.01 N is left out, and all together press
        with at most 100 N. An unchanged state gives the same touch again, as does each state before
        the next period of `rate_hz`. The tangential tractions continue those of the last reading of
        the same MjData, until its time decreases.
        Raises T2TwinError for another model or data, and for a flex that touches the sensor.
        """
        frame = self._frame(model, data)
        with self._lock:
            return self._read(model, data, frame)

    def set_stiffness(self, model: "mujoco.MjModel", data: "mujoco.MjData", body: str) -> float:
        """Let a body sink into the sensor as deep in MuJoCo as into the soft layer.

        Sets `geom_solref`, `geom_solimp` and `geom_solmix` of the sensor's geom in the model, for a
        body that touches it at one point in its present pose over the sensor. data: as for `read`.
        Friction cones must be elliptic. Several contact points share a force and sink in less.
        Returns the largest error of the depth at rest from 0.5 to 12 N, mm.
        Raises T2TwinError for an unknown body, one that is not over the sensor, and as `read`.
        """
        frame = self._frame(model, data)
        touching = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, arguments.text(body, "body"))
        if touching < 0:
            raise T2TwinError(f"the model has no body {body!r}; expected the name of a body")
        shape = self._shape(model, data, frame, touching)
        if shape is None:
            raise T2TwinError(f"body {body} is not over {self.name}; move it there first")
        if model.opt.cone != mujoco.mjtCone.mjCONE_ELLIPTIC:
            raise T2TwinError("the model has pyramidal friction cones; expected elliptic ones")
        geom = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, f"{self.name}/{SURFACE}")
        bodies = [touching, model.geom_bodyid[geom]]
        inverse_mass = float(model.body_invweight0[bodies, 0].sum())
        found = fit_stiffness(shape, self.elastomer, self.device.pitch_mm, inverse_mass)
        model.geom_solref[geom], model.geom_solimp[geom] = found.solref, found.solimp
        model.geom_solmix[geom] = OWN_SOLMIX
        return found.error_mm

    def _read(self, model: "mujoco.MjModel", data: "mujoco.MjData", frame: Pose) -> Touch:
        state = self._states.setdefault(data, _State())
        if data.time < state.time_s:
            state = self._states[data] = _State(reads=state.reads)
        state.time_s = data.time
        period = 0 if self.rate_hz is None else floor(data.time * self.rate_hz + ROUNDING)
        if self.rate_hz is not None and state.touch is not None and period == state.period:
            return state.touch
        geom = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, f"{self.name}/{SURFACE}")
        pressing = [
            each
            for each in wrenches(model, data, geom, frame)
            if each.pressing_n >= FORCE_RANGE_N[0]
        ]
        poses = {each.body: _body_pose(data, each.body).in_frame(frame) for each in pressing}
        seen = _as_bytes(data.time, frame, pressing, poses)
        if state.touch is None or seen != state.seen:
            contact = self._contact(model, data, frame, pressing, poses, state)
            state.touch = self._touch(contact, frame, state, data.time)
            state.touch_s = data.time
            state.poses, state.seen = poses, seen
            state.centers_mm = {each.body: each.center_mm for each in pressing}
            state.reads += 1
        state.period = period
        return state.touch

    def _contact(
        self,
        model: "mujoco.MjModel",
        data: "mujoco.MjData",
        frame: Pose,
        pressing: list[Wrench],
        poses: dict[int, Pose],
        state: _State,
    ) -> Contact | None:
        """The contact of the pressing bodies, which continues the state's last one."""
        limit = MAX_FORCE_N / max(sum(each.pressing_n for each in pressing), MAX_FORCE_N)
        near = {each.body for each in pressing if _is_near(each, state.centers_mm)}
        loads = []
        for each in pressing:
            shape = self._shape(model, data, frame, each.body)
            if shape is not None:
                load = Load(
                    shape=shape,
                    force_n=max(limit * each.pressing_n, FORCE_RANGE_N[0]),
                    shear_n=(float(each.force_n[0]), float(each.force_n[1])),
                    torque_nmm=float(each.torque_nmm[2]),
                    motion=relative_motion(
                        state.poses.get(each.body), poses[each.body], each.center_mm
                    )
                    if each.body in near or len(pressing) == 1
                    else None,
                    friction=min(each.friction, MAX_FRICTION),
                )
                loads.append(load)
        before = state.touch.contacts.get(self.sensor) if state.touch and near else None
        return self._solve(loads, before)

    def _solve(self, loads: list[Load], before: Contact | None) -> Contact | None:
        """The contact of loads, without those that are not over the pad."""
        if not loads:
            return None
        try:
            return carry(self.elastomer, self.device.pitch_mm, loads, before)
        except OffPadError as error:
            return self._solve([load for load in loads if load.shape.name != error.shape], before)

    def _shape(
        self, model: "mujoco.MjModel", data: "mujoco.MjData", frame: Pose, body: int
    ) -> Shape | None:
        """The surface of a body over the sensor; None without any."""
        found = body_surface(model, data, body, *frame, Region.of(self.elastomer), self.geometry)
        if found is None:
            return None
        name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, body) or f"body {body}"
        return replace(NOTHING, name=name, surface=found.surface)

    def _touch(self, contact: Contact | None, frame: Pose, state: _State, time_s: float) -> Touch:
        """The touch of a contact at a time; its noise depends on the number of earlier readings."""
        rng = None if self.seed is None else np.random.default_rng((self.seed, state.reads))
        device, command = self.device, PressCommand(NOTHING.name, 0.0, 0.0, 0.0, 0.0)
        shape = NOTHING if contact is None else contact.shape
        common = {"shape": shape, "command": contact.command if contact else command}
        if isinstance(device, Digit):
            return Touch(
                **common,
                image=device.image(contact, rng),
                counts=None,
                digit=contact,
                cyskin=None,
                layout=None,
                calibration=device.calibration,
                markers=device.markers,
                sensor_to_world=frame.matrix,
            )
        counts, memory = device.read(contact, rng, state.touch, time_s - state.touch_s)
        return Touch(
            **common,
            image=None,
            counts=counts,
            digit=None,
            cyskin=contact,
            layout=device.layout,
            sensor_to_world=frame.matrix,
            memory=memory,
        )

    def _frame(self, model: "mujoco.MjModel", data: "mujoco.MjData") -> Pose:
        """The sensor frame. Raises T2TwinError for a model or data that cannot be read."""
        for value, name, kind in (
            (model, "model", mujoco.MjModel),
            (data, "data", mujoco.MjData),
        ):
            if not isinstance(value, kind):
                raise T2TwinError(
                    f"{name} is {arguments.describe(value)}; expected a mujoco.{kind.__name__} "
                    "(mjx.get_data copies a state of MJX into one)"
                )
        if model.signature != data.signature:
            raise T2TwinError("data is of another model; expected a mujoco.MjData of this model")
        site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, f"{self.name}/{FRAME}")
        if site < 0:
            raise T2TwinError(
                f"the model has no site {self.name}/{FRAME}; expected a model compiled from the "
                f"spec to which {self.name} was attached"
            )
        rotation = data.site_xmat[site].reshape(3, 3).copy()
        if not rotation.any():
            raise T2TwinError(
                "data has no poses yet; call mujoco.mj_forward(model, data) before the first read"
            )
        return Pose(rotation, data.site_xpos[site].copy())


def _is_near(wrench: Wrench, centers_mm: dict[int, np.ndarray]) -> bool:
    """Whether a body touched the sensor before, within MAX_JUMP_MM of where it does now."""
    before = centers_mm.get(wrench.body)
    return before is not None and bool(np.hypot(*(wrench.center_mm - before)[:2]) <= MAX_JUMP_MM)


def _body_pose(data: "mujoco.MjData", body: int) -> Pose:
    return Pose(data.xmat[body].reshape(3, 3).copy(), data.xpos[body].copy())


def _as_bytes(time_s: float, frame: Pose, pressing: list[Wrench], poses: dict[int, Pose]) -> bytes:
    """All that a reading depends on."""
    values = [np.array([time_s]), frame.rotation.ravel(), frame.position_m]
    for each in pressing:
        pose = poses[each.body]
        values += [np.array([each.body, each.friction]), each.force_n, each.torque_nmm]
        values += [pose.rotation.ravel(), pose.position_m]
    return np.concatenate(values).tobytes()
