"""Compiling in a second process, and the studio that listens before slow imports."""

import os
import subprocess
import sys

import pytest

from t2twin import compile_ahead
from t2twin.core.cache_dir import VARIABLE

SLOW = ("torch", "cadquery", "numba", "mujoco", "trimesh")
"""What takes long to import."""


def test_it_listens_before_anything_slow_is_imported():
    script = (
        "import sys\n"
        "from t2twin.studio.server import studio\n"
        f"assert not set({SLOW}) & set(sys.modules), set({SLOW}) & set(sys.modules)\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


HELPER = (sys.executable, "-m", "t2twin.compile_ahead")


@pytest.mark.exhaustive
def test_the_second_process_compiles_all_that_an_image_needs(tmp_path):
    """After it an image leaves nothing new in the cache."""
    environment = os.environ | {VARIABLE: str(tmp_path), "NUMBA_CACHE_DIR": ""}

    def run(*command):
        with subprocess.Popen(command, env=environment, stdin=subprocess.PIPE) as process:
            assert process.wait() == 0
        return {path.name for path in tmp_path.rglob("*.nbi") if "optical-" in str(path)}

    made = run(*HELPER)
    press = "import t2twin; t2twin.press('random-17')"
    assert made and run(sys.executable, "-c", press) == made


def test_the_second_process_ends_with_the_first():
    with subprocess.Popen(HELPER, stdin=subprocess.PIPE) as process:
        assert process.stdin is not None
        process.stdin.close()
        assert process.wait(60) == 0


def test_it_compiles_only_where_nothing_is_kept(tmp_path, monkeypatch):
    started = []
    monkeypatch.setattr(
        compile_ahead.subprocess, "Popen", lambda *given, **_: started.append(given)
    )
    monkeypatch.setattr(compile_ahead.atexit, "register", lambda *_: None)
    monkeypatch.setattr(compile_ahead, "cores", lambda: 2)
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    assert compile_ahead.compile_ahead() is True
    folder = tmp_path / "numba/optical-0/0/sim_optical"
    folder.mkdir(parents=True)
    assert compile_ahead.compile_ahead() is True  # an empty folder holds no loop
    (folder / "optics.nbi").touch()
    assert compile_ahead.compile_ahead() is False
    assert len(started) == 2
