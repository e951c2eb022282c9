"""Times of the checkout in the working directory, printed as JSON; speed.py runs it.

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

else:
    from sim.bench import Bench  # noqa: TID251

    from primitives_cad import catalogue  # noqa: TID251
    from sim import protocol  # noqa: TID251

    PAIR = Bench()
    press_digit, press_cyskin, picture = PAIR.digit.touch, PAIR.cyskin.touch, PAIR.digit.see

SCALE = "smoke"
ROUNDS = 3
"""Rounds over the presses, of which each one's best time counts."""


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
            times = [time.perf_counter()]
            contact = press_digit(shape, command)
            _ = contact.surface_mm  # which the picture needs, and the CySkin's taxels do not
            times.append(time.perf_counter())
            press_cyskin(shape, command)
            times.append(time.perf_counter())
            picture(contact, shape, command, rng)
            times.append(time.perf_counter())
            best[row] = np.minimum(best[row], 1e3 * np.diff(times))
    digit, cyskin, seen = np.median(best, axis=0)
    print(json.dumps({"press_digit": digit, "press_cyskin": cyskin, "picture": seen}))


if __name__ == "__main__":
    main()
