"""Gymnasium environments of a gripper with two equal tactile sensors: hold, pose and insert.

    env = gymnasium.make_vec("skills/Hold-v0", 2, "async", sensor="digit", observe=("image",))

An observation has `hand`, the commands of the hand (across and lift in mm, tilt in degrees, grip in
N), and of each finger what `observe` names: counts of an array; image of a gel camera, which is
rendered only then; contact: force and shear, N, depth and center, mm; traction: pressure and shear,
kPa, on a coarse grid. Each episode samples the object, its pose, and the sensors' places, light and
noise. `expert` returns the action of an expert that sees the state.
"""

# pyright: reportAttributeAccessIssue=false

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
from gymnasium import spaces

import t2twin
from examples.gripper_scene import add_room
from examples.skills.scene import BOX, HEIGHT_M, add_hole, add_rod, add_sampled_gripper, turned
from t2twin.sim.optical.gel_camera import GelCamera
from t2twin.sim.sensors.files import load_sensor

TRAINING, UNSEEN = ("cylinder", "box"), ("hexagon", "key")
"""The objects in training and in the evaluation."""
RATE_HZ, CLOSE_S, GRID = 10.0, 0.5, 12
"""Actions per second, time in which the gripper closes, rows and columns of the tractions."""
Observed = dict[str, np.ndarray]
Info = dict[str, Any]


class SkillEnv(gym.Env[Observed, np.ndarray]):
    """What the skills share. sensor: of both fingers. unseen: whether the objects are UNSEEN.
    rate_hz, steps: actions per second, and the largest number of them in an episode.

    A skill defines `add_task`, which adds an object to the scene; `act`, which sets the commands of
    an action and simulates; `outcome`: whether the task is solved, and has failed; and `expert`.
    """

    steps: int  # in an episode
    ranges: Sequence[tuple[float, float]]  # of the numbers of an action
    grip_n, ends_solved = 6.0, False  # at the start; whether an episode ends once it is solved
    errors = np.empty(0)  # of an estimate
    action_space: Any
    expert: Any
    observation_space: Any

    def __init__(
        self, sensor: str = "cyskin-20", observe: Sequence[str] = ("counts",), unseen: bool = False,
        rate_hz: float = RATE_HZ, steps: int | None = None,
    ) -> None:  # fmt: skip
        self.sensor, self.observe, self.rate_hz = sensor, tuple(observe), rate_hz
        self.steps = steps or self.steps
        self.kinds, device = UNSEEN if unseen else TRAINING, load_sensor(sensor)
        boxes: dict[str, tuple[Any, ...]] = {
            "contact": (-np.inf, np.inf, (2, 6), np.float32),
            "traction": (-np.inf, np.inf, (2, 3, GRID, GRID), np.float32),
        }
        if isinstance(device, GelCamera):
            shape = (2, device.camera.rows, device.camera.columns, 3)
            boxes["image"] = 0, 255, shape, np.uint8
        else:
            boxes["counts"] = 0, device.full_scale, (2, device.layout.size), np.float32
        if wrong := set(observe) - set(boxes):
            raise ValueError(f"{sensor} has no {min(wrong)}; expected some of {', '.join(boxes)}")
        found: dict[str, Any] = {name: spaces.Box(*boxes[name]) for name in self.observe}
        found["hand"] = spaces.Box(-np.inf, np.inf, (4,), np.float32)
        self.observation_space = spaces.Dict(found)
        self.action_space = spaces.Box(*np.array(self.ranges, np.float32).T)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Observed, Info]:
        """Builds a scene and closes the gripper. info has the background frames."""
        super().reset(seed=seed)
        spec, random = mujoco.MjSpec(), self.np_random
        add_room(spec)
        sky, flat = mujoco.mjtTexture.mjTEXTURE_SKYBOX, mujoco.mjtBuiltin.mjBUILTIN_FLAT
        spec.add_texture(type=sky, builtin=flat, rgb1=[1, 1, 1], width=8, height=48)
        self.kind = str(random.choice(self.kinds))
        self.add_task(spec)
        self.sensors = add_sampled_gripper(spec, self.sensor, random, "image" in self.observe)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.command = np.array([0.0, 0.0, 0.0, self.grip_n])  # across, lift, m; tilt, rad; grip
        self.step_number = 0
        self.simulate(CLOSE_S)
        info: Info = {"success": False}
        if "image" in self.observe:
            frames = [each.device.background_frame(random) for each in self.sensors]
            info["background"] = np.stack(frames)
        return self.observation(), info

    def step(self, action: np.ndarray) -> tuple[Observed, float, bool, bool, Info]:
        """Acts for one period. The reward is 1 while the task is solved."""
        self.act(np.clip(action, self.action_space.low, self.action_space.high))
        self.step_number += 1
        success, failed = self.outcome()
        ended, is_over = failed or (success and self.ends_solved), self.step_number >= self.steps
        info = {"success": success, "errors": self.errors}
        return self.observation(), float(success), ended, is_over, info

    def simulate(self, duration_s: float) -> None:
        across, lift, tilt, grip_n = self.command
        self.data.ctrl[:] = grip_n, grip_n, lift, across, tilt
        steps = round(duration_s / self.model.opt.timestep)
        mujoco.mj_step(self.model, self.data, nstep=steps)

    def let_go(self) -> None:
        """The magnet, which holds the object while the gripper closes, lets go."""
        self.data.eq_active[self.model.equality("magnet").id] = 0

    def observation(self) -> Observed:
        hand = self.command * [1e3, 1e3, 180 / np.pi, 1.0]
        found = {"hand": hand.astype(np.float32)}
        touches = [each.read(self.model, self.data) for each in self.sensors if self.observe]
        for name in self.observe:
            own = name in ("counts", "image")
            values = [getattr(each, name) if own else of_contact(each, name) for each in touches]
            found[name] = np.stack(values).astype(self.observation_space[name].dtype)
        return found

    def object_pose(self, along_m: float = 0.0) -> tuple[np.ndarray, float]:
        """Place of a point on the object's axis, m, and the axis's angle about x, rad."""
        body = self.data.body("object")
        axis = body.xmat.reshape(3, 3)[:, 2]
        return body.xpos + along_m * axis, float(np.arctan2(-axis[1], axis[2]))


