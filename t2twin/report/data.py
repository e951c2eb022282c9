"""Data of the reports: a dataset in memory, without images, which are read individually, and runs
with their evaluation.

An existing evaluation is used if it evaluates the same weights, in the same order, on the same
dataset.

Shape letters: P pairs of all splits, N taxels, R rows and C columns of an image.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from t2twin.core.errors import T2TwinError
from t2twin.core.images import decode_png
from t2twin.report.page import check_out, printable
from t2twin.sim.dataset.columns import CONTACT, COUNTS, IMAGE, POSE, column
from t2twin.sim.dataset.info import SPLITS, DatasetInfo, SensorInfo
from t2twin.sim.dataset.store import (
    INFO,
    iter_images,
    lists,
    read_info,
    read_split,
    sha256_of,
    split_shards,
)
from t2twin.sim.taxels.layout import Layout
from t2twin.sim.taxels.phi import Phi
from t2twin.sim.taxels.reading import expected_reading
from t2twin.translate.data.sides import TACTILE_IMAGE
from t2twin.translate.evaluation.evaluate import evaluate
from t2twin.translate.evaluation.predictions import (
    Predictions,
    read_predictions,
    run_names,
    splits_with_pairs,
)
from t2twin.translate.evaluation.records import Evaluation, read_evaluation
from t2twin.translate.evaluation.table import counts_form
from t2twin.translate.inference.load import load_run
from t2twin.translate.inference.predictor import TrainedTranslator
from t2twin.translate.runs.config import BEST, load_config, resolve_run
from t2twin.translate.runs.log import EpochRecord, read_log
from t2twin.translate.training.trainer import stop_reason

COLUMNS = ("shape", "family", "index", *POSE)
"""Columns of the tables, besides those of the sensors."""

SATURATED_SHARE = 0.999
"""Share of full scale above which a count is saturated (assumed: ten times the noise)."""

MIN_CONTACT_SHARE = 0.0025
"""Smallest count of a touched taxel, share of full scale (assumed)."""

AT_REST_STDS = 10.0
"""Smallest count of a touched taxel over its mean at rest, standard deviations of the noise
(assumed: 0.6 % of the samples without contact have one)."""

ROUNDING_COUNTS = 0.5

SIBLING_FOLDER = "evaluate"
"""Folder next to the report's folder, into which `make evaluate` writes val and test."""


@dataclass(frozen=True)
class Array:
    """A taxel array of a dataset.

    info: its record. phi: of its taxels. counts: (P, N), in the order of Dataset.column.
    """

    info: SensorInfo
    phi: Phi
    counts: np.ndarray

    @property
    def layout(self) -> Layout:
        """The taxels, with default pads if theirs are unknown."""
        return self.info.taxels

    @property
    def full_scale(self) -> int:
        """Count at which a taxel saturates."""
        assert self.info.full_scale_counts is not None
        return self.info.full_scale_counts

    @property
    def saturated(self) -> np.ndarray:
        """(P, N) bool: saturated counts; the mean of noisy, clipped ones is below full scale."""
        return self.counts >= SATURATED_SHARE * self.full_scale

    @property
    def largest(self) -> np.ndarray:
        """(P,) largest count of each pair."""
        return self.counts.max(axis=1)

    @property
    def touched(self) -> np.ndarray:
        """(P,) bool: pairs in which a taxel exceeds MIN_CONTACT_SHARE of full scale, and its
        readings at rest if their noise is known."""
        least = np.full(self.counts.shape[1], MIN_CONTACT_SHARE * self.full_scale)
        flaws = self.info.imperfections
        if flaws is not None:
            mean, std = expected_reading(flaws, self.info.reading, np.zeros_like(least))
            std = np.hypot(std, flaws.drift_counts if flaws.drift_share else 0.0)
            least = np.maximum(least, mean + AT_REST_STDS * std + ROUNDING_COUNTS)
        return np.any(self.counts >= least, axis=1)


