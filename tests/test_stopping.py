"""Ctrl-C and SIGTERM: one sentence, the shells' exit status, and nothing half-written."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from waiting import PATIENCE_S

from t2twin.core.errors import T2TwinError
from t2twin.core.files import (
    LOCK,
    atomic_write,
    locked,
    move_into,
    remove_leftovers,
    temporary_folder,
    write_json,
)

STATUS = {signal.SIGINT: 130, signal.SIGTERM: 143}


def heed():
    """In the child: signals do what they do by default, though a shell had it ignore some."""
    for number in STATUS:
        signal.signal(number, signal.SIG_DFL)


WRITING = """
import os, signal, sys
from pathlib import Path
from t2twin.core.files import locked
from t2twin.core.files import atomic_write
from t2twin.core.signals import Stopped, install_handlers, report_stop
install_handlers()
try:
    with locked(Path("a/b")), atomic_write(Path("a/b/c.txt")) as temporary:
        temporary.write_text("half")
        {then}
except Stopped as stop:
    sys.exit(report_stop(stop.number))
"""

TELL = "print(sorted(os.listdir('a/b')), flush=True); signal.pause()"
"""Tells what is in the folder, and waits for a signal."""

LOADING = """
import runpy, signal, sys

MODULE = sys.argv[1]

class Halt:
    def find_spec(self, name, path=None, target=None):
        if name == MODULE:
            print(name, flush=True)
            signal.pause()

