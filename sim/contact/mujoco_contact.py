"""What MuJoCo solves in every press: the soft contact of a rigid shape with the pins of a layer.

Each pin is a ball on a vertical slide joint with a spring. The shape is one body on a vertical
slide joint, pushed with the commanded force; it has one ball above each pin, which touches that pin
alone and without friction. docs/explanation/contact.md has the equations. Units: mm, s, and the
force that compresses an unstiffened pin's spring by 1 mm, so that one compiled model serves every
elastomer and pitch. The `discrete` integrator is implicit in position: with almost no mass one step
reaches the equilibrium.
"""

# MuJoCo defines its names at import, where pyright does not find them.
# pyright: reportAttributeAccessIssue=false

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from threading import Lock, get_ident

import mujoco
import numpy as np

from t2twin.core.cache_dir import cache_dir, short_digest, write_once
from t2twin.core.errors import T2TwinError
from t2twin.core.jit import compiled
from t2twin.core.machine import trim_memory
from t2twin.sim.contact.solver_loops import spring_depth

# Radius of the balls, mm: more than the penetration in any step. Neighboring balls may overlap, as
# each touches only its partner.
BALL_MM = 1.0
# Overlap of every pin with its partner at the start of a step, mm, so that no contact is missed.
# The equilibrium does not depend on where the pins start.
TOUCH_MM = 1e-3
# MuJoCo's solimp and solref of the contacts: nearly rigid, and closed within a step of 1 s.
IMPEDANCE, CONTACT_S = 0.9999, 1e-3
# Part of the overlap that the `discrete` integrator closes in a step of 1 s, mm.
CLOSING_MM = TOUCH_MM / (1 + IMPEDANCE * CONTACT_S) ** 2
# Mass of a pin over its stiffness x step^2: small, so that it is at rest after one step.
PIN_MASS = 1e-5
# Mass of the shape over one pin's stiffness x step^2: on more than a few pins it reaches the
# equilibrium in one or two steps, and its contact stays stiff.
SHAPE_MASS = 10.0
# Numbers of pins for which a model is compiled; a press uses the smallest that fits.
POOL_SIZES = (
    128, 192, 256, 384, 512, 768, 1024, 1280, 1536, 2048, 3072, 4096, 6144, 8192, 12288, 16384,
    24576,
)  # fmt: skip
MIN_CACHED_PINS = 1024  # compiled models with at least this number of pins are cached on disk
# Models of up to this number of pins are prepared for attached sensors (assumed: boxes, balls and
# cylinders on both bundled elastomers need up to 3,500).
PREPARED_PINS = 4096
IDLE_PINS = 20480  # of a thread's idle models, 8 kB each: contacts of most sizes need no more
PARKED_MM = 1.0e4  # height of the shape's ball above an unused pin, mm
# Pins that are read at once, to be attached to the others: MuJoCo's time to read bodies grows with
# the square of their number.
BLOCK_PINS = 512

HEAD = f"""<mujoco model="press">
  <option timestep="1" integrator="discrete" solver="Newton" gravity="0 0 0" tolerance="1e-10">
    <flag refsafe="disable" island="disable" sensor="disable" actuation="disable"/>
  </option>
  <default>
    <geom type="sphere" size="{BALL_MM:g}" mass="{PIN_MASS:g}" contype="0" conaffinity="0"/>
    <pair condim="1" solref="{CONTACT_S:g} 1" solimp="{IMPEDANCE} {IMPEDANCE} 0.001 0.5 2"/>
    <default class="pin"><joint type="slide" axis="0 0 1" stiffness="1"/></default>
  </default>
"""


def _shape_mjcf(pins: int) -> str:
    """The shape with a ball above each pin, as MJCF text."""
    balls = "".join(
        f'<geom name="over{i}" pos="{0.01 * (i + 1):g} 0 {PARKED_MM:g}"/>' for i in range(pins)
    )
    return f"""{HEAD}<size memory="{max(16, pins // 16)}M"/>
  <worldbody>
    <body name="shape"><inertial pos="0 0 0" mass="{SHAPE_MASS:g}" diaginertia="1 1 1"/>
      <joint name="down" type="slide" axis="0 0 1"/>{balls}</body>
  </worldbody>
</mujoco>"""


def _pins_mjcf(numbers: range) -> str:
    """Pins with their balls, as MJCF text."""
    bodies = "".join(
        f'<body pos="{0.01 * (i + 1):g} 0 {-BALL_MM:g}"><joint class="pin"/>'
        f'<geom name="tip{i}"/></body>'
        for i in numbers
    )
    return f"{HEAD}<worldbody>{bodies}</worldbody></mujoco>"


def _compile(pins: int) -> mujoco.MjModel:
    """The shape first, so that the solver's factorization stays sparse."""
    whole = mujoco.MjSpec.from_string(_shape_mjcf(pins))
    for start in range(0, pins, BLOCK_PINS):
        numbers = range(start, min(start + BLOCK_PINS, pins))
        block = mujoco.MjSpec.from_string(_pins_mjcf(numbers))
        block.memory = whole.memory  # else MuJoCo warns that they differ
        whole.attach(block, prefix=f"{start}/", frame=whole.worldbody.add_frame())
        for i in numbers:
            whole.add_pair(geomname1=f"over{i}", geomname2=f"{start}/tip{i}")
    return whole.compile()


