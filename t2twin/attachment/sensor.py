"""A sensor that is attached to a MuJoCo model.

The sensor frame has its origin at the apex of the undeformed surface. x is to the right in the
image, y is down, z is out of the sensor.
"""

# MuJoCo defines its names at import, where pyright does not find them.
# pyright: reportAttributeAccessIssue=false

import warnings
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from math import floor, inf
from threading import Lock
from typing import Any, get_args
from weakref import WeakKeyDictionary

import mujoco
import numpy as np
from trimesh import Trimesh

from t2twin.attachment.contacts import (
    LIGHT,
    Body,
    Place,
    Pose,
    body_pose,
    check_state,
    contact_forces,
    find_elements,
    frame_of,
    loaded_contact,
    relative_motion,
    silent_notices,
    sleeping_forces,
    unread_notices,
    without_contact,
)
from t2twin.attachment.geometry import Geometry, Region, body_surface
from t2twin.core import arguments
from t2twin.core.errors import T2TwinError, T2TwinWarning
from t2twin.core.machine import cores
from t2twin.primitives_cad.shape import NOTHING_MM, HeightMap, Shape
from t2twin.sim.contact.contact_solver import solve_contact
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.types import FORCE_RANGE_N, PressCommand
from t2twin.sim.sensors.files import Sensor
from t2twin.sim.touch import Touch

# The shape of a touch without contact.
NO_MAP = HeightMap(np.full((2, 2), NOTHING_MM, np.float32), np.arange(2.0), np.arange(2.0))
NOTHING = Shape("nothing", Trimesh(), NO_MAP, (1.0, 1.0))
# A touch without contact and without readings.
NO_TOUCH = Touch(NOTHING, PressCommand(NOTHING.name, 0.0, 0.0, 0.0, 0.0))
MAX_RATE_HZ = 1e6  # largest rate of readings, Hz (assumed: beyond any simulation's steps)
MAX_WORKERS = 1024  # largest number of threads of read_all (assumed: beyond any machine's cores)
# Distance between the places of contact in two readings up to which the second one continues the
# tractions of the first, mm (assumed: less than most contacts are wide).
MAX_JUMP_MM = 2.0
# Share of a period by which a reading may be early, for rounding errors of the time.
ROUNDING = 1e-6
AWAKE = 1  # MuJoCo's mjS_AWAKE
# Forces at which the depths are fitted, N: those of most grasps (assumed).
FIT_FORCES_N = (0.5, 1.0, 2.0, 4.0, 8.0, 12.0)
MIDPOINT = 0.5  # muJoCo's default midpoint of the impedance
# Limits of the impedance (assumed). A low one also lets bodies creep against friction.
IMPEDANCE = (0.5, 0.98)
MAX_POWER = 6.0  # largest power of the impedance's curve (assumed)
POINTS = 400  # points of a force curve


@dataclass
class State:
    """The last reading of a sensor from one MjData."""

    time_s: float = -inf
    period: int = -1
    reads: int = 0  # number of readings
    seen: bytes = b""  # the state of the simulation
    # Of the bodies that press, by number: pose and place of contact, (3,) mm, in the sensor frame.
    places: dict[int, tuple[Pose, np.ndarray]] = field(default_factory=dict)
    touch: Touch | None = None  # the last one
    touch_s: float = 0.0
    asleep: bytes = b""  # the poses of bodies that sleep
    sleeping: list[Body] = field(default_factory=list)  # these bodies
    lock: Lock = field(default_factory=Lock)  # of one reading at a time

    def bodies(self, at: Place) -> list[Body]:
        """The bodies that act on a sensor's geom; what those that sleep do is found once."""
        touching, data = contact_forces(at), at.data
        still = data.body_awake != AWAKE
        if data.nbody_awake == at.model.nbody or not still[at.model.geom_bodyid[at.geom]]:
            return touching
        asleep = b"".join(each.tobytes() for each in (still, data.xpos[still], *at.frame))
        if asleep != self.asleep:
            self.asleep, self.sleeping = asleep, sleeping_forces(at, still)
        sleeping = [replace(each, unread_n=dict(each.unread_n)) for each in self.sleeping]
        return sorted(touching + sleeping, key=lambda each: each.number)


