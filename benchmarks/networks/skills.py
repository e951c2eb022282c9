"""Skills of a gripper with two sensors, learned with one sensor and used with another.

    python -m benchmarks skills OUT

OUT is the folder of `python -m examples.skills`, which trains and evaluates there; what is already
there is not done again. Also the steps a second of a gripper with two DIGITs at 60 Hz.
"""

import json
import time
import warnings
from argparse import Namespace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.evidence import Argument, Benchmark, Figure

BENCHMARK = Benchmark(
    module="benchmarks.networks.skills",
    minutes=100,
    sources=("examples/skills", "sim", "t2twin/attachment", "translate"),
    figures=(
        Figure("tasks.*.*.success_percent", "%"),
        Figure("steps_per_s.1.contact", least=120.0),
        Figure("steps_per_s.1.image", least=60.0),
    ),
    arguments=(Argument("out", "folder of demonstrations, policies and episodes", Path),),
)
RATE_HZ, STEPS = 60.0, 180


def measure(options: Namespace) -> dict[str, Any]:
    from examples.skills.study import evaluate, train

    train(options.out)
    evaluate(options.out)
    tasks = json.loads((options.out / "skills.json").read_text())
    speeds = {f"{n}": {each: speed(n, each) for each in ("contact", "image")} for n in (1, 2)}
    return {"tasks": tasks, "steps_per_s": speeds}


def speed(processes: int, observe: str) -> float:
    """Steps a second of all processes, each with a gripper that holds and lifts an object."""
    import gymnasium

    warnings.simplefilter("ignore")
    own = {"sensor": "digit", "observe": (observe,), "rate_hz": RATE_HZ, "steps": 1000}
    envs = gymnasium.make_vec("skills/Hold-v0", processes, "async", **own)
    envs.reset(seed=0)
    for step in range(20 + STEPS):  # the first ones compile
        if step == 20:
            start = time.perf_counter()
        envs.step(np.zeros((processes, 1), np.float32))  # keeps the grip
    found = processes * STEPS / (time.perf_counter() - start)
    envs.close()
    return found
