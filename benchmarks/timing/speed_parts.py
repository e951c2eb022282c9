"""Processor time of the parts of a press, printed as JSON; speed.py runs it on one core.

The times are milliseconds for each sensor's press.
"""

import json
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from t2twin.primitives_cad import catalogue
from t2twin.sim.contact import fixed_point, pin_layout
from t2twin.sim.dataset.shard import Stopwatch
from t2twin.sim.sampling import protocol
from t2twin.sim.sensors.pair import SensorPair

PARTS: dict[str, tuple[Any, str]] = {
    "steps": (fixed_point, "iterate"),
    "mujoco": (fixed_point.FixedPoint, "_verify_with_mujoco"),
    "footprints": (pin_layout, "footprint"),
}
"""What is timed, and where it is called from."""

SCALE = "smoke"
ROUNDS = 5
"""Rounds over the presses; a press's time is the median of its own."""


def watched(watch: Stopwatch, part: str, place: Any, name: str) -> None:
    """Lets the watch run wherever this function of a class or a module is at work."""
    called: Callable = getattr(place, name)

    def timed(*arguments: Any, **options: Any) -> Any:
        with watch.running(part):
            return called(*arguments, **options)

    setattr(place, name, timed)


def main() -> None:
    watch, pair = Stopwatch(dict.fromkeys(PARTS, 0.0)), SensorPair()
    for part, (place, name) in PARTS.items():
        watched(watch, part, place, name)
    presses = [
        (shape, protocol.press_at(shape, index))
        for shape in map(catalogue.load, catalogue.NAMES)
        for index in protocol.indices(shape.name, protocol.SCALES[SCALE])
    ]
    content = {}
    for name, sensor in (("digit", pair.camera), ("cyskin", pair.array)):
        rows = np.empty((ROUNDS, len(presses), 1 + len(PARTS)))
        for turn in rows:
            for row, (shape, command) in zip(turn, presses, strict=True):
                watch.seconds.update(dict.fromkeys(PARTS, 0.0))
                start = time.process_time()
                contact = sensor.press(shape, command)
                if name == "digit":
                    _ = contact.surface_mm
                row[0] = 1e3 * (time.process_time() - start)
                row[1:] = [1e3 * watch.seconds[part] for part in PARTS]
        whole, *parts = np.median(rows[1:], axis=0).mean(axis=0)  # the first round prepares
        content[name] = {"press": whole} | dict(zip(PARTS, parts, strict=True))
        content[name]["other"] = whole - sum(parts)
    print(json.dumps(content))


if __name__ == "__main__":
    main()
