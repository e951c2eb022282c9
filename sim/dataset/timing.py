"""Where the time of a pair goes, and how much memory a process took."""

import os
import platform
import resource
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

STAGES = (
    "press digit",
    "press cyskin",
    "picture",
    "taxels",
    "field",
    "light",
    "encoding",
    "writing",
    "shape",
)
"""What the making of a shard is made of: a shape is prepared once for its presses, the field and
another light are made where a world has them."""


@dataclass
class Stopwatch:
    """Seconds of processor time by stage, added up over many pairs."""

    seconds: dict[str, float] = field(default_factory=lambda: dict.fromkeys(STAGES, 0.0))

    @contextmanager
    def running(self, stage: str) -> Iterator[None]:
        """Adds the processor time of the block to a stage."""
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
    """The most that this process has held, bytes.

    On Linux from the process's own status: getrusage counts what the process that started this one
    held before.
    """
    status = Path("/proc/self/status")
    if status.is_file():
        for line in status.read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def process_name() -> str:
    """This process's, unlike any other's of a cluster."""
    return f"{platform.node()}:{os.getpid()}"


@dataclass(frozen=True)
class RunTiming:
    """How one run of `t2twin simdata` went: a line of the dataset's log.jsonl.

    ended: the time, UTC, ISO 8601. seconds: of the whole run. stage_seconds: processor time by
    stage, of all pairs. peak_memory_bytes: the sum of all processes' peaks. redrawn: presses that
    were drawn again, by why.
    """

    ended: str
    pairs: int
    workers: int
    seconds: float
    stage_seconds: dict[str, float]
    peak_memory_bytes: int
    redrawn: dict[str, int] = field(default_factory=dict)


def in_words(run: RunTiming) -> str:
    """What a run says at its end: pairs a second, the stages of a pair, and memory."""
    stages = ", ".join(
        f"{stage} {1e3 * run.stage_seconds[stage] / run.pairs:.1f}"
        for stage in STAGES
        if stage != "shape" and run.stage_seconds[stage]
    )
    busy = sum(run.stage_seconds.values()) / (run.workers * run.seconds)
    again = "".join(f"{times} presses drawn again: {why}\n" for why, times in run.redrawn.items())
    return (
        f"{run.pairs} pairs in {run.seconds:.0f} s with {run.workers} workers: "
        f"{run.pairs / run.seconds:.1f} pairs/s, workers busy {100 * busy:.0f} % of the time\n"
        f"processor time of a pair, ms: {stages}; and {run.stage_seconds['shape']:.1f} s to load "
        f"the shapes\n{again}"
        f"peak memory of all processes together: {run.peak_memory_bytes / 2**30:.2f} GiB"
    )
