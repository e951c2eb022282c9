"""Commands in processes that are forked from one with all modules, which costs no import."""

import multiprocessing
import os
import runpy
import signal
import sys
from multiprocessing.context import ForkServerProcess
from pathlib import Path

PATIENCE_S = 120
"""Longest duration of a command, s; longer is a hang."""

SERVER = multiprocessing.get_context("forkserver")
SERVER.set_forkserver_preload(
    ["t2twin.cli", "t2twin.twin", "t2twin.report", "t2twin.sim.dataset.generate",
     "t2twin.translate.training.train", "t2twin.translate.inference.files",
     "t2twin.translate.inference.load", "matplotlib.figure", "pyarrow.parquet"]
)  # fmt: skip


def start(words: list[str], box: Path) -> ForkServerProcess:
    """Starts `t2twin` with these words in the folder box, as the leader of a process group."""
    process = SERVER.Process(target=_run, args=(words, box))
    process.start()
    return process


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
    printed = _printed(box, process.pid)
    return process.exitcode, printed.read_text() if printed.exists() else ""


def _printed(box: Path, pid: int) -> Path:
    return box.with_name(f"{box.name}-{pid}.txt")


def _run(words: list[str], box: Path) -> None:
    os.setsid()
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    os.chdir(box)
    stream = os.open(_printed(box, os.getpid()), os.O_WRONLY | os.O_CREAT)
    for number in (1, 2):
        os.dup2(stream, number)
    sys.argv = ["t2twin", *words]
    runpy.run_module("t2twin", run_name="__main__", alter_sys=True)
