"""Time of a step of a slide on one core.

    python -m benchmarks.timing.slide_speed

- Processor time of a step on each sensor, and its ratio to that of a press.
- Steps a second of `Twin.slide`, which moves both sensors and computes image and counts.

Each shape is pressed at FORCE_N and slides STEPS times by STEP_MM.
"""

import time
from argparse import Namespace
from typing import Any

import numpy as np

import t2twin
from benchmarks.evidence import Benchmark, Figure, main
from benchmarks.motion.slides import SEED
from t2twin.primitives_cad import catalogue
from t2twin.sim.contact.sliding import advance
from t2twin.sim.contact.types import PressCommand
from t2twin.sim.sampling.presses import random_name

BENCHMARK = Benchmark(
    module="benchmarks.timing.slide_speed",
    measures="Time of a step of a slide on one core.",
    minutes=1,
    sources=("primitives_cad", "sim"),
    figures=(
        Figure("one_sensor.*.median_ms", "ms", most=8.0),
        Figure("one_sensor.*.of_a_press"),
        Figure("both_sensors.median_a_second", "steps/s", least=60.0),
        Figure("both_sensors.slowest_a_second", "steps/s"),
        Figure("both_sensors.fastest_a_second", "steps/s"),
    ),
)

SHAPES = ("hemisphere-4", "square-2", "wrench/open-end", *(random_name(SEED, n) for n in range(4)))
FORCE_N, STEPS, STEP_MM = 4.0, 6, 0.2

SENSORS = ("digit", "cyskin")
"""Names of the sensors in the results."""


def measure(options: Namespace) -> dict[str, Any]:
    twin = t2twin.Twin()
    rates = both_sensors(twin)
    return {
        "one_sensor": {sensor: one_sensor(twin, sensor) for sensor in SENSORS},
        "both_sensors": {
            "median_a_second": float(np.median(list(rates.values()))),
            "slowest_a_second": min(rates.values()),
            "fastest_a_second": max(rates.values()),
            "a_second": rates,
        },
    }


def one_sensor(twin: t2twin.Twin, sensor: str) -> dict[str, float]:
    """Median processor time of a step and of a press, ms, and their ratio."""
    presses, steps = [], []
    of_sensor = twin.sensors.camera if sensor == "digit" else twin.sensors.array
    for name in (*SHAPES, *SHAPES):  # the first round compiles code, loads models, computes kernels
        shape = catalogue.load(name)
        start = time.process_time()
        contact = of_sensor.press(shape, PressCommand(name, 0.0, 0.0, 0.0, FORCE_N))
        presses.append(1e3 * (time.process_time() - start))
        for _ in range(STEPS):
            start = time.process_time()
            contact = advance(contact, STEP_MM, 0.0, 0.0, FORCE_N, of_sensor.friction)
            steps.append(1e3 * (time.process_time() - start))
    press_ms = float(np.median(presses[len(SHAPES) :]))
    step_ms = float(np.median(steps[len(SHAPES) * STEPS :]))
    return {"median_ms": step_ms, "press_ms": press_ms, "of_a_press": step_ms / press_ms}


def both_sensors(twin: t2twin.Twin) -> dict[str, float]:
    """Steps a second of `Twin.slide` with each shape, in real time."""
    rates = {}
    for name in (*SHAPES, *SHAPES):  # the rates of the first round are replaced
        touch = twin.press(name, force_n=FORCE_N)
        start = time.perf_counter()
        twin.slide(touch, dx_mm=STEPS * STEP_MM, steps=STEPS)
        rates[name] = STEPS / (time.perf_counter() - start)
    return rates


if __name__ == "__main__":
    main(BENCHMARK)
