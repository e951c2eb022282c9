"""The console command `t2twin`, which is also `python -m t2twin`."""

import io
import os
import sys

from t2twin.core.files import install_handlers


def main() -> None:
    """Run the command line; installs the signal handlers before the slow imports."""
    install_handlers()
    if isinstance(sys.stdout, io.TextIOWrapper):  # escapes what the terminal cannot show
        sys.stdout.reconfigure(errors="backslashreplace")
    # No command renders with MuJoCo. Its EGL needs another PyOpenGL than pyrender, and its GLFW
    # starts processes on import, which print an error when the command is stopped.
    os.environ["MUJOCO_GL"] = "disabled"

    from t2twin.cli import main as run

    run()


if __name__ == "__main__":
    main()
