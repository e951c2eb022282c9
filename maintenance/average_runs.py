"""Averages the weights of two runs, of which the later one started from the earlier one.

    python -m maintenance.average_runs EARLIER LATER SHARE OUT
    t2twin calibrate-uncertainty OUT --data DATASET

OUT is a copy of LATER with the weights (1 - SHARE) EARLIER + SHARE LATER (Wortsman et al. 2022).
Its uncertainty must be calibrated again. `average.json` contains the share, for the card.
"""

import json
import shutil
import sys
from pathlib import Path

import torch
from safetensors.torch import load_file, save_file

from t2twin.core.errors import T2TwinError
from t2twin.translate.runs.card import CARD
from t2twin.translate.runs.config import BEST, CONFIG, LOG, load_config

AVERAGE = "average.json"


def average_runs(earlier: Path, later: Path, share: float, out: Path) -> None:
    """Writes the averaged run. share: of the later run, 0 to 1.

    Raises T2TwinError for a share outside this range, for folders that are not finished runs, for
    runs of other networks, and if out exists.
    """
    if not 0.0 <= share <= 1.0:
        raise T2TwinError(f"the share is {share:g}; it must be from 0 to 1")
    if out.exists():
        raise T2TwinError(f"{out} exists; give a new folder")
    weights = []
    for run in (earlier, later):
        load_config(run)
        if not (run / BEST).is_file():
            raise T2TwinError(f"{run / BEST} does not exist; the run has not finished an epoch")
        weights.append(load_file(run / BEST))
    first, last = weights
    if {name: each.shape for name, each in first.items()} != {
        name: each.shape for name, each in last.items()
    }:
        raise T2TwinError(f"{earlier} and {later} have different networks; expected equal ones")
    mean = {name: _mean(first[name], last[name], share) for name in last}
    out.mkdir(parents=True)
    for name in (CONFIG, LOG, CARD):
        shutil.copyfile(later / name, out / name)
    (out / AVERAGE).write_text(json.dumps({"share": share}), encoding="utf-8")
    save_file(mean, out / BEST)


def _mean(first: torch.Tensor, last: torch.Tensor, share: float) -> torch.Tensor:
    """Counters of batch norm are those of the later run."""
    return torch.lerp(first, last, share) if first.is_floating_point() else last


if __name__ == "__main__":
    try:
        earlier, later, share, out = sys.argv[1:]
        average_runs(Path(earlier), Path(later), float(share), Path(out))
    except T2TwinError as error:
        sys.exit(str(error))
