"""The one exception base of the project."""


class T2TwinError(ValueError):
    """Something the user gave cannot be used; the message says what, and what is allowed.

    The command line prints the message as one plain sentence and exits with status 2.
    """
