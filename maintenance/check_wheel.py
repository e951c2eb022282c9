"""Checks the wheel in dist/, and runs its commands in an empty folder with an empty cache.

`python -m maintenance.check_wheel` checks the contents, doctor and a press; with COMMAND ..., only
that command. The wheel is installed into a folder, which precedes the other packages.
"""

import os
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

from t2twin.core.errors import T2TwinError

PACKAGE, LINKED = "t2twin", ("sim", "translate", "primitives_cad")  # folders of the wheel's files
MAX_BYTES = 30 * 10**6  # size limit of the wheel, bytes
COMMANDS = (("doctor",), ("press", "square-2", "--sensor", "target"))  # unless one is given


def main(arguments: list[str]) -> None:
    wheels = sorted(Path("dist").glob("*.whl"))
    if len(wheels) != 1:
        raise T2TwinError(f"dist has {len(wheels)} wheels; expected 1, of `make wheel`")
    if not arguments:
        check_contents(wheels[0])
    with tempfile.TemporaryDirectory(prefix="t2twin-wheel-") as folder:
        options = ["--quiet", "--no-deps", "--no-index", "--target"]
        pip = [sys.executable, "-m", "pip", "install", *options, f"{folder}/installed", wheels[0]]
        subprocess.run(pip, check=True)
        for command in [arguments] if arguments else COMMANDS:
            run(Path(folder), command)


def check_contents(wheel: Path) -> None:
    """Raises T2TwinError for a wheel that is large or lacks a file of the repository's packages."""
    listing = ["git", "ls-files", PACKAGE, *LINKED]
    listed = subprocess.run(listing, check=True, text=True, capture_output=True).stdout.split()
    packed = (file.removeprefix(f"{PACKAGE}/") for file in listed if not Path(file).is_symlink())
    files = {f"{PACKAGE}/{file}" for file in packed}
    found = set(zipfile.ZipFile(wheel).namelist())
    if missing := sorted(files - found):
        raise T2TwinError(f"{wheel} lacks {', '.join(missing)}")
    size = wheel.stat().st_size
    if size > MAX_BYTES:
        raise T2TwinError(f"{wheel} has {size:,} bytes; allowed are {MAX_BYTES:,}")
    print(f"{wheel}: {len(found)} files, {size:,} bytes")


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


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except (T2TwinError, subprocess.CalledProcessError) as error:
        sys.exit(str(error))
