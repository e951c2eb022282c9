"""The console command `t2twin`, which is also `python -m t2twin`."""

import os
import sys

from t2twin.core.signals import install_handlers


def main() -> None:
    """Run the command line; signals are heeded before the rest is loaded, which takes a while."""
    install_handlers()
    _open_standard_streams()

    from t2twin.cli import main as run

    run()


def _open_standard_streams() -> None:
    """A closed stream becomes the null device: the next file that is opened would take its number
    and get what libraries print. File names that the terminal cannot show are escaped."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            null = os.open(os.devnull, os.O_RDWR)  # takes the lowest free number, this one
            if getattr(sys, name) is None:
                setattr(sys, name, os.fdopen(null, "r" if number == 0 else "w"))
    if hasattr(sys.stdout, "reconfigure"):
        sys.stdout.reconfigure(errors="backslashreplace")  # pyright: ignore


if __name__ == "__main__":
    main()
