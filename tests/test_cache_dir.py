"""The folder of cached files; nothing depends on it."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest
import trimesh

from t2twin.core import cache_dir
from t2twin.core.cache_dir import VARIABLE
from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.shape import Shape

ROOT = Path(__file__).parents[1]


@pytest.fixture
def homeless(tmp_path, monkeypatch):
    """No home that can be written: its place is taken by a file. The temporary folder is empty."""
    (tmp_path / "home").write_text("in the way")
    (tmp_path / "temporary").mkdir()
    for name in (VARIABLE, "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    return tmp_path / "temporary"


def load_file(folder: Path) -> Shape:
    """A shape of a file, which is prepared where it is not kept."""
    trimesh.creation.box().export(folder / "box.stl")
    return catalogue.load(folder / "box.stl")


def own(temporary):
    return temporary / f"t2twin-{os.getuid()}"


def test_a_user_s_cache_is_where_the_system_has_it(tmp_path, monkeypatch):
    monkeypatch.delenv(VARIABLE)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "caches"))
    assert cache_dir.cache_dir() == tmp_path / "caches/t2twin"


def test_the_variable_names_another_folder(tmp_path, monkeypatch):
    monkeypatch.setenv(VARIABLE, str(tmp_path / "here/it/is"))
    assert cache_dir.cache_dir() == tmp_path / "here/it/is"
    load_file(tmp_path)
    assert [path.suffix for path in (tmp_path / "here/it/is/shapes").iterdir()] == [".pickle"]
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv(VARIABLE, str(tmp_path / "file"))
    with pytest.raises(T2TwinError, match=r"T2TWIN_CACHE is .+ which cannot be written"):
        cache_dir.cache_dir()


def test_without_a_home_it_is_a_private_folder_among_the_temporary(homeless):
    assert cache_dir.cache_dir() == own(homeless)
    assert own(homeless).stat().st_mode & 0o777 == 0o700


def test_a_folder_that_others_can_write_to_is_not_used(homeless):
    own(homeless).mkdir(mode=0o700)
    own(homeless).chmod(0o770)
    assert cache_dir.cache_dir() is None


def test_without_any_folder_shapes_are_made_and_not_kept(homeless, tmp_path, monkeypatch):
    own(homeless).touch()
    monkeypatch.chdir(tmp_path)
    load_file(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    assert load_file(tmp_path).mesh.is_watertight
    assert sorted(tmp_path.rglob("*")) == before


LOOP = """
from t2twin.core.jit import compiled
from part import part

@compiled()
def loop(x):
    return part(x)

print(loop(1.0), sum(loop.stats.cache_hits.values()))
"""
PART = """
from t2twin.core.jit import compiled

@compiled(inline="always")
def part(x):
    return x + {}
"""


def run_loop(folder: Path, **environment: str) -> str:
    keep = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    done = subprocess.run(
        [sys.executable, "-W", "error", "loop.py"],
        cwd=folder,
        env=keep | {"PYTHONPATH": str(ROOT)} | environment,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0 and not done.stderr, done.stderr
    return done.stdout.strip()


@pytest.mark.exhaustive
def test_compiled_loops_are_kept_until_a_part_of_them_changes(tmp_path):
    (tmp_path / "loop.py").write_text(LOOP)
    (tmp_path / "part.py").write_text(PART.format(1.0))
    home = tmp_path / "home"
    assert run_loop(tmp_path, T2TWIN_CACHE=str(home)) == "2.0 0"
    assert run_loop(tmp_path, T2TWIN_CACHE=str(home)) == "2.0 1"
    (tmp_path / "part.py").write_text(PART.format(2.0))
    assert run_loop(tmp_path, T2TWIN_CACHE=str(home)) == "3.0 0"
    (kept,) = (home / "numba").glob("*/*")  # what the older source gave is gone
    assert kept.is_dir()


def test_numba_s_own_variable_is_respected_and_no_folder_is_no_harm(tmp_path):
    (tmp_path / "loop.py").write_text(LOOP)
    (tmp_path / "part.py").write_text(PART.format(1.0))
    given = {"NUMBA_CACHE_DIR": str(tmp_path / "given"), "T2TWIN_CACHE": str(tmp_path / "home")}
    assert run_loop(tmp_path, **given) == "2.0 0"
    assert (tmp_path / "given").is_dir() and not (tmp_path / "home").exists()
    (tmp_path / "file").touch()
    assert run_loop(tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "file")) == "2.0 0"


def test_an_array_is_computed_once_for_each_key(tmp_path, monkeypatch):
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    computed = []

    def compute() -> np.ndarray:
        computed.append(1)
        return np.arange(4.0)

    for key in ("a", "a", "b"):
        found = cache_dir.cached_array("arrays", key, __file__, compute)
        np.testing.assert_array_equal(found, np.arange(4.0))
    assert len(computed) == 2
    assert len(list(Path(tmp_path / "arrays").iterdir())) == 2
