"""Pretrained runs, which are part of the package.

Their names are accepted wherever a run's folder is. `python -m maintenance.publish_pretrained`
writes them.
"""

from pathlib import Path

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.translate.runs.config import CONFIG

HOME = Path(__file__).parents[1] / "weights"

DEFAULT_RUN = "field"
"""The pretrained run that commands, `load` and the studio use by default."""

VERSIONS = {"field": 2}
"""Versions of the pretrained runs, 1 unless given. Another training predicts other counts."""


def pretrained_runs() -> tuple[str, ...]:
    """Names of the pretrained runs."""
    return tuple(sorted(path.parent.name for path in HOME.glob(f"*/{CONFIG}")))


def versioned(name: str) -> str:
    """Name and version of a pretrained run, such as field@2."""
    return f"{name}@{VERSIONS.get(name, 1)}"


def resolve_run(run: str | Path) -> Path:
    """The folder of a run, given as a folder or as the name of a pretrained run.

    A text equal to the name of a pretrained run refers to that run; a folder of that name is given
    as ./NAME or as a Path. NAME@VERSION refers to that version of a pretrained run.
    Raises T2TwinError if there is neither, and for a version that is not part of the package.
    """
    names = pretrained_runs()
    if isinstance(run, str) and run.partition("@")[0] in names and "@" in run:
        name = run.partition("@")[0]
        if run != versioned(name):
            raise T2TwinError(f"there is no run {run}; this t2twin contains {versioned(name)}")
        return HOME / name
    if isinstance(run, str) and run in names:
        return HOME / run
    path = arguments.path(run, "run")
    if path.exists():
        return path
    if isinstance(run, str) or str(run) not in names:
        known = f", or the name of a pretrained run: {', '.join(names)}" if names else ""
        raise T2TwinError(f"there is no run {run}; give a folder that `train` has made{known}")
    return HOME / path
