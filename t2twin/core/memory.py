"""Recognizes exceptions of libraries that could not allocate memory."""

OUT_OF_MEMORY = (
    "there is not enough memory; end other programs, raise the limit (ulimit -v), or use fewer "
    "--workers where the command has them"
)
"""The message of a command."""

MESSAGES = ("allocate", "bad_alloc", "Caught an unknown exception")
"""Parts of the messages of torch, of C++ and of pybind11, whose type is RuntimeError."""


def is_out_of_memory(error: Exception) -> bool:
    """Whether an exception or one of its causes means that no memory was left."""
    cause: BaseException | None = error
    while cause is not None:
        is_message = isinstance(cause, RuntimeError) and any(
            each in str(cause) for each in MESSAGES
        )
        if isinstance(cause, MemoryError) or is_message:
            return True
        cause = cause.__cause__ or cause.__context__
    return False