class AttachedSensor:
    """A gel camera or a taxel array in a MuJoCo model, made by `t2twin.attach`.

    name: prefix of its elements in the model. sensor: its name in a touch. device: the simulated
    sensor. geometry, rate_hz, seed: as for `attach`. suffix: of the elements' names.
    Several threads may use one sensor at the same time.
    Under MUJOCO_GL=egl, import t2twin before mujoco, whose import fails with pyrender's PyOpenGL.
    Raises T2TwinError for invalid arguments.
    """

    def __init__(
        self,
        name: str,
        device: Sensor,
        geometry: Geometry = "collision",
        rate_hz: float | None = None,
        seed: int | None = None,
        suffix: str = "",
    ) -> None:
        arguments.choice(geometry, "geometry", get_args(Geometry))
        if rate_hz is not None:
            rate_hz = arguments.number(rate_hz, "rate_hz", 1 / MAX_RATE_HZ, MAX_RATE_HZ)
        if seed is not None:
            arguments.check_seed(seed)
        self.name, self.device = name, device
        self.geometry: Geometry = geometry
        self.rate_hz, self.seed = rate_hz, seed
        self.suffix = arguments.text(suffix, "suffix")
        self._states: WeakKeyDictionary[object, State] = WeakKeyDictionary()
        self._elements: WeakKeyDictionary[object, tuple[int, int]] = WeakKeyDictionary()
        self._silent: WeakKeyDictionary[object, dict[int, str]] = WeakKeyDictionary()
        self._warned: dict[str, object] = {}
        self._lock = Lock()

    @property
    def sensor(self) -> str:
        """The sensor's name in a touch."""
        return self.device.name

    @property
    def elastomer(self) -> Elastomer:
        """The gel or the cover."""
        return self.device.elastomer

    @property
    def _made_of(self) -> tuple[Any, ...]:
        return self.device, self.geometry, self.rate_hz, self.seed

    def __reduce__(self) -> tuple[Any, ...]:
        """A copy has no readings."""
        return AttachedSensor, (self.name, *self._made_of, self.suffix)

    def with_prefix(self, prefix: str, suffix: str = "") -> "AttachedSensor":
        """The sensor of a model to which its spec was attached with this prefix and suffix.

        Needed only where the spec was attached several times. The new sensor has no readings.
        """
        name = f"{arguments.text(prefix, 'prefix')}{self.name}"
        return AttachedSensor(name, *self._made_of, suffix=suffix)

    def reset(self) -> None:
        """Forget all contacts and readings; the next reading is the first one."""
        with self._lock:
            self._states.clear()

    def pose(self, model: "mujoco.MjModel", data: "mujoco.MjData") -> np.ndarray:
        """(4, 4) transform from the sensor frame to the world, m. Raises T2TwinError as `read`."""
        return self._found(model, data).frame.matrix

    def read(self, model: "mujoco.MjModel", data: "mujoco.MjData") -> Touch:
        """The touch in the current state of a simulation, which does not change.

        model: compiled from the spec of `attach`, or from one to which that was attached. data:
        after `mj_step`, `mj_step1` and 2, or `mj_forward`, which compute the contact forces.
        Contacts and poses are those at the beginning of the last step, as for MuJoCo's own sensors.
        The touch has the reading of this sensor alone. `sensor_to_world` is the sensor's pose.
        `notices` has each force of MuJoCo's contacts that the contact lacks by more than 1 % and
        0.01 N, and each geom in the soft layer without a contact, with the reason. Each reason and
        each note of the touch is also a T2TwinWarning, once. An unchanged state gives the same
        touch again, as does each state before the next period of `rate_hz`. The tangential
        tractions continue those of the last reading of the same MjData, until its time decreases;
        call `reset` after mj_resetData.

        Raises T2TwinError for another model or data, for values that are not finite, and for a flex
        that touches the sensor.
        """
        at = self._found(model, data)
        with self._lock:
            state = self._states.setdefault(data, State())
        with state.lock:
            return self._read(at, state)

    def set_stiffness(self, model: "mujoco.MjModel", data: "mujoco.MjData", body: str) -> float:
        """Let a body sink into the sensor as deep in MuJoCo as into the soft layer.

        Sets `geom_solref` and `geom_solimp` of the sensor's geom in the model, for a body that
        touches it at one point in its present pose over the sensor. data: as for `read`.
        Friction cones must be elliptic. Several contact points share a force and sink in less; a
        warning says so for a body that already touches so.
        Returns the largest error of the depth at rest from 0.5 to 12 N, mm.
        Raises T2TwinError for an unknown body, one that is not over the sensor, and as `read`.
        """
        at = self._found(model, data)
        geom = at.geom
        touching = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, arguments.text(body, "body"))
        if touching < 0:
            raise T2TwinError(f"the model has no body {body!r}; expected the name of a body")
        shape = self._shape(at, touching, body)
        if shape is None:
            raise T2TwinError(f"body {body} is not over {self.name}; move it there first")
        if model.opt.cone != mujoco.mjtCone.mjCONE_ELLIPTIC:
            raise T2TwinError("the model has pyramidal friction cones; expected elliptic ones")
        of_body = model.geom_bodyid[data.contact.geom] == touching
        points = int((of_body.any(axis=1) & (data.contact.geom == geom).any(axis=1)).sum())
        if points > 1:
            self._warn(
                "points",
                f"body {body} touches at {points} points, but the fit is for one; the body sinks "
                "in less, and may bounce at time steps above 1 ms",
            )
        bodies = [touching, model.geom_bodyid[geom]]
        inverse_mass = float(model.body_invweight0[bodies, 0].sum())
        solref, solimp, error_mm = _fit_stiffness(
            shape, self.elastomer, self.device.pitch_mm, inverse_mass
        )
        model.geom_solref[geom], model.geom_solimp[geom] = solref, solimp
        return error_mm

    def _found(self, model: "mujoco.MjModel", data: "mujoco.MjData") -> Place:
        """The sensor in a state that can be read."""
        check_state(model, data)
        with self._lock:
            if model not in self._elements:
                self._elements[model] = find_elements(model, self.name, self.suffix)
            site, geom = self._elements[model]
        return Place(model, data, geom, frame_of(data, site))

    def _warn(self, cause: str, message: str) -> None:
        """Warn of a cause, once."""
        own = object()
        if self._warned.setdefault(cause, own) is own:
            warnings.warn(f"{self.name}: {message}", T2TwinWarning, stacklevel=4)

    def _read(self, at: Place, state: State) -> Touch:
        data, frame = at.data, at.frame
        if data.time < state.time_s:
            # Forget the readings, but not their number.
            vars(state).update(vars(State(reads=state.reads, lock=state.lock)))
        state.time_s = data.time
        period = 0 if self.rate_hz is None else floor(data.time * self.rate_hz + ROUNDING)
        is_due, state.period = self.rate_hz is None or period != state.period, period
        values = data.time, *frame, data.xpos, data.xmat, data.efc_force, data.contact.friction
        seen = b"".join(np.asarray(each).tobytes() for each in values)
        if state.touch is not None and (not is_due or seen == state.seen):
            return state.touch
        bodies, pressing, last = state.bodies(at), [], None
        for body in bodies:
            if body.pressing_n >= FORCE_RANGE_N[0]:
                pressing.append(body)
            elif body.weight_n:
                body.leave_unread(LIGHT, body.force_n)
        places = {}
        for body in pressing:
            pose, center_mm = body_pose(at, body.number), body.center_mm
            before, at_mm = state.places.get(body.number, (None, None))
            is_near = at_mm is not None and np.hypot(*(center_mm - at_mm)[:2]) <= MAX_JUMP_MM
            if is_near and state.touch is not None:
                last = state.touch.contacts.get(self.sensor)  # which the tractions continue
            if is_near or len(pressing) == 1:
                body.motion = relative_motion(before, pose, center_mm)
            body.shape = self._shape(at, body.number, body.name)
            places[body.number] = pose, center_mm
        contact, notices = loaded_contact(self.elastomer, self.device.pitch_mm, pressing, last)
        with self._lock:
            if at.model not in self._silent:
                self._silent[at.model] = without_contact(at, self.elastomer)
        silent = silent_notices(at, self._silent[at.model], self.elastomer)
        notices += unread_notices(bodies) + silent
        # The noise depends on the number of earlier readings.
        rng = None if self.seed is None else np.random.default_rng((self.seed, state.reads))
        reading: Any = None if state.touch is None else state.touch[self.sensor]
        reading = self.device.read(contact, rng, reading, data.time - state.touch_s)
        pressed, readings = contact or NO_TOUCH, {self.sensor: reading}
        pose = pressed.shape, pressed.command
        touch = Touch(*pose, readings, frame.matrix, tuple(notices))
        state.touch, state.touch_s, state.places, state.seen = touch, data.time, places, seen
        state.reads += 1
        for each in notices:
            self._warn(each.reason, str(each))
        reasons = "; ".join(each.reason for each in notices)
        for note in (each.removeprefix(f"{self.sensor}: ") for each in touch.notes):
            if note not in reasons:
                self._warn(note, note)
        return touch

    def _shape(self, at: Place, body: int, name: str) -> Shape | None:
        """The surface of a body over the sensor; None without any."""
        region = Region.of(self.elastomer)
        found = body_surface(at.model, at.data, body, *at.frame, region, self.geometry)
        return None if found is None else Shape(name, NOTHING.solid, found[0], (1.0, 1.0))


