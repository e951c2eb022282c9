"""Everything that the report shows, gathered and checked before any of it is written."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from t2twin.primitives_cad.errors import T2TwinError
from t2twin.sim.dataset.png import decode_png
from t2twin.sim.dataset.store import SPLITS, read_info, read_split, shard_path, taxels
from t2twin.translate.data.pairs import DataInfo, load_info
from t2twin.translate.evaluation.evaluate import (
    FORMAT,
    METRICS,
    PREDICTIONS,
    TRUTH,
    evaluate,
    write_findings,
)
from t2twin.translate.phi import Phi
from t2twin.translate.predict import TrainedTranslator, load_run
from t2twin.translate.runs.config import BEST, LOG, RunConfig
from t2twin.translate.train import reason_to_stop

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


SATURATED_SHARE = 0.999
"""Part of full scale above which a count is taken as saturated (assumed: ten times the noise)."""


@dataclass(frozen=True)
class Dataset:
    """A dataset as the report draws it.

    data: its folder. info: its info.json; layout: the part of it that phi needs. tables: COLUMNS
    of every split that has pairs.
    """

    data: Path
    info: dict[str, Any]
    layout: DataInfo
    phi: Phi
    tables: dict[str, pa.Table]

    def picture(self, split: str, row: int) -> np.ndarray:
        """The DIGIT picture of a split's row, (320, 240, 3) uint8, read from its shard alone."""
        shape = self.tables[split]["shape"][row].as_py()
        index = self.tables[split]["index"][row].as_py()
        with pq.ParquetFile(self.data / shard_path(split, shape)) as shard:
            found = shard.read(columns=["index"])["index"].to_pylist().index(index)
            for group in range(shard.num_row_groups):
                rows = shard.metadata.row_group(group).num_rows
                if found < rows:
                    images = shard.read_row_group(group, columns=["image"])["image"]
                    return decode_png(images[found].as_py()["bytes"])
                found -= rows
        raise AssertionError("a row lies in one of its file's groups")

    def column(self, name: str) -> np.ndarray:
        """A column of all splits, one after another: (P,). Numbers that are empty are NaN."""
        return np.concatenate([table[name].to_numpy() for table in self.tables.values()])

    @property
    def places(self) -> list[tuple[str, int]]:
        """Split and row of every pair, in the order of `column`."""
        return [(split, row) for split, table in self.tables.items() for row in range(len(table))]

    @property
    def counts(self) -> np.ndarray:
        """All taxels' counts, in the order of `column`: (P, N)."""
        return np.concatenate([taxels(table) for table in self.tables.values()])

    @property
    def saturated(self) -> np.ndarray:
        """(P, N), which counts are saturated: a mean of noisy readings that are cut off at full
        scale lies a little below it."""
        return self.counts >= SATURATED_SHARE * self.layout.full_scale_counts

    @property
    def pad_diameter_mm(self) -> np.ndarray:
        """(N,)"""
        of_skin = self.info.get("parameters", {}).get("cyskin", self.info)
        return np.asarray(of_skin["pad_diameter_mm"], dtype=float)

    @property
    def is_simulated(self) -> bool:
        """Whether `t2twin simdata` made it, and so knows forces and depths."""
        return "scale" in self.info


@dataclass(frozen=True)
class ReportData(Dataset):
    """What the report of runs is made of.

    runs: by the names that `evaluate` gives them. histories: their logs, one record an epoch.
    evaluated: by split, "val" and "test".
    """

    runs: dict[str, TrainedTranslator]
    histories: dict[str, list[dict[str, Any]]]
    evaluated: dict[str, Evaluated]


def gather_dataset(data: Path) -> Dataset:
    """Reads a dataset alone. Raises T2TwinError where it is missing or unfinished."""
    info, layout = read_info(data), load_info(data)
    with_pairs = {path.split("/")[0] for path in info["shards"]}
    return Dataset(
        data=data,
        info=info,
        layout=layout,
        phi=Phi(layout.x_mm, layout.y_mm),
        tables={s: read_split(data, s, COLUMNS) for s in SPLITS if s in with_pairs},
    )


def gather(out: Path, data: Path, runs: list[Path]) -> ReportData:
    """Reads the dataset and the runs, and evaluates them into out/evaluate-val and -test, with
    out/findings.json.

    An evaluation that is there already, of the same runs and dataset, is read again instead.
    Raises T2TwinError, before anything is written, for a dataset, a run or a folder that cannot be
    used.
    """
    if out.exists() and not out.is_dir():
        raise T2TwinError(f"{out} is a file; give a folder to write the report into")
    if not runs:
        raise T2TwinError("there is no run to report on; give at least one folder of `train`")
    _check_simulated(data)
    dataset = gather_dataset(data)
    histories = {run: load_log(run) for run in runs}
    loaded = {run: load_run(run) for run in runs}
    for run in loaded.values():
        _check_finished(run.run_dir, run.config, histories[run.run_dir])
    evaluated = {split: _evaluated(runs, data, dataset.layout, split, out) for split in SHOWN}
    write_findings({split: one.metrics for split, one in evaluated.items()}, out)
    names = {
        model["run"]: name
        for name, model in evaluated["val"].metrics["models"].items()
        if "run" in model
    }
    return ReportData(
        data=data,
        info=dataset.info,
        layout=dataset.layout,
        phi=dataset.phi,
        tables=dataset.tables,
        runs={names[str(run)]: loaded[run] for run in runs},
        histories={names[str(run)]: histories[run] for run in runs},
        evaluated=evaluated,
    )


def _check_simulated(data: Path) -> None:
    """The page of runs says what their dataset was made with."""
    info = read_info(data)
    lacks = [key for key in ("scale", "seed", "parameters", "versions") if key not in info]
    if lacks:
        raise T2TwinError(
            f"{data} does not name its {lacks[0]}; a report of runs is of datasets of "
            "`t2twin simdata`, and of other pairs there is one without --runs"
        )


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


def _check_finished(run_dir: Path, config: RunConfig, history: list[dict[str, Any]]) -> None:
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
        same = (
            metrics["format"] == FORMAT
            and metrics["info_sha256"] == info.sha256
            and of_runs == [str(run) for run in runs]
        )
    except (ValueError, KeyError, TypeError, AttributeError):
        return None
    newer = all(made >= (run / BEST).stat().st_mtime for run in runs)
    return metrics if same and newer else None
