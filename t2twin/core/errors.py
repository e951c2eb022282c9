"""The base classes of the project's exceptions and warnings."""


class T2TwinError(ValueError):
    """Invalid input. The message is one sentence: what was wrong, where, and what is allowed.

    The command line prints the message and exits with status 2.
    """


class T2TwinWarning(UserWarning):
    """A result that is incomplete or approximate. The message says what was found, what it does to
    the result, and what to do."""
