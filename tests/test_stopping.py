"""Ctrl-C and SIGTERM: a message, the shells' exit status, and nothing half-written."""

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
    read_file,
    temporary_folder,
    write_json,
)

STATUS = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGHUP: 129}


def default_signals():
    """In the child: signals do what they do by default, though a shell had it ignore some."""
    for number in STATUS:
        signal.signal(number, signal.SIG_DFL)


def check_stop(number, folder, first, *words):
    """Runs Python code up to its first line, and stops it."""
    process = subprocess.Popen(
        [sys.executable, "-c", *words], preexec_fn=default_signals,
        cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stdout is not None and process.stdout.readline() == f"{first}\n"
    process.send_signal(number)
    out, err = process.communicate(timeout=PATIENCE_S)
    assert (out, err) == ("", "t2twin: stopped; the same command begins again\n")
    assert process.returncode == STATUS[number]
    assert list(folder.iterdir()) == []


WRITING = """
import signal
from pathlib import Path
from t2twin.core.files import atomic_write, install_handlers, locked, temporary_folder
install_handlers()
folder = Path("a/b")
with locked(folder), temporary_folder(folder, "c"), atomic_write(folder / "c.txt") as temporary:
    temporary.write_text("half")
    print("written", flush=True)
    signal.pause()
"""
"""Writes a file and a folder, and waits for a signal."""

LOADING = """
import contextlib, runpy, signal, sys

MODULE = sys.argv[1]

class Halt:
    def find_spec(self, name, path=None, target=None):
        if name == MODULE:
            with contextlib.suppress(BaseException):
                print(name, flush=True)
                signal.pause()

sys.meta_path.insert(0, Halt())
sys.argv[1:] = ["press", "square-2", "--out", "out"]
runpy.run_module("t2twin", run_name="__main__", alter_sys=False)
"""
"""A press that halts in an import, of the named module, in which every exception is caught."""


@pytest.mark.parametrize(
    ("number", "module"), [(signal.SIGTERM, "t2twin.cli"), (signal.SIGINT, "mujoco")]
)
def test_a_command_is_stopped_while_it_is_being_loaded(number, module, tmp_path):
    check_stop(number, tmp_path, module, LOADING, module)


@pytest.mark.parametrize("number", STATUS)
def test_half_written_files_are_removed(number, tmp_path):
    check_stop(number, tmp_path, "written", WRITING)


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


def test_what_a_killed_process_left_locks_nothing_and_is_removed(tmp_path):
    (tmp_path / LOCK).touch()
    (tmp_path / ".weights.1.part.txt").touch()
    (tmp_path / ".folder.1.part").mkdir()
    (tmp_path / ".folder.1.part/inside").touch()
    (tmp_path / ".hidden").touch()
    with locked(tmp_path):
        pass
    assert [path.name for path in tmp_path.iterdir()] == [".hidden"]


@pytest.mark.parametrize("place", ["file", "file/below", "file/far/below"])
def test_a_file_in_the_way_is_named(place, tmp_path):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(T2TwinError, match="file"), locked(tmp_path / place):
        pass
    with pytest.raises(T2TwinError, match="file"), atomic_write(tmp_path / "file" / "x.txt"):
        pass
    assert (tmp_path / "file").read_text() == "mine"


@pytest.mark.parametrize("lay", [Path.mkdir, os.mkfifo, lambda path: path.symlink_to("/dev/null")])
def test_only_files_are_replaced(lay, tmp_path):
    path = tmp_path / "x.json"
    lay(path)
    before = path.lstat()
    with pytest.raises(T2TwinError, match=r"x\.json cannot be written: it is a"):
        write_json(path, {})
    after = path.lstat()
    assert (after.st_ino, after.st_mode) == (before.st_ino, before.st_mode)
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


@pytest.mark.parametrize(
    "lay, words",
    [
        (os.mkfifo, "is a folder or a device"),
        (Path.mkdir, "is a folder or a device"),
        (lambda path: None, "there is no file .*it; give another"),
        (lambda path: path.symlink_to(path.name), "cannot be read"),
        (lambda path: path.write_bytes(bytes(1001)), "at most 0 MB"),
    ],
)
def test_only_files_are_read(lay, words, tmp_path):
    lay(tmp_path / "it")
    with pytest.raises(T2TwinError, match=words):
        read_file(tmp_path / "it", max_bytes=1000, otherwise="give another")