def read_all(
    sensors: AttachedSensor | Sequence[AttachedSensor],
    states: "Sequence[mujoco.MjData]",
    workers: int | None = None,
) -> list[list[Touch]]:
    """The touches of sensors in many states of simulations, which do not change.

    sensors: one or several, each in the models of all states. A sensor is found by its name, so
    that one serves all environments that are built in the same way. states: each the MjData of an
    environment, as for `AttachedSensor.read`. workers: threads; None for one per core.
    Returns for each state the touches of the sensors. They are those of `AttachedSensor.read`,
    whatever the number of workers.
    Raises T2TwinError for invalid arguments, and as `AttachedSensor.read`.
    """
    given = [sensors] if isinstance(sensors, AttachedSensor) else sensors
    chosen = arguments.objects(given, "sensors", AttachedSensor)
    states = arguments.objects(states, "states", mujoco.MjData)
    if len({id(each) for each in states}) < len(states):
        raise T2TwinError("states has the same MjData twice; expected one of each environment")
    if workers is not None:
        workers = arguments.whole_number(workers, "workers", 1, MAX_WORKERS)
    with ThreadPoolExecutor(workers or cores()) as pool:
        touches = [
            [pool.submit(sensor.read, state.model, state) for sensor in chosen] for state in states
        ]
    return [[each.result() for each in of_state] for of_state in touches]


