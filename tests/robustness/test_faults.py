"""Commands that are killed, stopped, out of disk space or run twice lose and leave nothing.

After each fault the same command, undisturbed, must give the same results.
"""

import hashlib
import json
import multiprocessing
import os
import runpy
import signal
import subprocess
import sys
import time
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from multiprocessing.context import ForkServerProcess
from pathlib import Path

import pytest
from cases import Content, laid
from session import Products
from waiting import PATIENCE_S

pytestmark = pytest.mark.exhaustive

STATUS = {signal.SIGKILL: -9, signal.SIGTERM: 143, signal.SIGINT: 130}

STOPS = ((signal.SIGKILL, 0.6), (signal.SIGTERM, 0.7), (signal.SIGINT, 0.4))
"""Signals, and their moments as parts of the undisturbed duration."""

BRIEF_STOPS = ((signal.SIGTERM, 0.7),)
"""Those of commands that do not resume; they differ little from each other."""

SERVER = multiprocessing.get_context("forkserver")
SERVER.set_forkserver_preload(
    ["t2twin.cli", "t2twin.twin", "t2twin.report", "t2twin.sim.dataset.generate",
     "t2twin.translate.training.train", "t2twin.translate.inference.files",
     "t2twin.translate.inference.load", "matplotlib.figure", "pyarrow.parquet"]
)  # fmt: skip
"""Commands are forked from a process with all modules, which costs no import."""

UNCOMPARED = {"log.jsonl", "tensorboard", "cache", "README.md"}
"""Files and folders with times, or of caches."""


@dataclass(frozen=True)
class Command:
    """A command without --out. out: its output. kilobytes: too little disk space for it. resumes:
    whether the same command continues after a stop."""

    words: str
    out: str = "out"
    kilobytes: int = 64
    resumes: bool = False


COMMANDS = {
    "simdata": Command("simdata --recipe mine.toml --workers 2", kilobytes=600, resumes=True),
    "train": Command("train resnet18 --data {data} --preset smoke --epochs 4", "out", 4000, True),
    "slide": Command("slide circle-1 --dx-mm 0.4 --steps 2"),
    "translate": Command("translate --run {run} frames"),
    "export": Command("export --run {run}", "out.onnx", 500),
    "import-pairs": Command("import-pairs pairs.csv", kilobytes=8),
    "convert": Command("convert {data} --to lerobot"),
    "report": Command("report --data {data}"),
}


@cache
def inputs() -> dict[str, Content]:
    """Pairs, frames, and a recipe of a few pairs."""
    from cases import PNG, encoded, frame
    from readers import PAIRS, RECIPE

    recipe = RECIPE.replace("count = 1", "count = 6").replace("presses = 1", "presses = 4")
    frames = {f"frames/{n}.png": encoded(frame(n)) for n in range(40)}
    return {**PAIRS, "mine.toml": recipe, "frames/last.png": PNG, **frames}


class Bench:
    """A command with its undisturbed results and duration, which all workers share."""

    def __init__(self, name: str, words: list[str], folder: Path, products: Products) -> None:
        self.command, self._words, self._folder, self._number = COMMANDS[name], words, folder, 0
        done = products.make(f"undisturbed/{name}", self._run_undisturbed)
        self.wanted = done / "box" / self.command.out
        self.seconds = float((done / "seconds").read_text())

    def _run_undisturbed(self, folder: Path) -> None:
        box, started = self.box(folder / "box"), time.monotonic()
        status, printed = end_of(self.start(box), box)
        assert status == 0, printed
        (folder / "seconds").write_text(str(time.monotonic() - started))

    def box(self, box: Path | None = None) -> Path:
        """A new folder with the inputs."""
        self._number += 1
        box = box or self._folder / str(self._number)
        box.mkdir(parents=True)
        laid(inputs())(box, None)  # pyright: ignore[reportArgumentType]
        return box

    def start(self, box: Path, out: str = "") -> ForkServerProcess:
        """Starts the command in the box, as the leader of a process group."""
        words = [*self._words, "--out", out or self.command.out]
        process = SERVER.Process(target=run, args=(words, box))
        process.start()
        return process

    def check_again(self, box: Path, out: str = "") -> None:
        """Runs the command once more, undisturbed, and compares the results."""
        status, printed = end_of(self.start(box, out), box)
        assert status == 0, printed
        self.check_results(box, out)

    def check_results(self, box: Path, out: str = "") -> None:
        assert digests(box / (out or self.command.out)) == digests(self.wanted)
        assert left_overs(box) == []


def run(words: list[str], box: Path) -> None:
    os.setsid()
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    os.chdir(box)
    stream = os.open(printed_to(box, os.getpid()), os.O_WRONLY | os.O_CREAT)
    for number in (1, 2):
        os.dup2(stream, number)
    sys.argv = ["t2twin", *words]
    runpy.run_module("t2twin", run_name="__main__", alter_sys=True)


