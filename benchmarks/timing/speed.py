"""Cost of a press, an image and a dataset, compared with another commit of this project.

    git worktree add --detach ../older 1b5051b
    python -m benchmarks.timing.speed ../older

Each turn measures both checkouts in turn, each in its own process on one core
(`speed_turn.py`). A ratio is the median over the turns, because absolute times differ
between machines. Pairs per second are those of `t2twin simdata --scale small`. The other checkout
uses the packages that are installed here. `speed_parts.py` measures the parts of a press
in this checkout.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
from argparse import Namespace
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from benchmarks import ROOT
from benchmarks.evidence.record import Argument, Benchmark, Figure
from benchmarks.evidence.run import main
from t2twin.core.errors import T2TwinError

BENCHMARK = Benchmark(
    module="benchmarks.timing.speed",
    measures="Speed of a press, an image and a dataset, against another commit.",
    minutes=20,
    sources=("primitives_cad", "sim"),
    figures=(
        Figure("times_as_fast.pairs", "times", least=2.0),
        Figure("times_as_fast.press_digit", "times", least=2.0),
        Figure("times_as_fast.press_cyskin", "times", least=2.2),
        Figure("times_as_fast.picture", "times", least=2.0),
        Figure("two_workers_over_two_runs", "times", least=0.95),
        Figure("ms.*", "ms"),
        Figure("where_ms.*.*", "ms"),
        Figure("pairs_a_second", "pairs/s"),
    ),
    arguments=(
        Argument("checkout", "folder of another checkout of this project", Path),
        Argument("--turns", "of both; keeps nothing unless 5", int, 5, partial=True),
    ),
)

TURN = ROOT / "benchmarks" / "timing" / "speed_turn.py"
PARTS = ROOT / "benchmarks" / "timing" / "speed_parts.py"
SCALE = "small"
LONG_SCALE = "paper"
"""Takes minutes, so that the seconds in which workers start hardly count."""

STAGES = ("press_digit", "press_cyskin", "picture")

RATE = re.compile(r"([\d.]+) pairs/s")
"""What `t2twin simdata` says at its end."""


def measure(options: Namespace) -> dict[str, Any]:
    other = options.checkout.resolve()
    if not (other / "primitives_cad").is_dir():
        raise T2TwinError(f"{options.checkout} is no checkout of this project")
    with tempfile.TemporaryDirectory(prefix="t2twin-speed-") as folder:
        for checkout in (ROOT, other):  # shapes and compiled code are at hand from here on
            _stages(checkout)
        turns = [
            {
                "stages_ms": {"now": _stages(ROOT), "before": _stages(other)},
                "pairs_a_second": {
                    "now": _rate(ROOT, Path(folder), 1),
                    "before": _rate(other, Path(folder), 1),
                },
            }
            for _ in tqdm(range(options.turns), unit="turn")
        ]
        two_workers = _rate(ROOT, Path(folder), 2, LONG_SCALE)
        two_runs = _rate_of_two_runs(Path(folder))
    rates = [turn["pairs_a_second"] for turn in turns]
    return {
        "before": _commit(other),
        "times_as_fast": {
            stage: _median(
                turn["stages_ms"]["before"][stage] / turn["stages_ms"]["now"][stage]
                for turn in turns
            )
            for stage in STAGES
        }
        | {"pairs": _median(rate["now"] / rate["before"] for rate in rates)},
        "two_workers_over_two_runs": two_workers / two_runs,
        "two_workers_a_second": two_workers,
        "ms": {
            stage: _median(turn["stages_ms"]["now"][stage] for turn in turns) for stage in STAGES
        },
        "pairs_a_second": _median(rate["now"] for rate in rates),
        "where_ms": json.loads(_run(ROOT, [str(PARTS)]).splitlines()[-1]),
        "turns": turns,
    }


def _median(values: Any) -> float:
    return float(np.median(list(values)))


def _stages(checkout: Path) -> dict[str, float]:
    """Median milliseconds of each stage over the protocol of scale smoke."""
    return json.loads(_run(checkout, [str(TURN)]).splitlines()[-1])


def _rate(checkout: Path, folder: Path, workers: int, scale: str = SCALE) -> float:
    """Pairs a second of a whole dataset."""
    package = "t2twin.cli" if (checkout / "t2twin").is_dir() else "translate.cli"
    command = f"import sys; from {package} import main; main(sys.argv[1:])"
    with tempfile.TemporaryDirectory(dir=folder) as out:
        place = str(Path(out) / "data")
        said = _run(
            checkout,
            ["-c", command, "simdata", "--scale", scale, "--workers", str(workers), "--out", place],
        )
    (rate,) = RATE.findall(said)
    return float(rate)


def _rate_of_two_runs(folder: Path) -> float:
    """Pairs a second of two simultaneous runs of this checkout, with one worker each, together."""
    with ThreadPoolExecutor(2) as pool:
        return sum(pool.map(lambda _: _rate(ROOT, folder, 1, LONG_SCALE), range(2)))


def _run(checkout: Path, arguments: list[str]) -> str:
    """What a Python process prints that has a checkout's packages, and one thread."""
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=checkout,
        env=os.environ | {"PYTHONPATH": str(checkout), "OMP_NUM_THREADS": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    if done.returncode:
        raise T2TwinError(f"{checkout} cannot be measured: {done.stdout.strip()[-500:]}")
    return done.stdout


def _commit(checkout: Path) -> str:
    asked = ["git", "-C", str(checkout), "rev-parse", "--short=12", "HEAD"]
    return subprocess.run(asked, capture_output=True, text=True, check=True).stdout.strip()


if __name__ == "__main__":
    main(BENCHMARK)
