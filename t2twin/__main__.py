"""The console command `t2twin`, which is also `python -m t2twin`."""

import os
import sys

from t2twin.core.files import install_handlers


def main() -> None:
    """Run the command line; installs the signal handlers before the slow imports."""
    install_handlers()
    _open_standard_streams()
    # No command renders with MuJoCo. Its EGL needs another PyOpenGL than pyrender, and its GLFW
    # starts processes on import, which print an error when the command is stopped.
    os.environ["MUJOCO_GL"] = "disabled"

    from t2twin.cli import main as run

    run()


def _open_standard_streams() -> None:
    """Replaces closed streams by the null device.

    Otherwise the next opened file would have the number of the stream, and receive the output of
    libraries. Characters that the terminal cannot show are escaped.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            null = os.open(os.devnull, os.O_RDWR)  # has the lowest free number, this one
            if getattr(sys, name) is None:
                setattr(sys, name, os.fdopen(null, "r" if number == 0 else "w"))
    if hasattr(sys.stdout, "reconfigure"):
        sys.stdout.reconfigure(errors="backslashreplace")  # pyright: ignore


if __name__ == "__main__":
    main()
