"""Averages the weights of a run and of a later run that was initialized with it.

The mean has the accuracy of the later run on its own data, and keeps more of the accuracy of the
earlier run on other data (Wortsman et al. 2022, Robust fine-tuning of zero-shot models).
"""

import json
import shutil
from pathlib import Path

import torch
from safetensors.torch import load_file, save_file

from t2twin.core.errors import T2TwinError
from t2twin.translate.networks.field_net import SHEAR
from t2twin.translate.runs.card import CARD
from t2twin.translate.runs.config import BEST, CONFIG, LOG, load_config

AVERAGE = "average.json"
"""Contains the share of the later run, for the card."""


def average_runs(earlier: Path, later: Path, share: float, out: Path) -> None:
    """Writes a copy of the later run whose weights are averaged. Its uncertainty must be calibrated
    again.

    share: of the later run, 0 to 1. The earlier run may also predict shear, which the mean then
    does not. Raises T2TwinError for a share outside this range, for folders that are not finished
    runs, for runs of other networks, and if out exists.
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
    first = {n: each for n, each in first.items() if n in last or not n.startswith(SHEAR)}
    if {n: each.shape for n, each in first.items()} != {n: each.shape for n, each in last.items()}:
        raise T2TwinError(f"{earlier} and {later} have different networks; expected equal ones")
    mean = {name: _mean(first[name], last[name], share) for name in last}
    out.mkdir(parents=True)
    for name in (CONFIG, LOG, CARD):
        shutil.copyfile(later / name, out / name)
    (out / AVERAGE).write_text(json.dumps({"share": share}), encoding="utf-8")
    save_file(mean, out / BEST)


def _mean(first: torch.Tensor, last: torch.Tensor, share: float) -> torch.Tensor:
    """Of the later run's type; pretrained weights are stored as float16. Counters of batch norm are
    those of the later run.
    """
    if not last.is_floating_point():
        return last
    return torch.lerp(first.float(), last.float(), share).to(last.dtype)
