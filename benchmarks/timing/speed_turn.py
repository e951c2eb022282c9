"""A server of processor times for the checkout in the working directory; speed.py drives it.

It reads numbers of presses, a line each, and answers with one line of JSON: the milliseconds of
each stage. It uses only names that the other commit has too.
"""

import json
import sys
import time

import numpy as np

from t2twin.primitives_cad import catalogue
from t2twin.sim.sampling import protocol
from t2twin.sim.sensors.pair import SensorPair
from t2twin.sim.slide import path_commands, slide_to, straight_path

SCALE = "smoke"
SLIDE_MM, STEPS, EVERY = (1.5, 0.7), 4, 8
"""Motion of a slide along x and y, its steps, and the number of presses for each slide."""

REPEATS = 3
"""Of each press in a turn. The least time counts: the other process has emptied the caches."""


def main() -> None:
    presses = [
        (shape, protocol.press_of(shape.name, shape.spacing_mm, index))
        for shape in map(catalogue.load, catalogue.NAMES)
        for index in protocol.indices(shape.name, protocol.SCALES[SCALE])
    ]
    pair = SensorPair()
    print(len(presses), flush=True)
    for line in sys.stdin:
        row = int(line)
        each = [stages_ms(pair, *presses[row]) for _ in range(REPEATS)]
        found = {stage: min(ms[stage] for ms in each) for stage in each[0]}
        if row % EVERY == 0:
            found["slide"] = slide_ms(pair, *presses[row])
        print(json.dumps(found), flush=True)


def stages_ms(pair, shape, command) -> dict[str, float]:
    """Milliseconds of a press on each sensor and of its image."""
    times = [time.process_time()]
    contact = pair.camera.press(shape, command)
    _ = contact.surface_mm  # which the image needs, and the CySkin's taxels do not
    times.append(time.process_time())
    pair.array.press(shape, command)
    times.append(time.process_time())
    pair.camera.image(contact, np.random.default_rng(0))
    times.append(time.process_time())
    return dict(zip(("press_digit", "press_cyskin", "image"), 1e3 * np.diff(times), strict=True))


def slide_ms(pair, shape, command) -> float:
    """Milliseconds of a step of a slide on both sensors, without readings."""
    rows = straight_path(command, *SLIDE_MM, 0.0, STEPS, command.force_n)
    start, *steps = path_commands(shape.name, rows)
    touch = pair.press(shape, start, np.random.default_rng(0))
    begun = time.process_time()
    for step in steps:
        touch = slide_to(pair, touch, step, None)
    return 1e3 * (time.process_time() - begun) / len(steps)


if __name__ == "__main__":
    main()