def _model(pins: int) -> mujoco.MjModel:
    """The compiled model; large ones, which take up to half a minute, are cached on disk."""
    folder = cache_dir() if pins >= MIN_CACHED_PINS else None
    if folder is None:
        return _compile(pins)
    text = f"mjb {mujoco.__version__} {BLOCK_PINS} {_shape_mjcf(1)} {_pins_mjcf(range(1))}"
    path = folder / "mujoco" / f"{pins}-{short_digest(text.encode())}.mjb"
    if path.is_file():
        return mujoco.MjModel.from_binary_path(str(path))
    model = _compile(pins)
    with suppress(T2TwinError):  # a full disk: it is compiled the next time too
        content = np.empty(mujoco.mj_sizeModel(model), np.uint8)
        mujoco.mj_saveModel(model, None, content)
        write_once(path, lambda file: file.write(content.data))
        for older in set(path.parent.glob(f"{pins}-*.mjb")) - {path}:
            older.unlink(missing_ok=True)
    trim_memory()  # compiling frees twice the memory of the model
    return model


@compiled(nogil=True)
def _set_up(gap, depth, force, rest, stiffness, heights, springs, rests, places, motion):
    """Write the state before a step, and the expected motion upwards in it; see `step`."""
    # A contact is a spring too, by IMPEDANCE stiffer than its bodies, and in a step of 1 s a mass
    # acts as a spring.
    size = gap.size
    meets, stiff = np.empty(size + 1), np.empty(size + 1)
    for n in range(size):
        heights[n], springs[n + 1], rests[n + 1] = gap[n] + BALL_MM, stiffness[n], -rest[n]
        places[n + 1] = gap[n] - (depth - TOUCH_MM)
        own = 1.0 / (stiffness[n] + PIN_MASS)
        motion[n + 1] = (-rest[n] - places[n + 1]) * stiffness[n] * own  # without contact
        meets[n] = -CLOSING_MM - motion[n + 1]
        stiff[n] = 1.0 / (own + (1.0 / IMPEDANCE - 1.0) * (own + 1.0 / SHAPE_MASS))
    for n in range(size, heights.size):
        heights[n], springs[n + 1], rests[n + 1] = PARKED_MM, 1.0, 0.0
        places[n + 1] = motion[n + 1] = 0.0
    meets[size], stiff[size] = 0.0, SHAPE_MASS
    sinks = spring_depth(force, meets, stiff, np.inf)
    places[0], motion[0] = -depth, -sinks
    for n in range(size):
        carried = max(sinks - meets[n], 0.0) * stiff[n]
        motion[n + 1] -= carried / (stiffness[n] + PIN_MASS)


class MujocoPins:
    """A compiled model of a fixed number of pins."""

    def __init__(self, pins: int) -> None:
        self.pins = pins
        self.model = _model(pins)
        self.data = mujoco.MjData(self.model)
        self.model.qpos_spring[0] = 0.0
        self._state = (
            self.model.geom_pos[:pins, 2],
            self.model.jnt_stiffness,
            self.model.qpos_spring,
            self.data.qpos,
            self.data.qacc_warmstart,
        )
        self._force, self._speed = self.data.qfrc_applied, self.data.qvel

    def step(
        self, gap_mm: np.ndarray, depth_mm: float, force: float, spring_rest_mm: np.ndarray,
        stiffness: np.ndarray,
    ) -> tuple[float, np.ndarray]:  # fmt: skip
        """One step to the equilibrium of n <= pins pins under a force, in units of a pin's spring x
        mm: the shape's depth, mm, and the pins' deflections, (n,), mm.

        gap_mm: (n,) distance of each pin from the shape at first touch. depth_mm: the expected
        depth. spring_rest_mm, stiffness: (n,) of the springs, mm, and in units of a pin's spring.
        """
        _set_up(gap_mm, depth_mm, force, spring_rest_mm, stiffness, *self._state)
        self._force[0], self._speed[:] = -force, 0.0
        mujoco.mj_step(self.model, self.data)
        places = self._state[3]
        return -float(places[0]), -places[1 : gap_mm.size + 1]


_log = mujoco.MjLogConfig.get()
_log.logto_file = False  # else a warning writes MUJOCO_LOG.TXT to the working directory
_log.logto_console = False  # the solver handles a step that diverges
_log.set()

# The idle models, the last used at the end: to compile or load one takes longer than a press.
_idle: list[MujocoPins] = []
_lock, _threads = Lock(), set[int]()  # _threads: those that ever borrowed a model


@contextmanager
def borrowed_pins(pins: int) -> Iterator[MujocoPins]:
    """A compiled model with at least this number of pins, which no other thread uses meanwhile."""
    size = next((size for size in POOL_SIZES if size >= pins), None)
    if size is None:
        raise T2TwinError(
            f"the contact covers more than {POOL_SIZES[-1]} grid cells; take a coarser grid"
        )
    with _lock:
        _threads.add(get_ident())
        model = next((each for each in _idle if each.pins == size), None)
        if model is not None:
            _idle.remove(model)
        most = IDLE_PINS * len(_threads) - size
        while model is None and _idle and sum(each.pins for each in _idle) > most:
            del _idle[0]
    model = model or MujocoPins(size)
    try:
        yield model
    finally:
        _idle.append(model)


def prepare_models() -> None:
    """Compile or load the models of ordinary contacts: up to 1 s, so that no contact waits."""
    for size in POOL_SIZES[: POOL_SIZES.index(PREPARED_PINS) + 1]:
        with borrowed_pins(size):
            pass