def printed_to(box: Path, pid: int) -> Path:
    return box.with_name(f"{box.name}-{pid}.txt")


def end_of(process: ForkServerProcess, box: Path) -> tuple[int, str]:
    """Exit status and printed text, once no process of the command is left."""
    process.join(PATIENCE_S)
    assert process.pid is not None
    try:
        for _ in range(PATIENCE_S * 20):
            os.killpg(process.pid, 0)
            signal.sigtimedwait([], 0.05)
        os.killpg(process.pid, signal.SIGKILL)
        raise AssertionError(f"still running after {PATIENCE_S} s")
    except ProcessLookupError:
        process.join()
    assert process.exitcode is not None
    printed = printed_to(box, process.pid)
    return process.exitcode, printed.read_text() if printed.exists() else ""


def left_overs(box: Path) -> list[str]:
    """Half-written files, and locks."""
    return [path.name for path in box.rglob("*") if ".part" in path.name or path.suffix == ".lock"]


def digests(place: Path) -> dict[str, str]:
    """SHA-256 of the files that do not depend on time."""
    files = [place] if place.is_file() else sorted(p for p in place.rglob("*") if p.is_file())
    names = {path: path.relative_to(place) for path in files}
    return {str(n): _digest(p) for p, n in names.items() if not UNCOMPARED & set(n.parts)}


def _digest(path: Path) -> str:
    if path.suffix in (".html", ".safetensors") and path.name != "best.safetensors":
        return "exists"  # a page has its date; a state of training has durations
    if path.suffix == ".npz":
        with zipfile.ZipFile(path) as archive:  # has times of its own
            return repr([(n, archive.read(n)) for n in sorted(archive.namelist())])
    if path.name == "config.json":
        content = json.loads(path.read_text())
        return repr([content[key] for key in ("model", "preset", "seed", "epochs")])
    return hashlib.sha256(path.read_bytes()).hexdigest()


@contextmanager
def small_disk(folder: Path, kilobytes: int) -> Iterator[Path]:
    """A disk of that size below the folder. Skips where none can be mounted."""
    place = folder / "disk"
    place.mkdir()
    if _mount("-t", "tmpfs", "-o", f"size={kilobytes}k", "tmpfs", str(place)):
        pytest.skip("only root can mount a small disk")
    try:
        yield place
    finally:
        subprocess.run(["umount", "-l", str(place)], check=True)


def _mount(*words: str) -> int:
    return subprocess.run(["mount", *words], check=False, capture_output=True).returncode


@pytest.fixture(scope="module")
def bench(request, small_dataset, trained, products, tmp_path_factory):
    paths = {"{data}": small_dataset, "{run}": trained("resnet18", small_dataset, 1)}
    words = [str(paths.get(word, word)) for word in COMMANDS[request.param].words.split()]
    return Bench(request.param, words, tmp_path_factory.mktemp(request.param), products)


@pytest.mark.parametrize(
    "bench, number, moment",
    [
        (name, *stop)
        for name, command in COMMANDS.items()
        for stop in (STOPS if command.resumes else BRIEF_STOPS)
    ],
    indirect=["bench"],
)
def test_a_stopped_command_can_be_repeated(bench, number, moment):
    box = bench.box()
    process = bench.start(box)
    process.join(moment * bench.seconds)
    if process.is_alive():
        assert process.pid is not None
        os.kill(process.pid, number)
    status, printed = end_of(process, box)
    out = box / bench.command.out
    is_complete = out.exists() and digests(out) == digests(bench.wanted)
    # At its very end Python has given the signals back to the system.
    assert status in (0, STATUS[number]) or (is_complete and status == -number), printed
    # Python itself ends on Ctrl-C while it loads modules; a signal that early leaves no message.
    is_loading = not printed.strip() or (number == signal.SIGINT and "importlib" in printed)
    assert is_loading or "Traceback" not in printed
    if number != signal.SIGKILL and status > 0:
        end = "continues from its last saved state" if bench.command.resumes else "begins again"
        assert is_loading or f"t2twin: stopped; the same command {end}" in printed, printed
        assert left_overs(box) == []
        assert bench.command.resumes or not (box / bench.command.out).exists()
    if bench.command.resumes or not is_complete:  # others refuse to replace complete results
        bench.check_again(box)


@pytest.mark.parametrize("bench", COMMANDS, indirect=True)
def test_a_full_disk_is_reported(bench):
    box, out = bench.box(), f"disk/{bench.command.out}"
    with small_disk(box, bench.command.kilobytes) as disk:
        status, printed = end_of(bench.start(box, out), box)
        says = "no space left", "no room"
        assert status == 2 and any(each in printed.lower() for each in says), printed
        assert "Traceback" not in printed and printed.count("t2twin: ") == 1, printed
        assert left_overs(box) == []
        assert bench.command.resumes or not (disk / bench.command.out).exists()
        _mount("-o", "remount,size=200m", str(disk))
        bench.check_again(box, out)
