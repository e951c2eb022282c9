"""Bad inputs to every command, and odd ones that are fine: none may surprise a user.

python -m benchmarks.bad_inputs [KIND ...]
"""

import subprocess
import sys
import tempfile
import time
from argparse import Namespace
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from tqdm import tqdm

from benchmarks.declared import BAD_INPUTS
from benchmarks.evidence.run import main
from benchmarks.inputs import (
    adaptations,
    arguments,
    caches,
    calibrations,
    datasets,
    folders,
    images,
    layouts,
    live,
    outputs,
    python_api,
    runs,
    shapes,
    studio_messages,
    tables,
    worlds,
)
from benchmarks.inputs.case import REFUSED, Base, Case
from benchmarks.inputs.tried import Tried, connections, guard_connections, try_case
from t2twin.core.errors import T2TwinError

KINDS: dict[str, Callable[[], Iterator[Case]]] = {
    "arguments": arguments.cases,
    "images": images.cases,
    "layouts": layouts.cases,
    "calibrations": calibrations.cases,
    "adaptations": adaptations.cases,
    "tables": tables.cases,
    "datasets": datasets.cases,
    "runs": runs.cases,
    "shapes": shapes.cases,
    "caches": caches.cases,
    "folders": folders.cases,
    "worlds": worlds.cases,
    "python_api": python_api.cases,
    "live": live.cases,
    "outputs": outputs.cases,
    "studio_messages": studio_messages.cases,
}
"""What is tried, by what is bad about it."""

SHAPES = ("circle-1", "square-1", "hemisphere-4", "line-sharp-4", "square-3", "circle-3",
          "wrench/shank", "allen-key/long-arm")  # fmt: skip
"""Of the dataset that is spoilt: some to train on, to validate with and to test with."""

MEASURE_MEMORY = """
import resource, subprocess, sys
status = subprocess.run(sys.argv[1:], stderr=subprocess.DEVNULL).returncode
print(status, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""


def measure(options: Namespace) -> dict[str, Any]:
    start = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="t2twin-inputs-") as folder:
        base = make_base(Path(folder) / "base")
        bombs_gib = memory_of_bombs(base, Path(folder))
        tried = {kind: try_kind(kind, base, Path(folder)) for kind in KINDS}
    everything = [each for kind in tried.values() for each in kind]
    return {
        "tried": len(everything),
        "odd_but_fine": sum(each.case.fine for each in everything),
        "unclean": sum(bool(each.faults) for each in everything),
        "connections": len(connections),
        "bombs_gib": round(bombs_gib, 2),
        "minutes": round((time.monotonic() - start) / 60, 1),
        "slowest_seconds": round(max(each.seconds for each in everything), 1),
        "by_kind": {
            kind: {"tried": len(each), "unclean": sum(bool(one.faults) for one in each)}
            for kind, each in tried.items()
        },
        "faults": {
            f"{kind}: {one.case.name}": list(one.faults)
            for kind, each in tried.items()
            for one in each
            if one.faults
        },
    }


def make_base(folder: Path) -> Base:
    """Makes the inputs that are spoilt: a dataset, both runs of one epoch, their evaluation."""
    from t2twin.sim.dataset.generate import make_dataset
    from t2twin.translate.evaluation.evaluate import evaluate_both
    from t2twin.translate.training.train import train

    base = Base(*(folder / name for name in ("data", "touch2touch", "resnet18", "evaluation")))
    make_dataset(base.data, "smoke", workers=1, shapes=SHAPES)
    for model, run in (("touch2touch", base.touch2touch), ("resnet18", base.resnet18)):
        train(model, base.data, "smoke", run, epochs=1)
    evaluate_both([base.touch2touch, base.resnet18], base.data, base.evaluation)
    return base


def memory_of_bombs(base: Base, folder: Path) -> float:
    """The most memory that `t2twin translate` takes of eight pictures of 1.4 GB each, GiB."""
    (folder / "bombs").mkdir()
    for number in range(8):
        (folder / f"bombs/{number}.png").write_bytes(images.bomb())
    words = [
        "translate",
        "--run",
        str(base.resnet18),
        str(folder / "bombs"),
        "--out",
        str(folder / "none"),
    ]
    # From a small process: a child's greatest memory counts what it was forked from.
    measured = [sys.executable, "-c", MEASURE_MEMORY, sys.executable, "-m", "t2twin", *words]
    said = subprocess.run(measured, capture_output=True, text=True, check=True).stdout
    status, kibibytes = map(int, said.split())
    if status != REFUSED:
        raise T2TwinError(f"eight bombs ended with {status}")
    return kibibytes / 2**20


def try_kind(kind: str, base: Base, folder: Path) -> list[Tried]:
    """Tries all cases of a kind, each in a new folder below `folder`."""
    guard_connections()
    cases = list(KINDS[kind]())
    (folder / kind).mkdir()
    return [
        try_case(case, base, folder / kind / str(number))
        for number, case in enumerate(tqdm(cases, desc=kind, unit="input"))
    ]


if __name__ == "__main__":
    main(BAD_INPUTS)
