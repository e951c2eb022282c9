"""Checks the wheel and the sdist in dist/, and runs the wheel's commands in an empty folder.

    python -m maintenance.check_wheel                    contents, doctor, and a press
    python -m maintenance.check_wheel COMMAND ...        only t2twin COMMAND ...

The wheel is installed into a folder, which precedes the other packages. The folder and the cache of
the commands are empty.
"""

import hashlib
import os
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

from t2twin.core.errors import T2TwinError

DIST = Path("dist")
"""Folder of the wheel and the sdist."""

MAX_BYTES = 30 * 10**6
"""Size limit of the wheel, bytes."""

LINK = 0o120000
"""Type of a symbolic link in the attributes of a zip file (zip's external attributes, 4.4.15)."""

COMMANDS = (("doctor",), ("press", "square-2", "--sensor", "target"))
"""Commands that are run unless one is given."""

REQUIRED = (
    "t2twin/translate/weights/field/best.safetensors",
    "t2twin/sim/sampling/recipes/open.toml",
    "t2twin/sim/sensors/specs/digit.npz",
    "t2twin/primitives_cad/bundled/square-2.npz",
    "t2twin/report/templates/page.html",
)
"""Files of the wheel that no import needs."""


def main(arguments: list[str]) -> None:
    wheel = _only("*.whl")
    if not arguments:
        check_contents(wheel)
    with tempfile.TemporaryDirectory(prefix="t2twin-wheel-") as folder:
        target = ("--target", str(Path(folder) / "installed"), str(wheel))
        _python("-m", "pip", "install", "--no-deps", "--no-index", *target)
        for command in [arguments] if arguments else COMMANDS:
            run(Path(folder), command)


def check_contents(wheel: Path) -> None:
    """Raises T2TwinError for a wheel that is large, has links or lacks files, or differs from the
    one that the repository builds without an sdist."""
    _only("*.tar.gz")
    with tempfile.TemporaryDirectory() as folder:
        _python("-m", "build", "--wheel", "--no-isolation", "--outdir", folder)
        direct = contents(next(Path(folder).glob("*.whl")))
    found = contents(wheel)
    if found != direct:
        names = {name for name, _ in found.items() ^ direct.items()}
        raise T2TwinError(f"the sdist builds another wheel; files that differ: {sorted(names)}")
    if missing := [name for name in REQUIRED if name not in found]:
        raise T2TwinError(f"{wheel} lacks {', '.join(missing)}")
    size = wheel.stat().st_size
    if size > MAX_BYTES:
        raise T2TwinError(f"{wheel} has {size:,} bytes; allowed are {MAX_BYTES:,}")
    print(f"{wheel}: {len(found)} files, {size:,} bytes, equal to the wheel without an sdist")


def contents(wheel: Path) -> dict[str, str]:
    """SHA-256 of every file in a wheel by name. Raises T2TwinError for a link."""
    with zipfile.ZipFile(wheel) as archive:
        for member in archive.infolist():
            if (member.external_attr >> 16) & 0o170000 == LINK:
                raise T2TwinError(f"{wheel} contains the link {member.filename}; expected files")
        return {name: hashlib.sha256(archive.read(name)).hexdigest() for name in archive.namelist()}


def run(folder: Path, command: list[str] | tuple[str, ...]) -> None:
    """Runs t2twin of a folder in an empty one. Raises T2TwinError where it fails."""
    print(f"t2twin {' '.join(command)}", flush=True)
    work = folder / "empty" / command[0]
    work.mkdir(parents=True)
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    environment |= {"T2TWIN_CACHE": str(folder / "cache"), "PYTHONPATH": str(folder / "installed")}
    where = [sys.executable, "-c", "import t2twin; print(t2twin.__file__)"]
    found = subprocess.run(where, cwd=work, env=environment, text=True, capture_output=True)
    if not found.stdout.startswith(str(folder)):
        raise T2TwinError(f"t2twin is imported from {found.stdout.strip() or found.stderr}")
    program = folder / "installed/bin/t2twin"
    done = subprocess.run([sys.executable, program, *command], cwd=work, env=environment)
    if done.returncode:
        raise T2TwinError(f"t2twin {' '.join(command)} ended with status {done.returncode}")


def _only(pattern: str) -> Path:
    files = sorted(DIST.glob(pattern))
    if len(files) != 1:
        raise T2TwinError(f"{DIST} has {len(files)} files {pattern}; expected 1, of `make wheel`")
    return files[0].absolute()


def _python(*arguments: str) -> None:
    subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except (T2TwinError, subprocess.CalledProcessError) as error:
        sys.exit(str(error))
