"""Reads attached sensors in many states at the same time."""

# MuJoCo defines its names at import, where pyright does not find them.
# pyright: reportAttributeAccessIssue=false

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import mujoco

from t2twin.attachment.sensor import AttachedSensor
from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.machine import cores
from t2twin.sim.touch import Touch

MAX_WORKERS = 1024  # largest number of threads (assumed: beyond any machine's cores)


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
    chosen = [sensors] if isinstance(sensors, AttachedSensor) else list(sensors)
    if isinstance(states, mujoco.MjData):
        raise T2TwinError("states is one mujoco.MjData; expected a list of them, such as [data]")
    states = list(states)
    for each in chosen:
        if not isinstance(each, AttachedSensor):
            raise T2TwinError(
                f"sensors has {arguments.describe(each)}; expected sensors of t2twin.attach"
            )
    for each in states:
        if not isinstance(each, mujoco.MjData):
            raise T2TwinError(f"states has {arguments.describe(each)}; expected mujoco.MjData")
    if len({id(each) for each in states}) < len(states):
        raise T2TwinError("states has the same MjData twice; expected one of each environment")
    if workers is not None:
        workers = arguments.whole_number(workers, "workers", 1, MAX_WORKERS)
    jobs = [(sensor, state) for state in states for sensor in chosen]
    with ThreadPoolExecutor(workers or cores()) as pool:
        touches = list(pool.map(lambda job: job[0].read(job[1].model, job[1]), jobs))
    return [
        touches[first : first + len(chosen)] for first in range(0, len(touches), len(chosen) or 1)
    ]