def _fit_stiffness(
    shape: Shape, elastomer: Elastomer, pitch_mm: float, inverse_mass: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """MuJoCo's solref, (2,), and solimp, (5,), with which one contact point of a shape sinks in as
    deep as into an elastomer, and the largest difference of the depths, mm. inverse_mass: of both
    bodies, 1/kg.

    At rest, MuJoCo's force at a penetration r is stiffness d(r)^2 r / (d_w^2 (1 - d(r)) A), with
    the impedance d(r), d_w = d(width), and the inverse mass A. It follows from a + d (b v + k r) =
    (1 - d) a0 in MuJoCo's documentation, Modeling, Solver parameters, with a = 0. The damping is
    critical.
    """
    from scipy.optimize import least_squares  # slow to import

    if inverse_mass <= 0:
        raise T2TwinError(f"neither {shape.name} nor the sensor can move; expected a joint")
    forces = np.array(FIT_FORCES_N)
    commands = [PressCommand(shape.name, 0.0, 0.0, 0.0, force) for force in FIT_FORCES_N]
    depths_m = 1e-3 * np.array(
        [solve_contact(shape, command, elastomer, pitch_mm).depth_mm for command in commands]
    )
    width = depths_m[-1]
    grid = np.linspace(0.0, 1.5 * width, POINTS)

    def solved(unknowns: np.ndarray) -> np.ndarray:
        return np.interp(forces, _force_n(grid, unknowns, width, inverse_mass), grid)

    start = forces[-1] * inverse_mass / width, 0.6, 0.5, 2.0
    found = least_squares(
        lambda unknowns: (solved(unknowns) - depths_m) / width,
        [np.log(start[0]), *start[1:]],
        bounds=([-50.0, IMPEDANCE[0], 0.0, 1.0], [50.0, IMPEDANCE[1], 1.0, MAX_POWER]),
        x_scale=[1.0, 0.1, 0.1, 1.0],
    ).x
    log_stiffness, low, _, power = found
    return (
        np.array([-np.exp(log_stiffness), -2.0 * np.exp(log_stiffness / 2)]),
        np.array([low, _high(found), width, MIDPOINT, power]),
        float(1e3 * np.abs(solved(found) - depths_m).max()),
    )


def _force_n(
    penetration_m: np.ndarray, unknowns: np.ndarray, width_m: float, inverse_mass: float
) -> np.ndarray:
    """MuJoCo's force at rest, with log of stiffness, impedance, its rise and its power."""
    log_stiffness, low, _, power = unknowns
    high = _high(unknowns)
    share = np.minimum(penetration_m / width_m, 1.0)
    curve = np.where(
        share <= MIDPOINT,
        share**power / MIDPOINT ** (power - 1),
        1 - (1 - share) ** power / (1 - MIDPOINT) ** (power - 1),
    )
    impedance = low + (high - low) * curve
    per_m = np.exp(log_stiffness) * (impedance / high) ** 2 / (1 - impedance)
    return per_m * penetration_m / inverse_mass


def _high(unknowns: np.ndarray) -> float:
    """The impedance at the width."""
    return float(unknowns[1] + unknowns[2] * (IMPEDANCE[1] - unknowns[1]))
