"""Processor times of the checkout in the working directory, printed as JSON; speed.py runs it.

It uses only names that the other commit has too.
"""

import json
import time

import numpy as np

from t2twin.primitives_cad import catalogue
from t2twin.sim.sampling import protocol
from t2twin.sim.sensors.pair import SensorPair
from t2twin.sim.slide import path_commands, slide_to, straight_path

SCALE = "smoke"
ROUNDS = 3
"""Rounds over the presses, of which each one's best time counts."""

SLIDE_MM, STEPS, EVERY = (1.5, 0.7), 4, 8
"""Motion of a slide along x and y, its steps, and the number of presses for each slide."""


def main() -> None:
    presses = [
        (shape, protocol.press_at(shape, index))
        for shape in map(catalogue.load, catalogue.NAMES)
        for index in protocol.indices(shape.name, protocol.SCALES[SCALE])
    ]
    rng, pair = np.random.default_rng(0), SensorPair()
    best = np.full((len(presses), 3), np.inf)
    for _ in range(ROUNDS):
        for row, (shape, command) in enumerate(presses):
            times = [time.process_time()]
            contact = pair.camera.press(shape, command)
            _ = contact.surface_mm  # which the picture needs, and the CySkin's taxels do not
            times.append(time.process_time())
            pair.array.press(shape, command)
            times.append(time.process_time())
            pair.camera.image(contact, rng)
            times.append(time.process_time())
            best[row] = np.minimum(best[row], 1e3 * np.diff(times))
    digit, cyskin, seen = np.median(best, axis=0)
    content = {"press_digit": digit, "press_cyskin": cyskin, "picture": seen}
    content["slide"] = slide_ms(presses[::EVERY])
    print(json.dumps(content))


def slide_ms(presses) -> float:
    """Median of the best time of a step on both sensors, without readings, ms."""
    sensors = SensorPair()
    best = []
    for shape, command in presses:
        rows = straight_path(command, *SLIDE_MM, 0.0, STEPS, command.force_n)
        start, *steps = path_commands(shape.name, rows)
        times = []
        for _ in range(ROUNDS):
            touch = sensors.press(shape, start, np.random.default_rng(0))
            for step in steps:
                begun = time.process_time()
                touch = slide_to(sensors, touch, step, None)
                times.append(time.process_time() - begun)
        best.append(np.reshape(times, (ROUNDS, -1)).min(axis=0))
    return 1e3 * float(np.median(best))


if __name__ == "__main__":
    main()
