"""A command that runs out of memory prints one sentence."""

import errno
import os

import mujoco
import pytest

from t2twin.cli import main
from t2twin.core.errors import is_out_of_memory


def test_exceptions_of_libraries_are_recognized():
    assert is_out_of_memory(MemoryError())
    assert is_out_of_memory(RuntimeError("DefaultCPUAllocator: can't allocate memory"))
    assert is_out_of_memory(RuntimeError("std::bad_alloc"))
    fatal = mujoco.FatalError("Could not allocate memory")  # pyright: ignore[reportAttributeAccessIssue]
    assert is_out_of_memory(fatal)
    assert is_out_of_memory(OSError(errno.ENOMEM, os.strerror(errno.ENOMEM)))
    assert not is_out_of_memory(RuntimeError("another fault"))
    assert not is_out_of_memory(ValueError("cannot allocate"))


def test_a_command_without_memory_prints_a_sentence(monkeypatch, capsys):
    def out_of_memory(given):
        raise MemoryError

    monkeypatch.setattr("t2twin.cli._run", out_of_memory)
    with pytest.raises(SystemExit) as stop:
        main(["shapes"])
    error = capsys.readouterr().err
    assert stop.value.code == 2 and "there is not enough memory" in error
    assert error.count("\n") == 1
