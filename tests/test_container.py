"""As in a container: the code is root's and cannot be written; the user has no name and no home,
and writes to one folder."""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

NOBODY = 1_000_000 + os.getpid()
"""A user whom the system does not know, as `docker run --user` makes one: this session's own."""

OPEN_TO_ALL = (Path("/tmp"), Path("/var/tmp"), Path("/dev/shm"))
SHAPES = ("hemisphere-4", "circle-1", "line-sharp-4", "square-3", "wrench/shank")
"""Three to train on, which are the fewest that can be, one to validate, one to test."""

MAKE_DATA = f"import t2twin; t2twin.make_dataset('OUT/data', 'smoke', workers=2, shapes={SHAPES})"
CACHE = "from t2twin.core.cache_dir import cache_dir; print(cache_dir())"

pytestmark = pytest.mark.skipif(
    os.getuid() != 0 or shutil.which("setpriv") is None,
    reason="only root, with util-linux's setpriv, can become another user",
)


@pytest.fixture(scope="module")
def out():
    """The only folder that nobody may write to, and in it theirs for temporary files."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "temporary").mkdir()
        for path in (folder, folder / "temporary"):
            os.chown(path, NOBODY, NOBODY)
        yield folder


@pytest.fixture(scope="module")
def read_only(checkout):
    for path in (checkout, *checkout.rglob("*")):
        if not path.is_symlink():
            path.chmod(path.stat().st_mode & ~0o222)
    return checkout


@pytest.fixture(scope="module")
def as_nobody(read_only, out):
    """Runs Python as nobody in the read-only checkout; what it left elsewhere fails the test.

    It may read everything, for the interpreter may lie in root's home. Returns standard output.
    """
    privileges = ("--reuid", str(NOBODY), "--regid", str(NOBODY), "--clear-groups",
                  "--inh-caps=+dac_read_search", "--ambient-caps=+dac_read_search")  # fmt: skip

    def run(*arguments: str) -> str:
        before = contents(read_only), left_open()
        done = subprocess.run(
            ["setpriv", *privileges, sys.executable,
             *(argument.replace("OUT", str(out)) for argument in arguments)],
            cwd=read_only,
            env={"PATH": os.environ["PATH"], "PYTHONPATH": str(read_only),
                 "TMPDIR": str(out / "temporary")},
            capture_output=True,
            text=True,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        for word in ("warning", "locator", "error", "traceback"):
            assert word not in done.stderr.lower(), done.stderr
        assert (contents(read_only), left_open()) == before
        return done.stdout

    return run


def contents(folder: Path) -> dict[Path, int]:
    return {path: path.lstat().st_mtime_ns for path in folder.rglob("*")}


def left_open() -> set[Path]:
    """What nobody owns where everybody may write."""
    found = (path for place in OPEN_TO_ALL if place.is_dir() for path in place.iterdir())
    return {path for path in found if path.exists() and path.stat().st_uid == NOBODY}


@pytest.mark.exhaustive
def test_every_step_writes_its_own_folder_only(as_nobody, read_only, out):
    cache = out / f"temporary/t2twin-{NOBODY}"
    assert as_nobody("-c", CACHE).strip() == str(cache)
    as_nobody("-m", "t2twin", "press", "hemisphere-4", "--out", "OUT/press")
    compiled = list(cache.rglob("*.nbi"))
    assert compiled and {path.stat().st_uid for path in compiled} == {NOBODY}
    as_nobody("-c", MAKE_DATA)
    as_nobody("-m", "t2twin", "train", "resnet18", "--data", "OUT/data", "--preset", "smoke",
              "--out", "OUT/run")  # fmt: skip
    as_nobody("-m", "t2twin", "translate", "--run", "OUT/run", "OUT/press/digit.png",
              "--out", "OUT/counts")  # fmt: skip
    assert (out / "counts/counts.csv").is_file()
    made = {path.name for path in out.iterdir()}
    assert made == {"temporary", "press", "data", "run", "counts"}
    kept = {path.name for path in (out / "temporary").iterdir()}
    assert kept == {f"t2twin-{NOBODY}"}