@dataclass(frozen=True)
class Dataset:
    """A dataset for a report.

    data: folder. info: content of info.json. arrays: the taxel arrays by role. tables: COLUMNS of
    every split with pairs, and counts and contacts of the sensors.
    """

    data: Path
    info: DatasetInfo
    arrays: dict[str, Array]
    tables: dict[str, pa.Table]

    @property
    def cameras(self) -> dict[str, SensorInfo]:
        """The gel cameras by role."""
        return _of_value(self.info, IMAGE)

    @property
    def array(self) -> Array:
        """The taxel array, the target's first. Raises T2TwinError for a dataset without one."""
        return self.arrays[self.info.role_of(COUNTS)]

    def label(self, role: str) -> str:
        """Displayed name of a sensor, with its role if both sensors have the same name."""
        names = [printable(sensor.name) for sensor in self.info.sensors.values()]
        name = printable(self.info.sensors[role].name)
        return f"{name} ({role})" if names[0] == names[1] else name

    @property
    def camera_name(self) -> str:
        """Displayed name of the first gel camera. Raises T2TwinError for a dataset without one."""
        return self.label(self.info.role_of(IMAGE))

    @property
    def array_name(self) -> str:
        """Displayed name of `array`. Raises T2TwinError for a dataset without one."""
        return self.label(self.info.role_of(COUNTS))

    def image(self, split: str, row: int, role: str | None = None) -> np.ndarray:
        """The image of a row, (R, C, 3) uint8. role: of the gel camera; None for the first."""
        name = column(role or self.info.role_of(IMAGE), IMAGE)
        for path in split_shards(self.info, split):
            pairs = self.info.shards[path].pairs
            if row < pairs:
                return decode_png(next(islice(iter_images(self.data, path, name), row, None)))
            row -= pairs
        raise AssertionError("the row is in a shard of its split")

    def counts_of(self, split: str, row: int, role: str) -> np.ndarray:
        """(N,) float32: the counts of a row and role."""
        return np.array(self.row(split, row)[column(role, COUNTS)], dtype=np.float32)

    def row(self, split: str, row: int) -> dict[str, Any]:
        """Values of a row by column."""
        return self.tables[split].slice(row, 1).to_pylist()[0]

    def column(self, name: str) -> np.ndarray:
        """(P,) a column of all splits, such as "shape"; missing numbers are NaN."""
        return np.concatenate([table[name].to_numpy() for table in self.tables.values()])

    def contact(self, role: str, name: str) -> np.ndarray:
        """(P,) a column of the contacts of a sensor, as `column`."""
        return self.column(column(role, name))

    @property
    def splits(self) -> np.ndarray:
        """(P,) split of each pair, in the order of `column`."""
        return np.array([split for split, _ in self.places])

    @property
    def forces_n(self) -> np.ndarray:
        """(k,) unique commanded forces, N, ascending, rounded to 0.01 N; 0 without contact.

        Unknown forces are omitted.
        """
        force_n = self.column("force_n").astype(float)
        return np.unique(force_n[np.isfinite(force_n)].round(2))

    @property
    def places(self) -> list[tuple[str, int]]:
        """Split and row of every pair, in the order of `column`."""
        return [(split, row) for split, table in self.tables.items() for row in range(len(table))]

    @property
    def without_contact(self) -> np.ndarray:
        """(P,) bool: pairs in which no taxel is touched; without taxel arrays, of 0 N."""
        if not self.arrays:
            return self.column("force_n") == 0
        return ~np.any([array.touched for array in self.arrays.values()], axis=0)


def read_dataset(data: Path) -> Dataset:
    """Reads a dataset. Raises T2TwinError as Phi, and if it is missing, unfinished or empty."""
    info = read_info(data)
    splits = [split for split in SPLITS if info.pairs[split]]
    if not splits:
        raise T2TwinError(f"the dataset in {data} has no pairs")
    sensors = _of_value(info, COUNTS)
    names = [*COLUMNS, *(column(role, COUNTS) for role in sensors)]
    names += [column(role, name) for role in info.sensors for name in CONTACT]
    tables = {split: read_split(data, split, names) for split in splits}

    arrays = {}
    for role, sensor in sensors.items():
        counts = [lists(table, column(role, COUNTS)) for table in tables.values()]
        rows, columns, px_per_mm = sensor.tactile_image or TACTILE_IMAGE
        phi = Phi(np.array(sensor.x_mm), np.array(sensor.y_mm), (rows, columns), px_per_mm)
        arrays[role] = Array(sensor, phi, np.concatenate(counts))
    return Dataset(data, info, arrays, tables)


def _of_value(info: DatasetInfo, value: str) -> dict[str, SensorInfo]:
    """The sensors of a value, by role."""
    return {role: sensor for role, sensor in info.sensors.items() if sensor.value == value}


