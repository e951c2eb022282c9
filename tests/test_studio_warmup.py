"""What the studio does before its first page: listen early, compile in two processes, press."""

import os
import subprocess
import sys
from threading import Event

import pytest

from t2twin.core import compile_ahead
from t2twin.core.cache_dir import VARIABLE
from t2twin.studio import shared
from t2twin.studio.translators import Translators

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


@pytest.mark.exhaustive
def test_the_second_process_compiles_all_that_a_picture_needs(tmp_path):
    """After it a picture leaves nothing new in the cache."""
    environment = os.environ | {VARIABLE: str(tmp_path), "NUMBA_CACHE_DIR": ""}

    def run(script):
        subprocess.run(
            [sys.executable, "-c", script], env=environment, check=True, stdin=subprocess.PIPE
        )
        return {path.name for path in tmp_path.rglob("*.loop") if "digit-" in str(path)}

    made = run(compile_ahead.COMPILE_OPTICS.replace(WATCHING, ""))
    press = "import t2twin; t2twin.press('random-17')"
    assert len(made) >= 8 and run(press) == made


def test_the_second_process_ends_with_the_first(tmp_path):
    script = compile_ahead.COMPILE_OPTICS.replace(
        "import numpy", "print(flush=True); threading.Event().wait()\nimport numpy"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert process.stdin is not None and process.stdout is not None
    assert process.stdout.readline() and process.poll() is None
    process.stdin.close()
    assert process.wait(60) == 0
    process.stdout.close()


def test_it_compiles_only_where_nothing_is_kept(tmp_path, monkeypatch):
    started = []
    monkeypatch.setattr(compile_ahead, "_helper", None)
    monkeypatch.setattr(
        compile_ahead.subprocess, "Popen", lambda *given, **_: started.append(given)
    )
    monkeypatch.setattr(compile_ahead, "cores", lambda: 2)
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    assert compile_ahead.compile_optics_ahead() is True
    assert len(started) == 1
    (tmp_path / "numba/digit-0/0").mkdir(parents=True)
    assert compile_ahead.compile_optics_ahead() is True  # an empty folder holds no loop
    (tmp_path / "numba/digit-0/0/optics.loop").touch()
    assert compile_ahead.compile_optics_ahead() is False
    assert len(started) == 2


def test_translators_are_loaded_after_a_page_has_its_picture(untrained_runs, tmp_path, monkeypatch):
    order = []

    class Seen(Event):
        def wait(self, timeout=None):
            order.append("seen")
            return True

    class Watched(Translators):
        def load(self, runs):
            order.append(runs)

    translators = Watched()
    translators.search(untrained_runs)
    state = shared.SharedState(translators, tmp_path, page_shown=Seen())
    monkeypatch.setattr(shared, "_press", lambda _: order.append(state.press_ready.is_set()))
    shared.warm_up(state, search=False)
    assert order == [False, "seen", translators.default_names] and state.press_ready.is_set()


WATCHING = next(
    line + "\n" for line in compile_ahead.COMPILE_OPTICS.splitlines() if "Thread" in line
)
"""The line that ends the second process with the first."""
