"""A Gymnasium environment: grasp an object of unknown mass and friction by touch.

    pip install '.[gym]'
    python examples/gymnasium_grasp.py --objects 200

The gripper of examples/gripper.py holds an object on a post with a small force, then lifts it. An
action is the grip force. An observation is what both sensors read. One policy grips harder when the
DIGIT's contact begins to slip, the other does not react. An object counts as held if it is still in
the fingers 2 s after the lift. Each object is lifted in one of as many processes as there are
cores.
"""

# MuJoCo defines its names at import, where pyright does not find them.
# pyright: reportAttributeAccessIssue=false

import argparse
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache
from multiprocessing import get_context
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
from gripper_scene import GEOM, add_gripper, add_room
from gymnasium import spaces
from tqdm import tqdm

import t2twin
from t2twin.core.machine import cores

RATE_HZ = 10.0
"""Actions and observations per second."""
START_N, MAX_N = 2.0, 15.0
"""Grip force at the start, and the largest one, N."""
CLOSE_S, LIFT_S, HOLD_S = 0.9, 1.5, 2.0
LIFT_M, POST_M, DROPPED_M = 0.04, 0.06, 0.012
"""Height of the lift, height of the post, and slip that counts as dropped, m."""
MASS_KG, FRICTION = (0.05, 0.5), (0.2, 1.0)
"""Ranges of the objects' masses and coefficients of friction, uniform (assumed)."""
HALF_M = ((0.008, 0.016), (0.010, 0.018), (0.018, 0.026))
"""Ranges of the half extents along x, y and z, m (assumed)."""
SHAPES = (GEOM.mjGEOM_BOX, GEOM.mjGEOM_CYLINDER, GEOM.mjGEOM_CAPSULE)
TORSION_M = 0.005
"""Torsional friction over friction, m (assumed)."""
OBJECT, POST = 3, 2
"""Collision bits: objects touch the sensors and the post, which does not touch the sensors."""
SLIPPING, TIGHTER = 0.5, 1.5
"""Slip share at which the reacting policy grips harder, and by which factor."""


