"""Processor times of the checkout in the working directory, printed as JSON; speed.py runs it.

It also runs with older layouts of the project, which had no package `t2twin`.
"""

# pyright: reportMissingImports=false, reportAttributeAccessIssue=false

import json
import time
from pathlib import Path

import numpy as np

if Path("t2twin").is_dir():
    from t2twin.primitives_cad import catalogue
    from t2twin.sim.sampling import protocol

    try:
        from t2twin.sim.sensors.pair import SensorPair

        DIGIT, CYSKIN = SensorPair().camera, SensorPair().array
    except ImportError:
        from t2twin.sim.sensors import SensorPair

        DIGIT, CYSKIN = SensorPair().digit, SensorPair().cyskin
    press_digit, press_cyskin = DIGIT.press, CYSKIN.press

    def picture(contact, shape, command, rng):
        return DIGIT.image(contact, rng)

    try:
        from t2twin.sim.slide import path_commands, slide_to, straight_path
    except ImportError:
        slide_to = None

else:
    from sim.bench import Bench  # noqa: TID251

    from primitives_cad import catalogue  # noqa: TID251
    from sim import protocol  # noqa: TID251

    PAIR = Bench()
    press_digit, press_cyskin, picture = PAIR.digit.touch, PAIR.cyskin.touch, PAIR.digit.see

    slide_to = None

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
    rng = np.random.default_rng(0)
    best = np.full((len(presses), 3), np.inf)
    for _ in range(ROUNDS):
        for row, (shape, command) in enumerate(presses):
            times = [time.process_time()]
            contact = press_digit(shape, command)
            _ = contact.surface_mm  # which the picture needs, and the CySkin's taxels do not
            times.append(time.process_time())
            press_cyskin(shape, command)
            times.append(time.process_time())
            picture(contact, shape, command, rng)
            times.append(time.process_time())
            best[row] = np.minimum(best[row], 1e3 * np.diff(times))
    digit, cyskin, seen = np.median(best, axis=0)
    content = {"press_digit": digit, "press_cyskin": cyskin, "picture": seen}
    if slide_to is not None:
        content["slide"] = slide_ms(presses[::EVERY])
    print(json.dumps(content))


def slide_ms(presses) -> float:
    """Median of the best time of a step on both sensors, without readings, ms."""
    assert slide_to is not None
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
