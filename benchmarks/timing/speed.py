"""Cost of a press, a slide, an image and a dataset, compared with another commit of this project.

    python -m benchmarks.timing.speed
    python -m benchmarks.timing.speed --against 8e3a083

The other commit is REFERENCE, so that a loss of a tenth misses a limit. Each turn measures both
in turn, each in its own process on one core (`speed_turn.py`). All times are processor times, and
a ratio is the median over the turns, because absolute times differ between machines. Pairs are
those of `t2twin simdata --scale small`. The other commit uses the packages that are installed here.
"""

import json
import os
import re
import resource
import subprocess
import sys
import tempfile
from argparse import Namespace
from io import BytesIO
from pathlib import Path
from tarfile import TarFile
from typing import Any

import numpy as np
from tqdm import tqdm

from benchmarks import ROOT
from benchmarks.evidence import Argument, Benchmark, Figure, main
from t2twin.core.errors import T2TwinError
from t2twin.core.files import new_folder

BENCHMARK = Benchmark(
    module="benchmarks.timing.speed",
    measures="Speed of a press, a slide, an image and a dataset, against another commit.",
    minutes=15,
    sources=("primitives_cad", "sim"),
    figures=(Figure("times_as_fast.*", "times", least=0.9), Figure("ms.*", "ms")),
    arguments=(
        Argument("--against", "another commit; keeps nothing", default=None, partial=True),
        Argument("--turns", "of both; keeps nothing unless 5", int, 5, partial=True),
    ),
)

REFERENCE = "8f272bb9"
"""Commit whose speed is kept. A later one replaces it when the project has become faster."""

CHECKOUTS = ROOT / "build" / "speed"
"""Folder of the other commits' files; their compiled code is found again by these paths."""

TURN = ROOT / "benchmarks" / "timing" / "speed_turn.py"
SCALE = "small"
PAIRS = re.compile(r"^(\d+) pairs in ", re.MULTILINE)
"""The number of pairs in what `t2twin simdata` says at its end."""


def measure(options: Namespace) -> dict[str, Any]:
    commit = options.against or REFERENCE
    other = checkout(commit)
    with tempfile.TemporaryDirectory(prefix="t2twin-speed-") as folder:
        for each in (ROOT, other):  # shapes and compiled code are at hand from here on
            _stages(each)
        turns = [
            {"now": _turn(ROOT, Path(folder)), "before": _turn(other, Path(folder))}
            for _ in tqdm(range(options.turns), unit="turn")
        ]
    stages = [stage for stage in turns[0]["now"] if stage in turns[0]["before"]]
    medians = {stage: _median(turn["now"][stage] for turn in turns) for stage in turns[0]["now"]}
    return {
        "before": commit,
        "times_as_fast": {
            stage: _median(turn["before"][stage] / turn["now"][stage] for turn in turns)
            for stage in stages
        },
        "ms": medians,
        "turns": turns,
    }


def checkout(commit: str) -> Path:
    """The folder with the files of a commit. Raises T2TwinError for an unknown commit."""
    found = _git("rev-parse", "--verify", "--quiet", f"{commit}^{{commit}}").decode().strip()
    if not found:
        raise T2TwinError(f"there is no commit {commit} here; fetch it, or name another --against")
    folder = CHECKOUTS / found[:12]
    if not folder.is_dir():
        with (
            new_folder(folder) as temporary,
            TarFile(fileobj=BytesIO(_git("archive", found))) as tar,
        ):
            tar.extractall(temporary, filter="tar")
    return folder


def _git(*arguments: str) -> bytes:
    return subprocess.run(["git", *arguments], cwd=ROOT, stdout=subprocess.PIPE, check=False).stdout


def _turn(folder: Path, out: Path) -> dict[str, float]:
    """Processor milliseconds of each stage and of a pair of a dataset."""
    return _stages(folder) | {"pair": _pair_ms(folder, out)}


def _median(values: Any) -> float:
    return float(np.median(list(values)))


def _stages(checkout: Path) -> dict[str, float]:
    """Median milliseconds of each stage over the protocol of scale smoke."""
    return json.loads(_run(checkout, [str(TURN)]).splitlines()[-1])


def _pair_ms(folder: Path, out: Path) -> float:
    """Processor milliseconds of a pair of a whole dataset, made by one worker."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = "import sys; from t2twin.cli import main; main(sys.argv[1:])"
    with tempfile.TemporaryDirectory(dir=out) as place:
        options = ["--scale", SCALE, "--workers", "1", "--out", f"{place}/data"]
        said = _run(folder, ["-c", command, "simdata", *options])
    (pairs,) = PAIRS.findall(said)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = used.ru_utime - before.ru_utime + used.ru_stime - before.ru_stime
    return 1e3 * seconds / int(pairs)


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


if __name__ == "__main__":
    main(BENCHMARK)
