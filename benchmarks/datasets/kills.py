"""Runs of `t2twin simdata` that are killed repeatedly, compared with undisturbed runs.

    python -m benchmarks.datasets.kills [--kills 20] [--seed 0]

The datasets are the protocol's smallest scale and a world of random shapes in random light. Each
kill is SIGKILL at a random moment, to the main process or to all processes. In the first case the
workers must end by themselves. A dataset that is finished between two kills is compared, and the
next one begins.
"""

import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from argparse import Namespace
from pathlib import Path
from typing import Any

from benchmarks.evidence.record import Argument, Benchmark, Figure
from benchmarks.evidence.run import main
from t2twin.core.errors import T2TwinError
from t2twin.sim.dataset.store import INFO, read_info
from t2twin.sim.dataset.verify import verify_dataset

BENCHMARK = Benchmark(
    module="benchmarks.datasets.kills",
    measures="Whether a repeatedly killed run of simdata gives the same bytes.",
    minutes=4,
    sources=("primitives_cad", "sim", "t2twin/cli"),
    figures=(
        Figure("kills"),
        Figure("datasets"),
        Figure("datasets_unlike_undisturbed", most=0),
    ),
    arguments=(
        Argument("--kills", "how many; keeps nothing unless 20", int, 20, partial=True),
        Argument("--seed", "of the moments", int, 0),
    ),
)

SCALE = "smoke"
WORLD_PARTS, WORLD_SHAPES = 30, 3
"""Parts of the world, a shard each, and shapes in each."""

WORKERS = 2
PATIENCE_SECONDS = 60
"""How long the workers of a killed run may take to end, s."""


def measure(options: Namespace) -> dict[str, Any]:
    with tempfile.TemporaryDirectory(prefix="t2twin-kills-") as folder:
        recipe = Path(folder) / "killed.toml"
        recipe.write_text(world())
        asked = {"protocol": ["--scale", SCALE], "world": ["--world", str(recipe)]}
        of = {
            name: kill_again_and_again(what, options.kills, options.seed, Path(folder) / name)
            for name, what in asked.items()
        }
    totals = ("kills", "datasets", "datasets_unlike_undisturbed")
    return {total: sum(each[total] for each in of.values()) for total in totals} | {"of": of}


def world() -> str:
    """A recipe of many small shards, with all that a world's pairs may hold."""
    part = (
        f'[[parts]]\nshapes = "random"\ncount = {WORLD_SHAPES}\npresses = 2\n'
        "place = { normal_mm = 2.5 }\nforce_n = { low = 0.5, high = 12.0 }\n"
        "untouched_share = 0.1\n"
    )
    return 'format = 1\nname = "killed"\n' + WORLD_PARTS * part + '[light]\nkind = "drawn"\n'


def kill_again_and_again(asked: list[str], kills: int, seed: int, folder: Path) -> dict[str, Any]:
    """Kills so many runs of what is asked for below folder; what happened, and whether the shards
    came out the same."""
    rng = random.Random(seed)
    start = time.monotonic()
    _finish(asked, folder / "undisturbed")
    undisturbed_s = time.monotonic() - start
    wanted = _digests(folder / "undisturbed")
    records, same, number = [], [], 0
    while len(records) < kills:
        data = folder / f"killed-{number}"
        # Up to half of the whole: a dataset then meets several kills before it is finished.
        moment_s = rng.uniform(0, undisturbed_s / 2)
        process = _start(asked, data)
        try:
            _check_ended_well(process, process.wait(moment_s))
        except subprocess.TimeoutExpired:
            records.append({"dataset": number, **_kill(process, data, moment_s, rng)})
        else:
            same.append(_is_same(data, wanted))
            number += 1
    last = folder / f"killed-{number}"
    _finish(asked, last)
    same.append(_is_same(last, wanted))
    return {
        "workers": WORKERS,
        "kills": len(records),
        "datasets": len(same),
        "datasets_same_as_undisturbed": sum(same),
        "datasets_unlike_undisturbed": len(same) - sum(same),
        "undisturbed_seconds": round(undisturbed_s, 1),
        "shards": len(wanted),
        "each": records,
    }


def _kill(
    process: subprocess.Popen, data: Path, moment_s: float, rng: random.Random
) -> dict[str, Any]:
    """Kills a run, alone or with its workers, and tells what it left."""
    whole_group = rng.random() < 0.5
    kill = os.killpg if whole_group else os.kill
    kill(process.pid, signal.SIGKILL)
    process.wait()
    left_s = _wait_for_group(process.pid)
    return {
        "seconds": round(moment_s, 2),
        "killed": "all processes" if whole_group else "the run alone",
        "workers_ended_after_s": round(left_s, 2),
        "shards_whole": len(read_info(data).shards) if (data / INFO).exists() else 0,
        "files_in_the_making": len(list(data.rglob(".*.part*"))),
    }


def _start(asked: list[str], data: Path) -> subprocess.Popen:
    command = ["simdata", *asked, "--out", str(data), "--workers", str(WORKERS)]
    return subprocess.Popen(
        [sys.executable, "-m", "t2twin", *command],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )


def _finish(asked: list[str], data: Path) -> None:
    process = _start(asked, data)
    _check_ended_well(process, process.wait())


def _check_ended_well(process: subprocess.Popen, status: int) -> None:
    if status:
        raise T2TwinError(f"`{' '.join(map(str, process.args))}` ended with {status}")  # pyright: ignore[reportArgumentType]


def _wait_for_group(group: int) -> float:
    """Seconds until none of a killed run's processes is left."""
    start = time.monotonic()
    while time.monotonic() < start + PATIENCE_SECONDS:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return time.monotonic() - start
        time.sleep(0.02)
    raise T2TwinError(f"processes of the killed run {group} are still there")


def _is_same(data: Path, wanted: dict[str, str]) -> bool:
    return _digests(data) == wanted and not verify_dataset(data)


def _digests(data: Path) -> dict[str, str]:
    """The sha256 list of a finished dataset."""
    info = read_info(data)
    if not info.complete:
        raise T2TwinError(f"the dataset in {data} is unfinished though its run ended well")
    return {path: shard.sha256 for path, shard in info.shards.items()}


if __name__ == "__main__":
    main(BENCHMARK)
