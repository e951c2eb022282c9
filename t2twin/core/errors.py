"""The base class of the project's exceptions."""


class T2TwinError(ValueError):
    """Invalid input. The message is one sentence: what was wrong, where, and what is allowed.

    The command line prints the message and exits with status 2.
    """
