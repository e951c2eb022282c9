"""Accuracy of tilted presses of difficult shapes.

    python -m benchmarks tilted_cases [--cases N]

Presses the first CASES shapes of `contact_cases` straight, and tilted by TILTS_DEG in a sampled
direction. Sensors, forces, limits and the solver `oracle` are as there; it has the exact solid.
Its sides, which a tilt turns up, are parallel to its axis.

The contact solver presses the height map of the tilted solid, which is made from the height map of
the straight one.
"""

from argparse import Namespace
from typing import Any

from tqdm import tqdm

from benchmarks.contact.contact_cases import measure_case, summary
from benchmarks.contact.press import SENSORS
from benchmarks.evidence import Argument, Benchmark, Figure

CASES = 32

TILTS_DEG = (0.0, 5.0, 10.0)

BENCHMARK = Benchmark(
    module="benchmarks.contact.tilted_cases",
    minutes=10,
    sources=("primitives_cad", "sim/contact", "sim/taxels"),
    figures=(
        Figure("tilts.*.*.within_percent", "%", least=90.0),  # one of 16
        Figure("tilts.*.*.beyond", most=0),
        Figure("tilts.*.*.worst.*"),
        Figure("usual_map.*.*.within_percent", "%"),
        Figure("usual_map.*.*.beyond"),
    ),
    arguments=(
        Argument("--cases", "press the first N only; keeps nothing", int, CASES, partial=True),
    ),
)


def measure(options: Namespace) -> dict[str, Any]:
    rows: dict[str, list[dict[str, Any]]] = {}
    progress = tqdm(total=len(TILTS_DEG) * options.cases, unit="press")
    for tilt_deg in TILTS_DEG:
        name = f"{tilt_deg:g}"
        rows[name] = []
        for number in range(options.cases):
            rows[name].append(measure_case(number, tilt_deg))
            progress.update()
    return {
        "tilts": {name: by_sensor(of, "errors") for name, of in rows.items()},
        "usual_map": {name: by_sensor(of, "usual_map_errors") for name, of in rows.items()},
        "cases": rows,
    }


def by_sensor(rows: list[dict[str, Any]], key: str) -> dict[str, Any]:
    """The summary of the rows of each sensor. key: of the errors in a row."""
    own = {sensor: [row for row in rows if row["sensor"] == sensor] for sensor in SENSORS}
    return {sensor: summary(of, key) for sensor, of in own.items() if of}
