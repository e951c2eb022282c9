"""The processor of this machine, its cores and memory, and the versions of installed packages."""

import os
import platform
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

NOT_INSTALLED = "not installed"

CPUINFO = Path("/proc/cpuinfo")
"""File with the processor's name on Linux."""


def cores() -> int:
    """Number of cores available to this process."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def processor() -> str:
    """The processor's name."""
    return _cpuinfo("model name") or platform.processor() or platform.machine()


def processor_flags() -> list[str]:
    """The processor's features as Linux names them; empty on other systems."""
    return _cpuinfo("flags").split()


def trim_memory() -> None:
    """Return freed memory between allocations to the system, with glibc, which keeps it."""
    import ctypes

    with suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)


def _cpuinfo(key: str) -> str:
    """The first value of a key in CPUINFO; empty without such a file or key."""
    lines = CPUINFO.read_text().splitlines() if CPUINFO.is_file() else []
    values = (line.partition(":")[2].strip() for line in lines if line.startswith(key))
    return next(values, "")


def installed_version(package: str) -> str:
    """The version of a package for a record of provenance, or NOT_INSTALLED."""
    try:
        return version(package)
    except PackageNotFoundError:
        return NOT_INSTALLED
