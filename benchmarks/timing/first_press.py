"""Duration of `t2twin press wrench/ring` with an empty cache, and of later calls.

    python -m benchmarks.timing.first_press [ROUNDS]

Each round starts with an empty cache folder, as on a new machine. It runs the command once, and
then LATER times. Wall time is the waiting time of a user. Processor time of the command and its
child processes depends less on other load of the machine.
"""

import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from argparse import Namespace
from pathlib import Path
from typing import Any

from tqdm import tqdm

from benchmarks.evidence import Argument, Benchmark, Figure, main
from t2twin.core.cache_dir import VARIABLE
from t2twin.core.machine import cores

BENCHMARK = Benchmark(
    module="benchmarks.timing.first_press",
    measures="Duration of `t2twin press` with an empty cache, and of later calls.",
    minutes=2,
    sources=("primitives_cad", "sim", "t2twin/cli"),
    figures=(
        Figure("first.wall_s", "s", most=15.0),
        Figure("first.processor_s", "s"),
        Figure("later.wall_s", "s", most=2.0),
        Figure("later.processor_s", "s"),
    ),
    arguments=(Argument("rounds", "empty caches", int, 3, nargs="?"),),
)

SHAPE = "wrench/ring"

LATER = 3
"""Later calls in each round."""


def measure(options: Namespace) -> dict[str, Any]:
    first, later = [], []
    for _ in tqdm(range(options.rounds), desc="first press", unit="round"):
        with tempfile.TemporaryDirectory() as folder:
            first.append(_press(Path(folder)))
            later += [_press(Path(folder)) for _ in range(LATER)]
    return {
        "shape": SHAPE,
        "cores": cores(),
        "rounds": options.rounds,
        "first": _medians(first),
        "later": _medians(later),
    }


def _press(folder: Path) -> tuple[float, float]:
    """Wall and processor seconds of one call with its cache home in a folder."""
    environment = os.environ | {VARIABLE: str(folder / "cache")}
    for name in ("NUMBA_CACHE_DIR", "PYTHONDONTWRITEBYTECODE"):  # as in a user's shell
        environment.pop(name, None)
    command = [sys.executable, "-m", "t2twin", "press", SHAPE, "--out", str(folder / "press")]
    before, started = _processor_s(), time.perf_counter()
    subprocess.run(command, env=environment, check=True, capture_output=True)
    return time.perf_counter() - started, _processor_s() - before


def _processor_s() -> float:
    """Processor seconds of all processes that this one has waited for, and of theirs."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _medians(measured: list[tuple[float, float]]) -> dict[str, float]:
    wall, processor = (statistics.median(each) for each in zip(*measured, strict=True))
    return {"wall_s": round(wall, 2), "processor_s": round(processor, 2)}


if __name__ == "__main__":
    main(BENCHMARK)
