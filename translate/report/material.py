"""Everything that the report shows, gathered and checked before any of it is written."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from primitives_cad.errors import T2TwinError
from sim.dataset import SPLITS, decode_png, read_info, read_split, shard_path
from translate.data import DataInfo, load_info
from translate.evaluate import METRICS, PREDICTIONS, TRUTH, evaluate
from translate.phi import Phi
from translate.predict import Run, load_run
from translate.run import BEST, LOG, Config
from translate.train import reason_to_stop

COLUMNS = [
    "shape",
    "family",
    "index",
    "x_mm",
    "y_mm",
    "yaw_rad",
    "force_n",
    "taxels",
    *(
        f"{sensor}_{what}"
        for sensor in ("digit", "cyskin")
        for what in ("depth_mm", "force_n", "settled", "bottomed")
    ),
]
"""What the report reads of every pair; pictures are read one by one."""

SHOWN = ("val", "test")
"""The splits that results are given for."""


@dataclass(frozen=True)
class Evaluated:
    """One split as `evaluate` left it: its metrics, and (P, N) predictions by model, counts."""

    metrics: dict[str, Any]
    predictions: dict[str, np.ndarray]
    truth: np.ndarray

    def errors(self, model: str) -> np.ndarray:
        """sqrt(L3) of each pair: (P,), counts."""
        return np.sqrt(np.square(self.predictions[model] - self.truth).mean(axis=1, dtype=float))


@dataclass(frozen=True)
class Material:
    """What the report is made of.

    data: the dataset's folder. info: its info.json; layout: the part of it that phi needs.
    tables: every split's COLUMNS. runs: by the names that `evaluate` gives them. histories: their
    logs, one record an epoch. evaluated: by split, "val" and "test".
    """

    data: Path
    info: dict[str, Any]
    layout: DataInfo
    phi: Phi
    tables: dict[str, pa.Table]
    runs: dict[str, Run]
    histories: dict[str, list[dict[str, Any]]]
    evaluated: dict[str, Evaluated]

    def picture(self, split: str, row: int) -> np.ndarray:
        """The DIGIT picture of a split's row, (320, 240, 3) uint8, read from its shard alone."""
        shape = self.tables[split]["shape"][row].as_py()
        index = self.tables[split]["index"][row].as_py()
        shard = pq.ParquetFile(self.data / shard_path(split, shape))
        found = shard.read(columns=["index"])["index"].to_pylist().index(index)
        return decode_png(shard.read(columns=["image"])["image"][found].as_py()["bytes"])

    def column(self, name: str) -> np.ndarray:
        """A column of all splits, one after another: (P,)."""
        return np.concatenate([self.tables[split][name].to_numpy() for split in SPLITS])


def gather(out: Path, data: Path, runs: list[Path]) -> Material:
    """Reads the dataset and the runs, and evaluates them into out/evaluate-val and -test.

    An evaluation that is there already, of the same runs and dataset, is read again instead.
    Raises T2TwinError, before anything is written, for a dataset, a run or a folder that cannot be
    used.
    """
    if out.exists() and not out.is_dir():
        raise T2TwinError(f"{out} is a file; give a folder to write the report into")
    if not runs:
        raise T2TwinError("there is no run to report on; give at least one folder of `train`")
    info, layout = _simulated(data), load_info(data)
    tables = {split: read_split(data, split, COLUMNS) for split in SPLITS}
    histories = {run: load_log(run) for run in runs}
    loaded = {run: load_run(run) for run in runs}
    for run in loaded.values():
        _check_finished(run.run_dir, run.config, histories[run.run_dir])
    evaluated = {split: _evaluated(runs, data, layout, split, out) for split in SHOWN}
    names = {
        model["run"]: name
        for name, model in evaluated["val"].metrics["models"].items()
        if "run" in model
    }
    return Material(
        data=data,
        info=info,
        layout=layout,
        phi=Phi(layout.x_mm, layout.y_mm),
        tables=tables,
        runs={names[str(run)]: loaded[run] for run in runs},
        histories={names[str(run)]: histories[run] for run in runs},
        evaluated=evaluated,
    )


def _simulated(data: Path) -> dict[str, Any]:
    """info.json of a dataset that `t2twin simdata` made: the page says what it was made with."""
    info = read_info(data)
    lacks = [key for key in ("scale", "seed", "parameters", "versions") if key not in info]
    if lacks:
        raise T2TwinError(
            f"{data} does not name its {lacks[0]}; the report is of datasets of `t2twin simdata`"
        )
    return info


def load_log(run_dir: Path) -> list[dict[str, Any]]:
    """A run's log.jsonl, one record an epoch. Raises T2TwinError where it is missing or damaged."""
    path = run_dir / LOG
    if not path.is_file():
        raise T2TwinError(
            f"{run_dir} holds no finished run (no {LOG}); make one with `t2twin train`"
        )
    try:
        return [json.loads(line) for line in path.read_text().splitlines()]
    except ValueError:
        raise T2TwinError(f"{path} is no run's log; train again into another folder") from None


def _check_finished(run_dir: Path, config: Config, history: list[dict[str, Any]]) -> None:
    if reason_to_stop(config, history) is None:
        raise T2TwinError(
            f"{run_dir} is unfinished after {len(history)} of {config.planned_epochs} epochs; the "
            "same `t2twin train` command ends it"
        )


def _evaluated(runs: list[Path], data: Path, info: DataInfo, split: str, out: Path) -> Evaluated:
    folder = out / f"evaluate-{split}"
    metrics = _earlier(folder, runs, info)
    if metrics is None:
        metrics = evaluate(runs, data, split, folder)
    with np.load(folder / PREDICTIONS) as arrays:
        predictions = {name: arrays[name] for name in metrics["models"]}
        return Evaluated(metrics, predictions, arrays[TRUTH])


def _earlier(folder: Path, runs: list[Path], info: DataInfo) -> dict[str, Any] | None:
    """The metrics in a folder if they are of these very weights on this very dataset."""
    path = folder / METRICS
    if not (path.is_file() and (folder / PREDICTIONS).is_file()):
        return None
    made = path.stat().st_mtime
    try:
        metrics = json.loads(path.read_text())
        of_runs = [m["run"] for m in metrics["models"].values() if "run" in m]
        same = metrics["info_sha256"] == info.sha256 and of_runs == [str(run) for run in runs]
    except (ValueError, KeyError, TypeError, AttributeError):
        return None
    newer = all(made >= (run / BEST).stat().st_mtime for run in runs)
    return metrics if same and newer else None
