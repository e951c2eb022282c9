"""Cost of a press, a slide, an image and a dataset, compared with another commit of this project.

    python -m benchmarks speed
    python -m benchmarks speed --against 8e3a083

The other commit is REFERENCE, so that a loss of a tenth misses a limit. Both run side by side, each
in its own process on one core (`speed_turn.py`): they do each press in turn, because a machine
changes its pace within a minute. All times are processor times. A ratio is the median over the
presses and rounds, for a pair the median over whole datasets, made in turn. Pairs are those of
`t2twin simdata --scale small`. The other commit uses the packages that are installed here.
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
from benchmarks.evidence import Argument, Benchmark, Figure
from t2twin.core.cache_dir import VARIABLE
from t2twin.core.errors import T2TwinError
from t2twin.core.files import new_folder

BENCHMARK = Benchmark(
    module="benchmarks.timing.speed",
    minutes=15,
    sources=("primitives_cad", "sim"),
    figures=(Figure("times_as_fast.*", "times", least=0.95), Figure("ms.*", "ms")),
    arguments=(
        Argument("--against", "another commit; keeps nothing", default=None, partial=True),
        Argument("--turns", "of both; keeps nothing unless 3", int, 3, partial=True),
    ),
)

REFERENCE = "8f272bb9"
"""Commit whose speed is kept. A later one replaces it when the project has become faster."""

CHECKOUTS = ROOT / "build" / "speed"
"""Folder of the other commits' files; their compiled code is found again by these paths."""

TURN = ROOT / "benchmarks" / "timing" / "speed_turn.py"
STAGES = ("press_digit", "press_cyskin", "image", "slide", "pair")
SCALE = "small"
PAIRS = re.compile(r"^(\d+) pairs in ", re.MULTILINE)
"""The number of pairs in what `t2twin simdata` says at its end."""


def measure(options: Namespace) -> dict[str, Any]:
    commit = options.against or REFERENCE
    checkouts = ROOT, checkout(commit)
    rows = _in_turn(checkouts, options.turns)
    with tempfile.TemporaryDirectory(prefix="t2twin-speed-") as folder:
        for _ in tqdm(range(options.turns), desc="datasets", unit="turn"):
            rows.append(tuple({"pair": _pair_ms(each, Path(folder))} for each in checkouts))
    stages = {stage: [each for each in rows if stage in each[0]] for stage in STAGES}
    return {
        "before": commit,
        "times_as_fast": {
            stage: _median(before[stage] / now[stage] for now, before in pairs)
            for stage, pairs in stages.items()
        },
        "ms": {stage: _median(now[stage] for now, _ in pairs) for stage, pairs in stages.items()},
    }


def _in_turn(checkouts: tuple[Path, ...], turns: int) -> list[tuple[dict[str, float], ...]]:
    """Milliseconds of the stages of each press in each checkout; the first turn is left out."""
    servers = [_start(each, [str(TURN)], stdin=subprocess.PIPE) for each in checkouts]
    try:
        (presses,) = {int(_answer(server)) for server in servers}
        # Shapes are made and code is compiled in the first turn.
        numbers = [*range(presses)] * (turns + 1)
        rows = []
        for number in tqdm(numbers, desc="presses", unit="press"):
            answers = []
            for server in servers:
                print(number, file=server.stdin, flush=True)
                answers.append(json.loads(_answer(server)))
            rows.append(tuple(answers))
    finally:
        for server in servers:
            server.kill()
            server.wait()
    return rows[presses:]


def _answer(server: subprocess.Popen) -> str:
    """The next line of a server, without the warnings before it."""
    assert server.stdout is not None
    for line in server.stdout:
        if line[0] in "{0123456789":
            return line
    raise T2TwinError(f"{server.args} ended")


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


def _median(values: Any) -> float:
    return float(np.median(list(values)))


def _pair_ms(folder: Path, out: Path) -> float:
    """Processor milliseconds of a pair of a whole dataset, made by one worker."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = "import sys; from t2twin.cli import main; main(sys.argv[1:])"
    with tempfile.TemporaryDirectory(dir=out) as place:
        options = ["--scale", SCALE, "--workers", "1", "--out", f"{place}/data"]
        process = _start(folder, ["-c", command, "simdata", *options], stderr=subprocess.STDOUT)
        said, _ = process.communicate()
    if process.returncode:
        raise T2TwinError(f"{folder} cannot be measured: {said.strip()[-500:]}")
    (pairs,) = PAIRS.findall(said)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = used.ru_utime - before.ru_utime + used.ru_stime - before.ru_stime
    return 1e3 * seconds / int(pairs)


def _start(checkout: Path, arguments: list[str], **streams: Any) -> subprocess.Popen:
    """A Python process that has a checkout's packages, and one thread."""
    return subprocess.Popen(
        [sys.executable, *arguments],
        cwd=checkout,
        env=os.environ
        | {"PYTHONPATH": str(checkout), "OMP_NUM_THREADS": "1"}
        | {VARIABLE: str(CHECKOUTS / "caches" / checkout.name)},  # models replace those of others
        stdout=subprocess.PIPE,
        text=True,
        **streams,
    )
