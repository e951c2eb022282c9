"""The exceptions and warnings of the project, and words of messages."""

import sys
import warnings


class T2TwinError(ValueError):
    """Invalid input. The message is one sentence: what was wrong, where, and what is allowed.

    The command line prints the message and exits with status 2.
    """


class T2TwinWarning(UserWarning):
    """A result that is incomplete or approximate. The message names what was found, what it does to
    the result, and what to do."""


def warn(*messages: str | None) -> None:
    """Warn with T2TwinWarning of each message but None, at the line of the user's code."""
    frame, level = sys._getframe(), 1  # pyright: ignore[reportPrivateUsage]
    while frame.f_back is not None and frame.f_globals.get("__name__", "").startswith("t2twin."):
        frame, level = frame.f_back, level + 1
    for message in filter(None, messages):
        warnings.warn(message, T2TwinWarning, stacklevel=level)


OUT_OF_MEMORY = (
    "there is not enough memory; end other programs, raise the limit (ulimit -v), or use fewer "
    "--workers where the command has them"
)


def how_to_install(*extras: str) -> str:
    """How to install extras. pip uses the installed t2twin, of a clone or a wheel, not an index."""
    return f"install with: pip install 't2twin[{','.join(extras)}]', which keeps this t2twin"


def is_out_of_memory(error: Exception) -> bool:
    """Whether an exception of Python, NumPy, torch, C++ or MuJoCo means that no memory was left."""
    messages = "allocate memory", "bad_alloc"
    return isinstance(error, MemoryError) or any(each in str(error) for each in messages)


def counted(number: int, noun: str, plural: str | None = None) -> str:
    """A number and a noun, as "1 pair" or "2 pairs". plural: by default the noun and an s."""
    return f"{number} {noun if number == 1 else plural or f'{noun}s'}"
