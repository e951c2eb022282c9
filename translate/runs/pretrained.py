"""Runs that come with the package. Each goes by its model's name wherever a run's folder is asked
for; module ship makes them."""

from pathlib import Path

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.translate.runs.config import CONFIG

HOME = Path(__file__).parents[1] / "weights"

DEFAULT_RUN = "field"
"""The pretrained run that commands, `load` and the studio use unless another is named."""


def pretrained_runs() -> tuple[str, ...]:
    """Their names."""
    return tuple(sorted(path.parent.name for path in HOME.glob(f"*/{CONFIG}")))


def resolve_run(run: str | Path) -> Path:
    """A run's folder: that of a pretrained run by its name, or the one that is given.

    A text that is a pretrained run's name always means that run, whatever the working directory
    holds; a folder of that name is given as ./NAME, or as a Path.
    Raises T2TwinError where there is neither.
    """
    names = pretrained_runs()
    if isinstance(run, str) and run in names:
        return HOME / run
    path = arguments.path(run, "run")
    if path.exists():
        return path
    if isinstance(run, str) or str(run) not in names:
        ships = f", or the name of a pretrained run: {', '.join(names)}" if names else ""
        raise T2TwinError(f"there is no run {run}; give a folder that `train` has made{ships}")
    return HOME / path
