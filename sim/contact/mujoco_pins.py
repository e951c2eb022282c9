"""The MuJoCo model of a press: a bed of sprung pins and a rigid shape on a slide.

Each grid cell of the elastomer that may be touched has one pin, a ball on a vertical slide joint
with a spring; the shape's pressing surface stands over it as one ball at the shape's height there.
The shape's balls are one body on a vertical slide joint, pushed with the commanded force. Each
pin can touch only the ball above it, without friction, so that contact forces are vertical and
the pin's and the shape's heights are all that matters: exact for normal contact, whatever the
shape's outline or slope.

Units inside the model: mm, s, and the force that presses an unstiffened pin's spring by 1 mm, so
that springs are about 1 and one compiled model serves every elastomer and pitch. The `discrete`
integrator is implicit in position, so with masses far below stiffness x step^2 a step lands on the
static equilibrium of springs and contact.
"""

# MuJoCo's Python module fills its names in at import, where pyright cannot see them.
# pyright: reportAttributeAccessIssue=false

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from threading import Lock

import mujoco
import numpy as np

from t2twin.core.cache_dir import cache_home
from t2twin.core.cached_files import read_checked, write_checked
from t2twin.core.errors import T2TwinError

BALL_MM = 1.0
"""Radius of pins' and shape's balls, mm; more than any step's penetration. Balls of neighbors
may overlap, for each touches only its own partner."""

TOUCH_MM = 1e-3
"""Overlap with which every pin meets its partner at the start of a step, mm. A step ends at the
equilibrium wherever its pins start, and so no contact can be missed."""

PIN_MASS = 1e-5
"""Mass of a pin over its stiffness x step^2: small, so that it has stopped after a step."""

SHAPE_MASS = 10.0
"""The shape's mass over one pin's stiffness x step^2: it follows within a step or two once it
stands on more than a few pins, and its contact stays stiff."""

POOL_SIZES = (128, 192, 256, 384, 512, 768, 1024, 1280, 1536, 2048, 3072, 4096, 6144, 8192)
"""Numbers of pins for which a model is compiled; a press takes the smallest that fits."""

MIN_KEPT = 1024
"""Pins from which on a compiled model is kept."""

DIGITS = 16
"""Hexadecimal digits of a kept model's name, 64 bits: no two will share one."""

PARKED_MM = 1.0e4
"""Height at which the shape's ball over an unused pin is kept, mm."""


def mjcf(pins: int) -> str:
    """The bed as MJCF text: shape first, so that the solver's factorisation stays sparse."""
    balls = "".join(
        f'<geom name="over{i}" pos="{0.01 * (i + 1):g} 0 {PARKED_MM:g}"/>' for i in range(pins)
    )
    bed = "".join(
        f'<body name="pin{i}" pos="{0.01 * (i + 1):g} 0 {-BALL_MM:g}"><joint class="pin"/>'
        f'<geom name="tip{i}"/></body>'
        for i in range(pins)
    )
    pairs = "".join(f'<pair geom1="over{i}" geom2="tip{i}"/>' for i in range(pins))
    return f"""<mujoco model="press">
  <option timestep="1" integrator="discrete" solver="Newton" gravity="0 0 0" tolerance="1e-10">
    <flag refsafe="disable" island="disable" sensor="disable" actuation="disable"/>
  </option>
  <size memory="{max(16, pins // 16)}M"/>
  <default>
    <geom type="sphere" size="{BALL_MM:g}" mass="{PIN_MASS:g}" contype="0" conaffinity="0"/>
    <pair condim="1" solref="0.001 1" solimp="0.9999 0.9999 0.001 0.5 2"/>
    <default class="pin"><joint type="slide" axis="0 0 1" stiffness="1"/></default>
  </default>
  <worldbody>
    <body name="shape"><inertial pos="0 0 0" mass="{SHAPE_MASS:g}" diaginertia="1 1 1"/>
      <joint name="down" type="slide" axis="0 0 1"/>{balls}</body>
    {bed}
  </worldbody>
  <contact>{pairs}</contact>
</mujoco>"""


