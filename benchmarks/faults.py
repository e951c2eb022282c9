"""Commands killed, stopped, out of room, run twice at once: nothing lost, nothing left.

    python -m benchmarks.faults [--seed 0] [--commands NAME ...]

For every command: SIGKILL, SIGTERM and Ctrl-C at random moments, one of them in the first half
second; a disk that is full; two of the same at once; a folder that cannot be written; no home.
After each the same command, undisturbed, must end as if nothing had been.
"""

import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from argparse import Namespace
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tqdm import tqdm

from benchmarks.bad_inputs import make_base
from benchmarks.declared import FAULTS
from benchmarks.evidence.run import main
from benchmarks.inputs.calibrations import BALL_MM, ball_frames
from benchmarks.inputs.case import Base
from benchmarks.inputs.images import PNG, frame
from benchmarks.inputs.results import same_results
from benchmarks.inputs.tables import good_pairs
from t2twin.core.errors import T2TwinError

STATUS = {signal.SIGKILL: -9, signal.SIGTERM: 143, signal.SIGINT: 130}
LOADING_SECONDS = 0.5
"""The first half second, in which nothing but loading happens."""
PATIENCE_SECONDS = 120
"""How long a command may take, s; longer is a hang."""


@dataclass(frozen=True)
class Command:
    """One command. words: its arguments but --out. out: what it writes, in its folder.
    kilobytes: room that is too little for it. resumes: whether it goes on where it stopped."""

    name: str
    words: tuple[str, ...]
    out: str = "out"
    kilobytes: int = 64
    resumes: bool = False


def commands(base: Base) -> dict[str, Command]:
    data, run = str(base.data), str(base.resnet18)
    listed = (
        Command("simdata", ("--scale", "smoke", "--workers", "2"), kilobytes=2000, resumes=True),
        Command("train", ("resnet18", "--data", data, "--preset", "smoke", "--epochs", "4"),
                kilobytes=4000, resumes=True),
        Command("translate", ("--run", run, "frames")),
        Command("export", ("--run", run), out="out.onnx", kilobytes=500),
        Command("import-pairs", ("pairs.csv",), kilobytes=8),
        Command("calibrate", ("--background", "background.png", "--presses", "presses",
                              "--ball-diameter-mm", str(BALL_MM), "--held-out", "2")),
        Command("report", ("--data", data)),
    )  # fmt: skip
    return {command.name: command for command in listed}


@dataclass
class Bench:
    """One command with the results that it has undisturbed, and a folder for each fault."""

    command: Command
    base: Base
    folder: Path
    seconds: float = 0.0
    wanted: Path = field(default_factory=Path)
    number: int = 0

    def box(self) -> Path:
        """A new folder with the command's inputs."""
        self.number += 1
        box = self.folder / f"{self.command.name}-{self.number}"
        box.mkdir()
        good_pairs(box, self.base)
        ball_frames(box, self.base)
        (box / "frames").mkdir()
        for number in range(40):
            frame(number).save(box / f"frames/{number}.png")
        (box / "frames/last.png").write_bytes(PNG)
        return box

    def start(
        self, box: Path, out: str | None = None, env: dict[str, str] | None = None
    ) -> subprocess.Popen[str]:
        words = [self.command.name, *self.command.words, "--out", out or self.command.out]
        return subprocess.Popen(
            [sys.executable, "-m", "t2twin", *words],
            cwd=box,
            env=env,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            preexec_fn=_heeding,
        )

    def undisturbed(self) -> None:
        """Runs the command once, for its results and how long it takes."""
        box = self.box()
        start = time.monotonic()
        _, said = ended(self.start(box), 0)
        self.seconds = time.monotonic() - start
        self.wanted = box / self.command.out
        if not self.wanted.exists():
            raise T2TwinError(f"{self.command.name} made nothing: {said[-300:]}")

    def again(self, box: Path, out: str | None = None) -> list[str]:
        """The same command once more, undisturbed; what is wrong with its results."""
        ended(self.start(box, out), 0)
        place = box / (out or self.command.out)
        wrong = [] if same_results(self.wanted, place) else ["its results are others"]
        return wrong + left_overs(box)


