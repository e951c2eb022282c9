"""The small fixed case on which the code's outcome is compared: data, runs, evaluation.

    t2twin simdata --scale small
    t2twin simdata --scale smoke
    t2twin train MODEL --preset smoke --epochs 2
    t2twin evaluate RUN RUN --split both

All on one thread, so that the same code gives the same bytes on the same machine.
"""

import hashlib
import json
import os
import subprocess
import sys
from functools import cached_property
from pathlib import Path
from typing import Any

from benchmarks import ROOT
from t2twin.core.errors import T2TwinError

PRESET, EPOCHS = "smoke", 2
MODELS = ("touch2touch", "resnet18")
SPLITS = ("val", "test")

ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}

SIGNIFICANT_DIGITS = 6
"""Digits of a number that count in an outcome: what is beyond may be another order of a sum."""


class SmallCase:
    """The case below a folder. What is asked for first is made first; every part once."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @cached_property
    def small(self) -> Path:
        """The folder of a dataset of scale small."""
        return self._dataset("small")

    @cached_property
    def data(self) -> Path:
        """The folder of the one that the runs are trained on, of scale smoke."""
        return self._dataset("smoke")

    def _dataset(self, scale: str) -> Path:
        out = self.folder / scale
        _t2twin("simdata", "--scale", scale, "--out", str(out))
        return out

    @cached_property
    def runs(self) -> dict[str, Path]:
        """The trained runs' folders by model."""
        folders = {model: self.folder / model for model in MODELS}
        for model, out in folders.items():
            _t2twin(
                "train", model, "--data", str(self.data), "--preset", PRESET,
                "--epochs", str(EPOCHS), "--out", str(out),
            )  # fmt: skip
        return folders

    @cached_property
    def evaluation(self) -> Path:
        """The evaluation's folder, with a folder for each split."""
        out = self.folder / "evaluation"
        runs = map(str, self.runs.values())
        _t2twin("evaluate", *runs, "--data", str(self.data), "--split", "both", "--out", str(out))
        return out

    def shards_sha256(self) -> dict[str, str]:
        """Of either dataset, one sha256 over the list of its shards' own."""
        folders = {"small": self.small, "smoke": self.data}
        return {scale: shards_sha256(folder) for scale, folder in folders.items()}

    def weights_sha256(self) -> dict[str, str]:
        """sha256 of the trained weights by model."""
        return {
            model: hashlib.sha256((run / "best.safetensors").read_bytes()).hexdigest()
            for model, run in self.runs.items()
        }

    def metrics(self) -> dict[str, dict[str, Any]]:
        """What the evaluation's metrics.json hold, by split."""
        return {
            split: json.loads((self.evaluation / split / "metrics.json").read_bytes())
            for split in SPLITS
        }


def shards_sha256(folder: Path) -> str:
    """One sha256 over the list of a dataset's shards' own."""
    from t2twin.sim.dataset.store import read_info  # takes a second, and few commands need it

    return sha256_of({path: shard.sha256 for path, shard in read_info(folder).shards.items()})


def rounded(content: Any) -> Any:
    """JSON content with numbers to SIGNIFICANT_DIGITS."""
    if isinstance(content, dict):
        return {key: rounded(part) for key, part in content.items()}
    if isinstance(content, list | tuple):
        return [rounded(part) for part in content]
    return float(f"{content:.{SIGNIFICANT_DIGITS}g}") if isinstance(content, float) else content


def sha256_of(content: Any) -> str:
    """sha256 of JSON content."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _t2twin(*arguments: str) -> None:
    """Runs a command of t2twin on one thread. Raises T2TwinError with its last words."""
    done = subprocess.run(
        [sys.executable, "-m", "t2twin", *arguments],
        cwd=ROOT,
        env=os.environ | ONE_THREAD,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise T2TwinError(f"t2twin {arguments[0]} failed: {done.stderr.strip()[-500:]}")