class GraspEnv(gym.Env):
    """Lift one random object by its grip force, in N.

    An observation has the DIGIT's image, (320, 240, 3) uint8, the CySkin's counts, (20,), the shear
    force on the DIGIT, (2,) N, and its slip share, (1,). The reward is 1 for each step in which the
    object is in the fingers. info["held"] is whether it still is.
    """

    def __init__(self) -> None:
        twin = t2twin.Twin()
        self.observation_space = spaces.Dict(
            image=spaces.Box(0, 255, twin.background.shape, np.uint8),
            counts=spaces.Box(0, 65_535, (twin.layout.size,), np.float32),
            shear_n=spaces.Box(-np.inf, np.inf, (2,), np.float32),
            slip_share=spaces.Box(0.0, 1.0, (1,), np.float32),
        )
        self.action_space = spaces.Box(0.0, MAX_N, (1,), np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Close the gripper on a random object with START_N."""
        super().reset(seed=seed)
        spec = mujoco.MjSpec()
        add_room(spec)
        half_height = self._add_object(spec)
        self.digit, self.cyskin = add_gripper(spec, POST_M + half_height)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self._simulate(CLOSE_S, START_N)
        return self._observation(), {"held": True}

    def _add_object(self, spec: mujoco.MjSpec) -> float:
        """A random object on a post; returns half its height, m."""
        random = self.np_random
        x, y, z = (float(random.uniform(*half)) for half in HALF_M)
        shape = SHAPES[random.integers(len(SHAPES))]
        friction, mass = random.uniform(*FRICTION), random.uniform(*MASS_KG)
        size, quat, half_height = [x, y, z], [1.0, 0.0, 0.0, 0.0], z
        if shape == GEOM.mjGEOM_CYLINDER:
            size = [x, z, 0.0]
        elif shape == GEOM.mjGEOM_CAPSULE:  # lies along y
            size, quat, half_height = [x, y, 0.0], [0.5**0.5, 0.5**0.5, 0.0, 0.0], x
        body = spec.worldbody.add_body(name="object", pos=[0, 0, POST_M + half_height], quat=quat)
        body.add_freejoint()
        body.add_geom(
            type=shape, size=size, mass=mass, condim=4, priority=1, contype=OBJECT,
            conaffinity=OBJECT, friction=[friction, TORSION_M * friction, 0.0001],
        )  # fmt: skip
        spec.worldbody.add_geom(
            type=GEOM.mjGEOM_BOX, size=[0.006, 0.02, POST_M / 2], pos=[0, 0, POST_M / 2],
            contype=POST, conaffinity=POST,
        )  # fmt: skip
        return half_height

    def step(
        self, action: np.ndarray
    ) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Simulate one period with a grip force."""
        self._simulate(1 / RATE_HZ, float(np.clip(action, 0.0, MAX_N)[0]))
        slip_m = self.data.body("hand").xpos[2] - self.data.body("object").xpos[2]
        held = bool(slip_m < DROPPED_M)
        is_over = self.data.time >= CLOSE_S + LIFT_S + HOLD_S
        return self._observation(), float(held), not held, bool(is_over), {"held": held}

    def _simulate(self, duration_s: float, grip_n: float) -> None:
        for _ in range(round(duration_s / self.model.opt.timestep)):
            share = np.clip((self.data.time - CLOSE_S) / LIFT_S, 0.0, 1.0)
            self.data.ctrl[:] = grip_n, grip_n, LIFT_M * share**2 * (3 - 2 * share)
            mujoco.mj_step(self.model, self.data)

    def _observation(self) -> dict[str, np.ndarray]:
        touch = self.digit.read(self.model, self.data)
        counts = self.cyskin.read(self.model, self.data).counts
        shear_n = touch.digit.shear_n if touch.contacts else np.zeros(2)
        slip_share = touch.digit.slip_share if touch.contacts else 0.0
        return {
            "image": touch.image,
            "counts": counts.astype(np.float32),
            "shear_n": shear_n.astype(np.float32),
            "slip_share": np.array([slip_share], np.float32),
        }


def lift(env: GraspEnv, number: int, reacts: bool) -> tuple[bool, float]:
    """Lift one object; returns whether it is held, and the grip force at the end, N."""
    observation, info = env.reset(seed=number)
    grip_n, is_over = START_N, False
    while not is_over:
        if reacts and observation["slip_share"][0] > SLIPPING:
            grip_n = min(TIGHTER * grip_n, MAX_N)
        observation, _, dropped, ended, info = env.step(np.array([grip_n], np.float32))
        is_over = dropped or ended
    return info["held"], grip_n


def wilson(successes: int, trials: int) -> tuple[float, float]:
    """95 % interval of a rate (Wilson, J. Am. Stat. Assoc. 1927)."""
    z, rate = 1.96, successes / trials
    middle = (rate + z**2 / (2 * trials)) / (1 + z**2 / trials)
    half = np.sqrt(rate * (1 - rate) / trials + (z / (2 * trials)) ** 2) * z / (1 + z**2 / trials)
    return middle - half, middle + half


@dataclass(frozen=True)
class Score:
    """Lifts of one policy. held: how many objects. grip_n: mean grip force at the end, N."""

    held: int
    objects: int
    grip_n: float

    @property
    def percent(self) -> float:
        return 100 * self.held / self.objects

    @property
    def interval_percent(self) -> tuple[float, float]:
        low, high = wilson(self.held, self.objects)
        return 100 * low, 100 * high


def scores(objects: int) -> tuple[Score, Score]:
    """Scores of the policy that does not react and of the one that reacts, of lifts of objects
    0, 1, 2 and so on; shows the progress."""
    numbers, reacts = np.repeat(range(objects), 2).tolist(), [False, True] * objects
    with ProcessPoolExecutor(cores(), mp_context=get_context("spawn")) as pool:
        lifts = list(tqdm(pool.map(lift_alone, numbers, reacts), total=2 * objects, unit="lift"))
    held, grips_n = np.reshape(lifts, (objects, 2, 2)).transpose(2, 1, 0)
    fixed, reacting = (
        Score(int(own.sum()), objects, float(grip_n.mean()))
        for own, grip_n in zip(held, grips_n, strict=True)
    )
    return fixed, reacting


def lift_alone(number: int, reacts: bool) -> tuple[bool, float]:
    """See lift; with the environment of this process."""
    return lift(_environment(), number, reacts)


@cache
def _environment() -> GraspEnv:
    return GraspEnv()


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--objects", type=int, default=200, help="number of random objects")
    options = parser.parse_args()
    found = scores(options.objects)
    print("policy           held           95 % interval   mean grip force at the end, N")
    for name, score in zip(("does not react", "reacts to slip"), found, strict=True):
        low, high = score.interval_percent
        held = f"{score.held:3} of {score.objects:3}, {score.percent:3.0f} %"
        print(f"{name}   {held}   {low:3.0f} to {high:3.0f} %   {score.grip_n:6.1f}")


if __name__ == "__main__":
    main()