@dataclass(frozen=True)
class ReportData(Dataset):
    """Data of the report of runs.

    runs: by their names in the evaluation. histories: logs of the runs, one record per epoch.
    evaluations, predictions, folders (of the evaluations): by split, "val" and "test"; imported
    pairs may lack a split.
    """

    runs: dict[str, TrainedTranslator]
    histories: dict[str, list[EpochRecord]]
    evaluations: dict[str, Evaluation]
    predictions: dict[str, Predictions]
    folders: dict[str, Path]

    def counts(self, value: float) -> str:
        """A number of counts as text, with a decimal for a small full scale."""
        return counts_form(self.array.full_scale).format(value)

    @property
    def evaluation(self) -> Evaluation:
        """Evaluation of the first split, for content that all splits share."""
        return next(iter(self.evaluations.values()))


def read_report_data(
    out: Path, data: Path, runs: list[Path], evaluation: Path | None = None
) -> ReportData:
    """Reads the dataset, the runs and their evaluation.

    evaluation: a folder of `t2twin evaluate --split both`; see `_find_or_evaluate`. Raises
    T2TwinError, before anything is written, for a dataset, a run or a folder that cannot be used.
    """
    check_out(out)
    if not runs:
        raise T2TwinError(
            "there is no run to report on; expected at least one folder of `t2twin train`"
        )
    if evaluation is not None and not any((evaluation / name).is_dir() for name in SPLITS):
        raise T2TwinError(
            f"{evaluation} contains no evaluation; expected a folder of "
            "`t2twin evaluate --split both`"
        )
    runs = [resolve_run(run) for run in runs]
    dataset, splits = read_dataset(data), splits_with_pairs(data)
    histories = [read_log(run) for run in runs]
    for run, history in zip(runs, histories, strict=True):
        config = load_config(run)
        if stop_reason(config, history) is None:
            raise T2TwinError(
                f"{run} is unfinished after {len(history)} of {config.planned_epochs} epochs; the "
                "same `t2twin train` command resumes it"
            )
    loaded = [load_run(run) for run in runs]
    names = run_names(loaded)
    found = {s: _find_or_evaluate(loaded, names, data, s, out, evaluation) for s in splits}
    evaluations = {split: each for split, (_, each, _) in found.items()}
    return ReportData(
        **vars(dataset),
        runs=dict(zip(names, loaded, strict=True)),
        histories=dict(zip(names, histories, strict=True)),
        evaluations=evaluations,
        predictions={split: each for split, (_, _, each) in found.items()},
        folders={split: folder for split, (folder, _, _) in found.items()},
    )


def _find_or_evaluate(
    runs: Sequence[TrainedTranslator],
    names: Sequence[str],
    data: Path,
    split: str,
    out: Path,
    given: Path | None,
) -> tuple[Path, Evaluation, Predictions]:
    """Evaluation of runs on one split, and its folder.

    names: of the runs. data: the dataset. out: folder of the report. given: a folder of
    `t2twin evaluate --split both`. Searches given, the sibling folder of `out`, and
    out/evaluate-SPLIT for an evaluation of these weights, in this order, on this split of this
    dataset. Digests are compared, so folders may be moved and copied. If none matches, evaluates
    the runs into the last. Raises T2TwinError as `evaluate` does.
    """
    weights, info_sha256 = [sha256_of(run.run_dir / BEST) for run in runs], sha256_of(data / INFO)
    own = out / f"evaluate-{split}"
    folders = [out.parent / SIBLING_FOLDER / split, own]
    if given is not None:
        folders.insert(0, given / split)
    for folder in folders:
        try:
            evaluation, predictions = read_evaluation(folder), read_predictions(folder)
        except T2TwinError:
            continue  # there is no evaluation that this version can read
        if (
            evaluation.split == split
            and evaluation.info_sha256 == info_sha256
            and list(evaluation.runs) == names
            and [row.weights_sha256 for row in evaluation.runs.values()] == weights
            and list(predictions.by_model) == list(evaluation.models)
            and len(predictions.truth) == evaluation.pairs
        ):
            return folder, evaluation, predictions
    evaluation = evaluate([run.run_dir for run in runs], data, split, own)
    return own, evaluation, read_predictions(own)
