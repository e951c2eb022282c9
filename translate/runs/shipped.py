"""Runs that come with the package, and how one is made from a training's run.

    python -m t2twin.translate.runs.shipped runs/shipped/field

A shipped run is a run's folder without what only a training needs. Its learnt weights are in half
precision, which is 3 decimal digits; what was fitted or counted stays as it is. It goes by its
model's name wherever a run's folder is asked for.
"""

import shutil
import sys
from pathlib import Path

import torch
from safetensors.torch import load_file, save_file

from t2twin.primitives_cad.errors import T2TwinError
from t2twin.primitives_cad.writing import whole_file
from t2twin.translate.runs.card import CARD
from t2twin.translate.runs.config import BEST, CONFIG, load_config

HOME = Path(__file__).parents[1] / "weights"

FEWEST_NUMBERS = 1000
"""Numbers in a tensor of at least two axes from which it goes into half precision (assumed: less
than a hundredth of all are in smaller ones)."""

KEPT = ("correlation", "mean_frame", "running_mean", "running_var")
"""Ends of the names of tensors that are not learnt, which keep their precision."""


def shipped_runs() -> tuple[str, ...]:
    """Their names."""
    return tuple(sorted(path.parent.name for path in HOME.glob(f"*/{CONFIG}")))


def find_run(run: str | Path) -> Path:
    """A run's folder: the one that is given, or that of a shipped run by its name.

    Raises T2TwinError where there is neither.
    """
    path, names = Path(run), shipped_runs()
    if path.exists():
        return path
    if str(run) not in names:
        ships = f", or the name of a run that ships: {', '.join(names)}" if names else ""
        raise T2TwinError(f"there is no run {run}; give a folder that `train` has made{ships}")
    return HOME / path


def ship(run_dir: Path, home: Path = HOME) -> Path:
    """Writes a finished run into home, by its model's name, over an earlier one. Returns its folder.

    Raises T2TwinError where run_dir holds no run, or one that has not finished.
    """
    config = load_config(run_dir)
    for name in (BEST, CARD):
        if not (run_dir / name).is_file():
            raise T2TwinError(f"{run_dir / name} is not there; the run has not finished")
    folder = home / config.model
    folder.mkdir(parents=True, exist_ok=True)
    weights = {name: _halved(name, tensor) for name, tensor in load_file(run_dir / BEST).items()}
    with whole_file(folder / BEST) as temporary:
        save_file(weights, temporary)
        temporary.chmod(0o644)  # safetensors lets only the owner read
    for name in (CONFIG, CARD):
        shutil.copyfile(run_dir / name, folder / name)
    return folder


def _halved(name: str, tensor: torch.Tensor) -> torch.Tensor:
    learnt = tensor.dim() >= 2 and tensor.numel() >= FEWEST_NUMBERS and not name.endswith(KEPT)
    return tensor.half() if learnt else tensor


if __name__ == "__main__":
    try:
        print(ship(Path(sys.argv[1])))
    except T2TwinError as error:
        sys.exit(str(error))