sys.meta_path.insert(0, Halt())
sys.argv[1:] = ["press", "square-2", "--out", "out"]
runpy.run_module("t2twin", run_name="__main__", alter_sys=False)
"""
"""A press that halts where it imports the module that its command line names."""


@pytest.mark.parametrize(
    ("number", "module"),
    [
        (signal.SIGTERM, "t2twin.cli"),
        (signal.SIGINT, "numpy"),
        (signal.SIGTERM, "t2twin.twin"),
        (signal.SIGINT, "numba"),
    ],
)
def test_a_command_is_stopped_while_it_is_being_loaded(number, module, tmp_path):
    process = subprocess.Popen(
        [sys.executable, "-c", LOADING, module],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        preexec_fn=heed,
    )  # fmt: skip
    assert process.stdout is not None and process.stdout.readline() == f"{module}\n"
    process.send_signal(number)
    said = process.communicate(timeout=PATIENCE_S)[1]
    assert said == "t2twin: stopped; the same command begins again\n"
    assert process.returncode == STATUS[number]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("number", STATUS)
def test_a_command_is_stopped_at_once(number, tmp_path):
    """Python itself may not have started yet, so that it ends without a sentence."""
    process = subprocess.Popen(
        [sys.executable, "-m", "t2twin", "press", "square-2", "--out", "out"],
        cwd=tmp_path, stderr=subprocess.PIPE, text=True, preexec_fn=heed,
    )  # fmt: skip
    process.send_signal(number)
    process.communicate(timeout=PATIENCE_S)
    assert process.returncode != 0
    assert list(tmp_path.iterdir()) == []


def stopped_while_writing(then, tmp_path, *numbers):
    """Runs WRITING, sends a signal after each line that it prints, and returns its end."""
    process = subprocess.Popen(
        [sys.executable, "-c", WRITING.format(then=then)],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        preexec_fn=heed,
    )  # fmt: skip
    assert process.stdout is not None
    told = []
    for number in numbers:
        told.append(process.stdout.readline())
        process.send_signal(number)
    said = process.communicate(timeout=PATIENCE_S)[1]
    assert said == "t2twin: stopped; the same command begins again\n"
    assert process.returncode == STATUS[numbers[-1]]
    return told


@pytest.mark.parametrize("number", STATUS)
def test_what_is_half_written_goes(number, tmp_path):
    (there,) = stopped_while_writing(TELL, tmp_path, number)
    assert LOCK in there and ".part.txt" in there
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("number", STATUS)
def test_what_is_half_written_goes_where_a_signal_comes_in_an_import(number, tmp_path):
    """An exception in there may become an ImportError."""
    (tmp_path / "slow.py").write_text(
        f"import os, signal\ntry:\n    {TELL}\nexcept BaseException:\n    raise ImportError\n"
    )
    (there,) = stopped_while_writing("import slow", tmp_path, number)
    assert LOCK in there and ".part.txt" in there
    assert [path.name for path in tmp_path.iterdir() if path.name != "__pycache__"] == ["slow.py"]


def test_a_second_signal_ends_what_does_not_end(tmp_path):
    then = f"""
        try:
            {TELL}
        except Stopped:
            {TELL}"""
    stopped_while_writing(then, tmp_path, signal.SIGTERM, signal.SIGINT)
    assert list(tmp_path.iterdir()) == []


def test_one_writer_a_folder(tmp_path):
    with locked(tmp_path / "out"):
        with (
            pytest.raises(T2TwinError, match="another t2twin is writing into"),
            locked(tmp_path / "out"),
        ):
            pass
        with locked(tmp_path / "beside"):
            pass
        (tmp_path / "out/file").touch()
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["file", "out"]
    with locked(tmp_path / "out"):
        pass


def test_a_lock_that_a_killed_process_left_locks_nothing(tmp_path):
    (tmp_path / LOCK).touch()
    with locked(tmp_path):
        pass
    assert list(tmp_path.iterdir()) == []


def test_only_what_the_dead_were_writing_is_swept(tmp_path):
    dead = subprocess.run([sys.executable, "-c", "import os; print(os.getpid())"],
                          capture_output=True, text=True, check=True).stdout.strip()  # fmt: skip
    (tmp_path / f".weights.{dead}.part.txt").touch()
    (tmp_path / f".folder.{dead}.part").mkdir()
    (tmp_path / f".folder.{dead}.part/inside").touch()
    mine = tmp_path / f".mine.{os.getpid()}.part.txt"
    (tmp_path / ".hidden").touch()
    mine.touch()
    remove_leftovers(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == [".hidden", mine.name]


def test_an_error_inside_is_not_taken_for_one_of_the_folder(tmp_path):
    with pytest.raises(FileNotFoundError), locked(tmp_path / "out"):
        Path("nowhere").read_text()
    with pytest.raises(FileNotFoundError), temporary_folder(tmp_path, "x"):
        Path("nowhere").read_text()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("place", ["file", "file/below", "file/far/below"])
def test_a_file_in_the_way_is_named(place, tmp_path):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(T2TwinError, match="is a file, or lies below one"), locked(tmp_path / place):
        pass
    with (
        pytest.raises(T2TwinError, match="is a file, or lies below one"),
        atomic_write(tmp_path / "file" / "x.txt") as temporary,
    ):
        temporary.touch()
    assert (tmp_path / "file").read_text() == "mine"


@pytest.mark.parametrize("kind", ["folder", "pipe", "device"])
def test_only_files_are_replaced(kind, tmp_path):
    path = tmp_path / "x.json"
    if kind == "folder":
        path.mkdir()
    elif kind == "pipe":
        os.mkfifo(path)
    else:
        path.symlink_to("/dev/null")
    before = path.lstat()
    with pytest.raises(T2TwinError, match=r"x\.json cannot be written: it is a"):
        write_json(path, {})
    after = path.lstat()
    assert (after.st_ino, after.st_mode) == (before.st_ino, before.st_mode)
    assert after.st_mtime_ns == before.st_mtime_ns
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_that_was_made_for_nothing_goes(tmp_path):
    with pytest.raises(KeyError), atomic_write(tmp_path / "new/folder/x.txt"):
        raise KeyError
    assert list(tmp_path.iterdir()) == []


def test_files_are_moved_all_or_none(tmp_path):
    (tmp_path / "b").mkdir()
    with temporary_folder(tmp_path, "new") as folder:
        for name in ("a", "b"):
            (folder / name).touch()
        with pytest.raises(T2TwinError, match="b cannot be written"):
            move_into(tmp_path, sorted(folder.iterdir()))
    assert [path.name for path in tmp_path.iterdir()] == ["b"]