def _heeding() -> None:
    """In the child: signals do what they do by default, though a shell had it ignore some."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)


def ended(process: subprocess.Popen[str], wanted: int | None = None) -> tuple[int, str]:
    """Exit status and what was said. Raises T2TwinError for a hang, and another status than the
    wanted one."""
    try:
        out, err = process.communicate(timeout=PATIENCE_SECONDS)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        raise T2TwinError(f"{process.args} did not end in {PATIENCE_SECONDS} s") from None
    if wanted is not None and process.returncode != wanted:
        raise T2TwinError(f"{process.args} ended with {process.returncode}: {err[-300:]}")
    return process.returncode, out + err


def left_overs(box: Path) -> list[str]:
    """Half-written files, and locks."""
    return [
        f"left {path.relative_to(box)}"
        for path in sorted(box.rglob("*"))
        if ".part" in path.name or path.name.endswith(".lock")
    ]


def wait_for_group(process: subprocess.Popen[str]) -> list[str]:
    """Waits until no process of a command is left."""
    start = time.monotonic()
    while time.monotonic() < start + PATIENCE_SECONDS:
        try:
            os.killpg(process.pid, 0)
        except ProcessLookupError:
            return []
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGKILL)
    return ["processes of it were still there"]


def stopped(bench: Bench, number: signal.Signals, moment_s: float) -> list[str]:
    """A signal at a moment, to the command's own process."""
    box = bench.box()
    process = bench.start(box)
    try:
        process.wait(moment_s)
    except subprocess.TimeoutExpired:
        process.send_signal(number)
    status, said = ended(process)
    wrong = wait_for_group(process)
    if status not in (0, STATUS[number]):
        wrong.append(f"status {status}")
    if number != signal.SIGKILL and status:
        after = "continues from here" if bench.command.resumes else "begins again"
        sentence = f"t2twin: stopped; the same command {after}"
        if moment_s > LOADING_SECONDS / 2 and sentence not in said:
            wrong.append(f"said {said[-200:]!r}")
        wrong += left_overs(box)
        if not bench.command.resumes and (box / bench.command.out).exists():
            wrong.append("left its folder")
    if "Traceback" in said and (number == signal.SIGTERM or moment_s > LOADING_SECONDS / 2):
        wrong.append(f"a traceback: {said[-900:]!r}")
    return wrong + ([] if status == 0 and not bench.command.resumes and bench.command.name in
                    ("import-pairs",) else bench.again(box))  # fmt: skip


@contextmanager
def small_disk(folder: Path, kilobytes: int) -> Iterator[Path]:
    """A disk of that size, mounted below the folder. Raises T2TwinError where none can be."""
    place = folder / "disk"
    place.mkdir()
    mounted = _mount("-t", "tmpfs", "-o", f"size={kilobytes}k", "tmpfs", str(place))
    if not mounted:
        raise T2TwinError("a small disk can be mounted by root only")
    try:
        yield place
    finally:
        subprocess.run(["umount", "-l", str(place)], check=True)


def _mount(*words: str) -> bool:
    return subprocess.run(["mount", *words], check=False, capture_output=True).returncode == 0


def full_disk(bench: Bench) -> list[str]:
    """No room in the middle of it, then room again."""
    box = bench.box()
    with small_disk(box, bench.command.kilobytes) as disk:
        out = f"disk/{bench.command.out}"
        status, said = ended(bench.start(box, out))
        wrong = [] if status == 2 else [f"status {status}"]
        if "no space left" not in said.lower() and "no room" not in said.lower():
            wrong.append(f"said {said[-300:]!r}")
        if "Traceback" in said or len(_sentences(said)) != 1:
            wrong.append(f"not one sentence: {said[-600:]!r}")
        wrong += left_overs(box)
        if not bench.command.resumes and (disk / bench.command.out).exists():
            wrong.append("left its folder")
        _mount("-o", "remount,size=200m", str(disk))
        return wrong + bench.again(box, out)


