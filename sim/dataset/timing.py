"""Processor time by stage, and memory, of the making of a dataset."""

import os
import platform
import resource
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

STAGES = (
    "press source",
    "press target",
    "read source",
    "read target",
    "motion",
    "dense counts",
    "light",
    "encoding",
    "writing",
    "shape",
)
"""Stages of a shard. "shape" is done once for all presses of a shape; "dense counts", "light" and
"motion" only where the recipe has dense counts, samples the light or has motion."""

STATUS = Path("/proc/self/status")
"""File with the memory of this process on Linux."""


@dataclass
class Stopwatch:
    """Processor time by stage, s, summed over many pairs."""

    seconds: dict[str, float] = field(default_factory=lambda: dict.fromkeys(STAGES, 0.0))

    @contextmanager
    def running(self, stage: str) -> Iterator[None]:
        """Add the processor time of the block to a stage."""
        start = time.process_time()
        try:
            yield
        finally:
            self.seconds[stage] += time.process_time() - start

    def add(self, other: "Stopwatch") -> None:
        for stage, seconds in other.seconds.items():
            self.seconds[stage] += seconds

    @property
    def total(self) -> float:
        return sum(self.seconds.values())


def peak_memory() -> int:
    """Peak memory of this process, bytes.

    On Linux from the process's status: getrusage includes the memory of the parent before exec.
    """
    if STATUS.is_file():
        for line in STATUS.read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    unit = 1 if sys.platform == "darwin" else 1024  # of getrusage, bytes
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def process_name() -> str:
    """A name of this process that is unique in a cluster."""
    return f"{platform.node()}:{os.getpid()}"


@dataclass(frozen=True)
class RunTiming:
    """Time and memory of one run of `t2twin simdata`: a line of the dataset's log.jsonl.

    ended: the time, UTC, ISO 8601. seconds: of the whole run. stage_seconds: processor time of all
    pairs by stage. peak_memory_bytes: the sum of all processes' peaks. rejected: attempts at
    presses that were rejected, by reason.
    """

    ended: str
    pairs: int
    workers: int
    seconds: float
    stage_seconds: dict[str, float]
    peak_memory_bytes: int
    rejected: dict[str, int] = field(default_factory=dict)


def summary(run: RunTiming) -> str:
    """The text printed after a run: pairs per second, stages of a pair, memory."""
    stages = ", ".join(
        f"{stage} {1e3 * run.stage_seconds[stage] / run.pairs:.1f}"
        for stage in STAGES
        if stage != "shape" and run.stage_seconds[stage]
    )
    busy = sum(run.stage_seconds.values()) / (run.workers * run.seconds)
    rejected = "".join(
        f"{count} presses rejected and sampled again: {reason}\n"
        for reason, count in run.rejected.items()
    )
    return (
        f"{run.pairs} pairs in {run.seconds:.0f} s with {run.workers} workers: "
        f"{run.pairs / run.seconds:.1f} pairs/s, workers busy {100 * busy:.0f} % of the time\n"
        f"processor time of a pair, ms: {stages}; and {run.stage_seconds['shape']:.1f} s to load "
        f"the shapes\n{rejected}"
        f"peak memory of all processes together: {run.peak_memory_bytes / 2**30:.2f} GiB"
    )
