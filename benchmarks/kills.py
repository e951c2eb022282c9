"""A run of `t2twin simdata` killed again and again, against one left alone.

    python -m benchmarks.kills [--kills 20] [--seed 0]

Each kill is SIGKILL at a random moment, of the run alone (its workers must then end themselves) or
of all its processes at once. A dataset that gets finished between two kills is compared, and
another one begun. Kept in benchmarks/results/kills.json.
"""

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from t2twin.primitives_cad import catalogue
from t2twin.sim.dataset.info import versions
from t2twin.sim.dataset.store import INFO, read_info
from t2twin.sim.dataset.verify import verify

RESULT = Path(__file__).parent / "results" / "kills.json"
SCALE = "smoke"
WORKERS = 2
PATIENCE_SECONDS = 60
"""How long the workers of a killed run may take to end, s."""


def measure(kills: int, seed: int, folder: Path) -> dict[str, Any]:
    """Kills so many runs below folder; what happened, and whether the shards came out the same."""
    rng = random.Random(seed)
    start = time.monotonic()
    _start(folder / "undisturbed").wait()
    undisturbed_s = time.monotonic() - start
    wanted = _digests(folder / "undisturbed")
    records, same, number = [], [], 0
    while len(records) < kills:
        data = folder / f"killed-{number}"
        process = _start(data)
        # Up to half of the whole: a dataset then meets several kills before it is finished.
        moment = rng.uniform(0, undisturbed_s / 2)
        try:
            process.wait(moment)
            assert process.returncode == 0
            same.append(_digests(data) == wanted and not verify(data))
            number += 1
            continue
        except subprocess.TimeoutExpired:
            pass
        whole_group = rng.random() < 0.5
        kill = os.killpg if whole_group else os.kill
        kill(process.pid, signal.SIGKILL)
        process.wait()
        left_s = _wait_for_group(process.pid)
        done = len(read_info(data)["shards"]) if (data / INFO).exists() else 0
        part = len(list(data.rglob(".*.part*")))
        records.append(
            {
                "dataset": number,
                "seconds": round(moment, 2),
                "killed": "all processes" if whole_group else "the run alone",
                "workers_ended_after_s": round(left_s, 2),
                "shards_whole": done,
                "files_in_the_making": part,
            }
        )
        print(json.dumps(records[-1]), flush=True)
    last = folder / f"killed-{number}"
    assert _start(last).wait() == 0
    same.append(_digests(last) == wanted and not verify(last))
    return {
        "command": f"python -m benchmarks.kills --kills {kills} --seed {seed}",
        "scale": SCALE,
        "workers": WORKERS,
        "kills": len(records),
        "datasets": len(same),
        "datasets_same_as_undisturbed": sum(same),
        "undisturbed_seconds": round(undisturbed_s, 1),
        "shards": len(wanted),
        "versions": versions(),
        "each": records,
    }


def _start(data: Path) -> subprocess.Popen:
    command = ["simdata", "--scale", SCALE, "--out", str(data), "--workers", str(WORKERS),
               "--primitives", str(catalogue.CACHE_DIR.absolute())]  # fmt: skip
    return subprocess.Popen(
        [sys.executable, "-m", "translate", *command],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )


def _wait_for_group(group: int) -> float:
    """Seconds until none of a killed run's processes is left."""
    start = time.monotonic()
    while time.monotonic() < start + PATIENCE_SECONDS:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return time.monotonic() - start
        time.sleep(0.02)
    raise RuntimeError(f"processes of the killed run {group} are still there")


def _digests(data: Path) -> dict[str, str]:
    """The sha256 list of a finished dataset."""
    info = read_info(data)
    assert info["complete"]
    return {path: about["sha256"] for path, about in info["shards"].items()}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    place = Path(tempfile.mkdtemp(prefix="t2twin-kills-"))
    try:
        found = measure(arguments.kills, arguments.seed, place)
    finally:
        shutil.rmtree(place)
    RESULT.write_text(json.dumps(found, indent=1) + "\n")
    print(f"{found['kills']} kills, {found['datasets_same_as_undisturbed']} of "
          f"{found['datasets']} datasets the same as the undisturbed one")  # fmt: skip
    sys.exit(0 if found["datasets_same_as_undisturbed"] == found["datasets"] else 1)
