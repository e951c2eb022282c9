"""predictions.npz: what each row of an evaluation says of every pair, with the presses.

It holds "truth" and one (P, N) array a model, by the models' names, and by pair "shape", "family",
"x_mm", "y_mm", "yaw_rad" and "force_n". Of a model that says how sure it is there is another
(P, N) array, "std of " and its name.

Shape letters: P pairs, N taxels.

Each model's row of an evaluation: its figures, overall, by shape, by family and by force.

Shape letters: P pairs, N taxels.
"""

import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write
from t2twin.sim.cyskin.phi import Phi
from t2twin.sim.dataset.store import sha256_of
from t2twin.translate.data.pairs import DataInfo, Pairs
from t2twin.translate.evaluation.findings import paired
from t2twin.translate.evaluation.metrics import bootstrap
from t2twin.translate.evaluation.metrics.array_errors import compare
from t2twin.translate.evaluation.metrics.floors import FieldOfView
from t2twin.translate.evaluation.metrics.forces import ForceBin, by_force
from t2twin.translate.evaluation.records import Difference, ModelRow
from t2twin.translate.inference.predictor import TrainedTranslator
from t2twin.translate.runs.config import BEST
from t2twin.translate.runs.log import read_log

PREDICTIONS = "predictions.npz"
TRUTH, STD = "truth", "std of "
OF_PAIRS = ("shape", "family", "x_mm", "y_mm", "yaw_rad", "force_n")
"""Arrays that are no model's."""


@dataclass(frozen=True)
class Predictions:
    """Counts that the models predict, beside the true ones.

    truth: (P, N), counts. by_model: the same by the model's name. shapes, families: (P,) names.
    x_mm, y_mm, yaw_rad, force_n: (P,) the presses. std_by_model: (P, N), counts, the standard
    deviations of the models that say them.
    """

    truth: np.ndarray
    by_model: dict[str, np.ndarray]
    shapes: np.ndarray
    families: np.ndarray
    x_mm: np.ndarray
    y_mm: np.ndarray
    yaw_rad: np.ndarray
    force_n: np.ndarray
    std_by_model: dict[str, np.ndarray] = field(default_factory=dict)

    def rmse_counts(self, model: str) -> np.ndarray:
        """RMSE of each pair, over its taxels: (P,), counts."""
        return np.sqrt(np.square(self.by_model[model] - self.truth).mean(axis=1, dtype=float))


def read_predictions(folder: Path) -> Predictions:
    """The predictions in an evaluation's folder.

    Raises T2TwinError where the file is missing or damaged.
    """
    path = folder / PREDICTIONS
    if not path.is_file():
        raise T2TwinError(f"{folder} holds no {PREDICTIONS}; evaluate the runs again")
    try:
        with path.open("rb") as file, np.load(file) as arrays:
            truth = arrays[TRUTH]
            of_pairs = [arrays[name] for name in OF_PAIRS]
            rest = {name: arrays[name] for name in arrays.files if name not in (TRUTH, *OF_PAIRS)}
    except (OSError, ValueError, TypeError, KeyError, EOFError, zipfile.BadZipFile, zlib.error):
        raise T2TwinError(f"{path} is damaged; evaluate the runs again") from None
    stds = {name: rest.pop(name) for name in list(rest) if name.startswith(STD)}
    stds = {name.removeprefix(STD): of_model for name, of_model in stds.items()}
    return Predictions(truth, rest, *of_pairs, std_by_model=stds)


def write_predictions(folder: Path, predictions: Predictions) -> None:
    """Writes folder/predictions.npz, whole or not at all."""
    of_pairs = (
        predictions.shapes,
        predictions.families,
        predictions.x_mm,
        predictions.y_mm,
        predictions.yaw_rad,
        predictions.force_n,
    )
    with atomic_write(folder / PREDICTIONS) as temporary, temporary.open("wb") as file:
        np.savez_compressed(
            file,
            allow_pickle=False,
            **{TRUTH: predictions.truth},
            **predictions.by_model,
            **{f"{STD}{name}": stds for name, stds in predictions.std_by_model.items()},
            **dict(zip(OF_PAIRS, of_pairs, strict=True)),
        )


MAX_SHAPES = 200
"""Shapes of a split that figures are given of one by one (assumed: nobody reads more)."""


def rows_of(
    predictions: Mapping[str, np.ndarray],
    pairs: Pairs,
    info: DataInfo,
    view: FieldOfView,
    bins: tuple[ForceBin, ...],
) -> tuple[dict[str, ModelRow], dict[str, Difference]]:
    """Each model's row, and how the two translators differ in the same resamples, by figure.

    predictions: (P, N) counts by the model's name. bins: the pairs by force.
    """
    phi = Phi(info.x_mm, info.y_mm)
    full_scale = info.full_scale_counts
    few = np.unique(pairs.shapes).size <= MAX_SHAPES
    rows, resampled = {}, {}
    for name, predicted in predictions.items():
        progress = f"figures of {name}"
        figures = compare(predicted, pairs.counts, phi, full_scale, progress, view.groups)
        resampled[name] = bootstrap.replicates(figures, pairs.shapes, full_scale)
        rows[name] = ModelRow(
            overall=figures.summary(full_scale),
            by_shape=figures.by_name(full_scale, pairs.shapes) if few else {},
            by_family=figures.by_name(full_scale, pairs.families),
            interval=bootstrap.intervals(resampled[name]),
            by_force=by_force(predicted, figures, pairs, bins, full_scale),
        )
    return rows, paired(rows, resampled)


def row_of_run(row: ModelRow, run: TrainedTranslator, info: DataInfo) -> ModelRow:
    """A row that also says which run it is of, and what that was trained on.

    info: of the dataset that it is evaluated on, which knows what older runs do not say of it.
    """
    trained = run.config.data
    same_data = trained.sha256 == info.sha256
    pairs = info.train_pairs if same_data else trained.train_pairs
    return replace(
        row,
        run=str(run.run_dir),
        weights_sha256=sha256_of(run.run_dir / BEST),
        same_data=same_data,
        trained_layout=trained.layout,
        trained_data=trained.sha256,
        trained_world=info.world if same_data else trained.world,
        trained_pairs=pairs,
        trained_steps=steps_taken(run, pairs),
    )


def steps_taken(run: TrainedTranslator, pairs: int | None) -> int | None:
    """Steps that a run has taken on so many pairs; None where its log is not there or it does not
    say.

    Runs of older versions went through all of their pairs in every epoch.
    """
    config = run.config
    all_of_them = None if pairs is None else max(1, pairs // config.preset.batch)
    steps = config.epoch_steps or all_of_them
    try:
        return None if steps is None else steps * len(read_log(run.run_dir))
    except T2TwinError:  # a run predicts without its log
        return None