def _sentences(said: str) -> list[str]:
    return [line for line in said.splitlines() if "t2twin: " in line]


def two_at_once(bench: Bench) -> list[str]:
    """The same command twice: one may be refused, the results must be whole."""
    box = bench.box()
    both = [bench.start(box), bench.start(box)]
    ends = [ended(process) for process in both]
    wrong = []
    if not any(status == 0 for status, _ in ends):
        wrong.append("neither ended well")
    for status, said in ends:
        refused = "another t2twin is writing" in said or "is not empty" in said
        if status and not (status == 2 and refused):
            wrong.append(f"status {status}, said {said[-200:]!r}")
    if not same_results(bench.wanted, box / bench.command.out):
        wrong.append("its results are others")
    return wrong + left_overs(box)


def read_only(bench: Bench) -> list[str]:
    """A disk that cannot be written."""
    box = bench.box()
    with small_disk(box, 1000) as disk:
        _mount("-o", "remount,ro", str(disk))
        status, said = ended(bench.start(box, f"disk/{bench.command.out}"))
        wrong = [] if status == 2 else [f"status {status}"]
        if "read-only" not in said or len(_sentences(said)) != 1 or "Traceback" in said:
            wrong.append(f"said {said[-300:]!r}")
        return wrong + left_overs(box)


def no_home(bench: Bench) -> list[str]:
    """No home, and none that could be made."""
    box = bench.box()
    env = {name: value for name, value in os.environ.items() if not name.startswith("XDG_")}
    env["HOME"] = "/proc/none"
    status, said = ended(bench.start(box, env=env))
    wrong = [] if status == 0 else [f"status {status}, said {said[-300:]!r}"]
    if "Warning" in said or "Traceback" in said:
        wrong.append(f"said {said[-300:]!r}")
    if not same_results(bench.wanted, box / bench.command.out):
        wrong.append("its results are others")
    return wrong + left_overs(box)


def faults_of(bench: Bench, rng: random.Random) -> Iterator[tuple[str, Callable[[], list[str]]]]:
    """All faults that are tried on a command, by name."""
    for number in STATUS:
        for moment_s in (rng.uniform(0.1, LOADING_SECONDS), rng.uniform(0.5, 0.95 * bench.seconds)):
            name = f"{number.name} after {moment_s:.2f} s"
            yield name, lambda number=number, at=moment_s: stopped(bench, number, at)
    yield "full disk", lambda: full_disk(bench)
    yield "two at once", lambda: two_at_once(bench)
    yield "read-only", lambda: read_only(bench)
    yield "no home", lambda: no_home(bench)


def measure(options: Namespace) -> dict[str, Any]:
    rng = random.Random(options.seed)
    tried: dict[str, dict[str, list[str]]] = {}
    with tempfile.TemporaryDirectory(prefix="t2twin-faults-") as folder:
        base = make_base(Path(folder) / "base")
        for name, command in commands(base).items():
            if options.commands and name not in options.commands:
                continue
            bench = Bench(command, base, Path(folder))
            bench.undisturbed()
            tried[name] = {}
            for fault, attempt in tqdm([*faults_of(bench, rng)], desc=name, unit="fault"):
                try:
                    tried[name][fault] = attempt()
                except T2TwinError as error:
                    tried[name][fault] = [str(error)]
                if tried[name][fault]:
                    tqdm.write(f"{name}, {fault}: {'; '.join(tried[name][fault])}")
    wrong = {
        f"{name}, {fault}": reasons
        for name, each in tried.items()
        for fault, reasons in each.items()
        if reasons
    }
    return {
        "tried": sum(map(len, tried.values())),
        "unclean": len(wrong),
        "by_command": {
            name: {"tried": len(each), "unclean": sum(map(bool, each.values()))}
            for name, each in tried.items()
        },
        "each": {name: list(each) for name, each in tried.items()},
        "wrong": wrong,
    }


if __name__ == "__main__":
    main(FAULTS)