def of_contact(touch: t2twin.Touch, name: str) -> np.ndarray:
    """(6,) summary of a contact, or (3, GRID, GRID) its tractions."""
    contact = next(iter(touch.contacts.values()), None)
    if contact is None:
        return np.zeros(6 if name == "contact" else (3, GRID, GRID))
    if name == "contact":
        share = contact.pressure_kpa / contact.pressure_kpa.sum()
        center = share.sum(0) @ contact.x_mm, share.sum(1) @ contact.y_mm
        return np.array([contact.force_n, *contact.shear_n, contact.depth_mm, *center])
    maps = np.stack([contact.pressure_kpa, *contact.shear_kpa])
    rows, columns = (np.arange(GRID) * size // GRID for size in maps.shape[1:])
    sums = np.add.reduceat(np.add.reduceat(maps, rows, 1), columns, 2)
    return sums * GRID**2 / maps[0].size


class PoseEnv(SkillEnv):
    """Estimate the offset of a fixed rod's axis, mm, and its angle, degrees, in four grasps.

    An action is an estimate; the gripper then closes at the next place. Solved if the last one is
    within 1 mm and 6 degrees.
    """

    steps, ranges = 4, ((-8.0, 8.0), (-45.0, 45.0))
    PLACES_M = np.array([[0, 0], [0.003, 0], [0, 0.003], [-0.003, -0.003]])
    TOLERANCE = np.array([1.0, 6.0])

    def add_task(self, spec: mujoco.MjSpec) -> None:
        random, angle = self.np_random, np.radians(self.np_random.uniform(-40, 40))
        radius, half = random.uniform(0.003, 0.005), random.uniform(0.012, 0.022)
        offset, along = random.uniform(-0.004, 0.004), random.uniform(-0.003, 0.003)
        across = np.array([0, np.cos(angle), np.sin(angle)])
        axis = np.array([0, -np.sin(angle), np.cos(angle)])
        place = [0, 0, HEIGHT_M] + offset * across + along * axis
        add_rod(spec, self.kind, radius, half, (place, turned(angle, "x")))
        self.truth = np.array([1e3 * offset, np.degrees(angle)])

    def act(self, action: np.ndarray) -> None:
        self.errors = np.abs(action - self.truth)
        if self.step_number + 1 < self.steps:
            self.command[3] = -3.0  # open
            self.simulate(0.15)
            self.command[:2] = self.PLACES_M[self.step_number + 1]
            self.command[3] = self.grip_n
            self.simulate(CLOSE_S)

    def outcome(self) -> tuple[bool, bool]:
        return bool((self.errors < self.TOLERANCE).all()), False

    def expert(self) -> np.ndarray:
        return self.truth


class HoldEnv(SkillEnv):
    """Lift an object of unknown mass and friction without losing or crushing it.

    An action is the logarithm of a factor of the grip. Solved if the object slips by less than 12
    mm, and the grip stays below LIMIT times what the object needs.
    """

    steps, ranges, grip_n = 25, ((0.0, 0.5),), 1.0
    LIFT_M, LIFT_S, DROPPED_M, LIMIT = 0.03, 1.5, 0.012, 3.0

    def add_task(self, spec: mujoco.MjSpec) -> None:
        random = self.np_random
        self.need_n = float(np.exp(random.uniform(np.log(0.6), np.log(6.0))))
        friction, half = random.uniform(0.3, 0.9), random.uniform(0.004, 0.007)  # ends in view
        place = np.array([0, random.uniform(-3e-3, 3e-3), HEIGHT_M + random.uniform(-2e-3, 2e-3)])
        mass_kg, pose = 2 * friction * self.need_n / 9.81, (place, [1, 0, 0, 0])
        add_rod(spec, self.kind, random.uniform(5e-3, 9e-3), half, pose, friction, mass_kg)
        post = (place[2] - half) / 2  # which the sensors pass through
        spec.worldbody.add_geom(
            type=BOX, size=[0.006, 0.01, post], pos=[0, 0, post], contype=2, conaffinity=2
        )
        self.peak_n = self.grip_n

    def slip_m(self) -> float:
        return self.data.body("hand").xpos[2] - self.data.body("object").xpos[2]

    def act(self, action: np.ndarray) -> None:
        self.last_m = self.slip_m()
        if self.step_number == 0:
            self.let_go()
            self.start_m = self.last_m
        self.command[3] = min(self.command[3] * np.exp(action[0]), 25.0)
        self.peak_n = max(self.peak_n, self.command[3])
        share = min(1.0, (self.step_number + 1) / (self.LIFT_S * self.rate_hz))
        self.command[1] = self.LIFT_M * share
        self.simulate(1 / self.rate_hz)

    def outcome(self) -> tuple[bool, bool]:
        dropped = bool(self.slip_m() - self.start_m > self.DROPPED_M)
        return not dropped and bool(self.peak_n < self.LIMIT * self.need_n), dropped

    def expert(self) -> np.ndarray:
        """Grip harder by how far the object slipped in the last period."""
        slipped_mm = 1e3 * (self.slip_m() - self.last_m) if self.step_number else 0.0
        return np.array([np.clip(0.4 * (slipped_mm - 0.15), 0.0, 0.5)])


class InsertEnv(SkillEnv):
    """Put a held peg into a hole with 0.5 mm clearance and a chamfer of 2 mm.

    The place of the hole is known, that of the peg in the hand is not. An action is the velocity of
    the hand across and up, mm/s, and its turning, degrees/s. Solved if the tip is 8 mm deep.
    """

    steps, ranges = 45, ((-20.0, 20.0), (-30.0, 30.0), (-40.0, 40.0))
    grip_n, ends_solved = 10.0, True
    DEPTH_M, CHAMFER_M, CLEARANCE_M, GOAL_M = 0.015, 0.002, 0.0005, 0.008

    def add_task(self, spec: mujoco.MjSpec) -> None:
        random, angle = self.np_random, np.radians(self.np_random.uniform(-10, 10))
        self.half = random.uniform(0.028, 0.032)
        along = self.half - random.uniform(0.012, 0.016)  # the top is above the pads' middle
        axis = np.array([0, -np.sin(angle), np.cos(angle)])
        place = [0, random.uniform(-0.004, 0.004), HEIGHT_M] - along * axis
        pose, radius = (place, turned(angle, "x")), random.uniform(0.003, 0.005)
        width = add_rod(spec, self.kind, radius, self.half, pose)
        add_hole(spec, width + self.CLEARANCE_M / 2, self.DEPTH_M, self.CHAMFER_M)

    def act(self, action: np.ndarray) -> None:
        if self.step_number == 0:
            self.let_go()
        self.command[:3] += action * [1e-3, 1e-3, np.pi / 180] / self.rate_hz
        self.simulate(1 / self.rate_hz)

    def outcome(self) -> tuple[bool, bool]:
        _, across, height = self.object_pose(-self.half)[0]
        return bool(abs(across) < 1e-3 and height < self.DEPTH_M - self.GOAL_M), False

    def expert(self) -> np.ndarray:
        """Turn the peg upright and over the hole, then lower it."""
        (_, across, height), angle = self.object_pose(-self.half)
        aligned = abs(across) < 0.0006 and abs(angle) < np.radians(2)
        down = -25.0 if aligned else 8.0 * (height < self.DEPTH_M + 0.002)
        action = np.array([-4e3 * across, down, -4 * np.degrees(angle)])
        return np.clip(action, self.action_space.low, self.action_space.high)


TASKS: dict[str, Any] = {"hold": HoldEnv, "pose": PoseEnv, "insert": InsertEnv}
for task, env in TASKS.items():
    gym.register(f"skills/{task.title()}-v0", env)