def _model(pins: int) -> mujoco.MjModel:
    """The compiled bed. Large ones are kept in the cache home, as MuJoCo takes four seconds to read
    one of 8,192 pins, and a twentieth of one to load it."""
    home = cache_home() if pins >= MIN_KEPT else None
    if home is None:
        return mujoco.MjModel.from_xml_string(mjcf(pins))
    text = mjcf(pins)
    digest = hashlib.sha256(f"{mujoco.__version__} {text}".encode()).hexdigest()[:DIGITS]
    path = home / "beds" / f"{pins}-{digest}.mjb"
    content = read_checked(path)
    if content is not None:
        return mujoco.MjModel.from_binary_path(path.name, {path.name: content})
    model = mujoco.MjModel.from_xml_string(text)
    with suppress(T2TwinError):  # where there is no room for it, it is compiled the next time too
        content = np.empty(mujoco.mj_sizeModel(model), np.uint8)
        mujoco.mj_saveModel(model, None, content)
        write_checked(path, content.tobytes())
        for older in set(path.parent.glob(f"{pins}-*.mjb")) - {path}:
            older.unlink(missing_ok=True)
    return model


class Bed:
    """A compiled bed of a fixed number of pins, laid out anew for each press."""

    def __init__(self, pins: int) -> None:
        self.pins = pins
        self.model = _model(pins)
        self.data = mujoco.MjData(self.model)
        self._gap_mm = np.zeros(0)

    def lay(self, gap_mm: np.ndarray, depth_mm: float) -> None:
        """Place n <= pins pins and the shape above them.

        gap_mm: (n,) how much higher than at its first touch the shape stands over each pin.
        depth_mm: where the shape starts.
        """
        model, data, n = self.model, self.data, gap_mm.size
        model.geom_pos[n : self.pins, 2] = PARKED_MM
        model.geom_pos[:n, 2] = gap_mm + BALL_MM
        mujoco.mj_resetData(model, data)
        model.qpos_spring[:] = 0.0
        data.qpos[0] = -depth_mm
        model.jnt_stiffness[n + 1 :] = 1.0
        self._gap_mm = gap_mm

    def push(
        self, force: float, spring_rest_mm: np.ndarray, stiffness: np.ndarray
    ) -> tuple[float, np.ndarray]:
        """One step under a force, in pin springs x mm.

        spring_rest_mm: (n,) deflections at which the pins' springs carry nothing, mm.
        stiffness: (n,) of those springs, in units of the one that the force is given in.
        Returns the shape's depth, mm, and the pins' deflections (n,), mm.
        """
        n = spring_rest_mm.size
        self.model.jnt_stiffness[1 : n + 1] = stiffness
        self.model.qpos_spring[1 : n + 1] = -spring_rest_mm
        self.data.qfrc_applied[0] = -force
        self.data.qpos[1 : n + 1] = self.data.qpos[0] + self._gap_mm + TOUCH_MM
        self.data.qvel[:] = 0.0
        mujoco.mj_step(self.model, self.data)
        return -float(self.data.qpos[0]), -self.data.qpos[1 : n + 1].copy()


_log = mujoco.MjLogConfig.get()
_log.logto_file = False  # else a warning leaves a MUJOCO_LOG.TXT in the working directory
_log.logto_console = False  # a step that ran away is a press that has not settled yet
_log.set()

_idle: dict[int, list[Bed]] = {}
"""Compiled beds that nobody uses, by their number of pins: compiling takes longer than a press."""

_idle_lock = Lock()


@contextmanager
def borrowed_bed(pins: int) -> Iterator[Bed]:
    """A compiled bed with at least so many pins, the caller's alone until it is given back."""
    size = next(size for size in POOL_SIZES if size >= pins)
    with _idle_lock:
        waiting = _idle.setdefault(size, [])
        bed = waiting.pop() if waiting else None
    if bed is None:
        bed = Bed(size)
    try:
        yield bed
    finally:
        with _idle_lock:
            waiting.append(bed)
