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


def pretrained_runs() -> tuple[str, ...]:
    """Names of the pretrained runs."""
    return tuple(sorted(path.parent.name for path in HOME.glob(f"*/{CONFIG}")))


def resolve_run(run: str | Path) -> Path:
    """The folder of a run, given as a folder or as the name of a pretrained run.

    A text equal to the name of a pretrained run refers to that run; a folder of that name is given
    as ./NAME or as a Path. Raises T2TwinError if there is neither.
    """
    names = pretrained_runs()
    if isinstance(run, str) and run in names:
        return HOME / run
    path = arguments.path(run, "run")
    if path.exists():
        return path
    if isinstance(run, str) or str(run) not in names:
        known = f", or the name of a pretrained run: {', '.join(names)}" if names else ""
        raise T2TwinError(f"there is no run {run}; give a folder that `train` has made{known}")
    return HOME / path
