"""What a sensor has read from one MjData."""

# MuJoCo defines its names at import, where pyright does not find them.
# pyright: reportAttributeAccessIssue=false

from dataclasses import dataclass, field
from math import inf
from typing import TYPE_CHECKING

import numpy as np

from t2twin.attachment.contacts import Pose, Push, Wrench, awake, contact_forces
from t2twin.sim.touch import Touch

if TYPE_CHECKING:
    import mujoco

AWAKE = 1
"""MuJoCo's mjS_AWAKE."""


@dataclass
class State:
    """The last reading of a sensor from one MjData.

    time_s, period: of the last reading. reads: their number. seen: the poses and forces, as bytes.
    touch, touch_s: the last touch and its time. poses, centers_mm: of the touching bodies and of
    their places of contact, in the sensor frame, by the body's id. asleep: the poses of bodies that
    sleep, as bytes. sleeping: their forces.
    """

    time_s: float = -inf
    period: int = -1
    reads: int = 0
    seen: bytes = b""
    poses: dict[int, Pose] = field(default_factory=dict)
    centers_mm: dict[int, np.ndarray] = field(default_factory=dict)
    touch: Touch | None = None
    touch_s: float = 0.0
    asleep: bytes = b""
    sleeping: tuple[list[Wrench], list[Push]] = field(default_factory=lambda: ([], []))

    def forces(
        self, model: "mujoco.MjModel", data: "mujoco.MjData", geom: int, frame: Pose
    ) -> tuple[list[Wrench], list[Push]]:
        """The forces on a sensor's geom, see contact_forces.

        MuJoCo computes no contacts of bodies that sleep. They are found once, in a copy of the
        state that is awake.
        """
        touching, others = contact_forces(model, data, geom, frame)
        still = data.body_awake != AWAKE
        if data.nbody_awake == model.nbody or not still[model.geom_bodyid[geom]]:
            return touching, others
        asleep = b"".join(each.tobytes() for each in (still, data.xpos[still], *frame))
        if asleep != self.asleep:
            wrenches, pushes = contact_forces(model, awake(model, data), geom, frame)
            self.asleep = asleep
            self.sleeping = (
                [each for each in wrenches if still[each.body]],
                [each for each in pushes if still[each.body]],
            )
        together = sorted(touching + self.sleeping[0], key=lambda each: each.body)
        return together, others + self.sleeping[1]
