"""The predicted counts of all rows of an evaluation, and their file, predictions.npz.

The file has the array "truth", one (P, N) array per model under the model's name, and the arrays
"shape", "family", "x_mm", "y_mm", "yaw_rad" and "force_n" of the pairs. For a model with
uncertainty there is another (P, N) array, "std of " and the name.

Shape letters: P pairs, N taxels.
"""

import zipfile
import zlib
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write
from t2twin.sim.cyskin.reading import expected_reading
from t2twin.sim.dataset.info import DatasetInfo
from t2twin.translate.data.pairs import InputImages, Pairs, load_pairs
from t2twin.translate.evaluation.metrics.baselines import (
    LAYOUT_FLOOR,
    MEAN_ARRAY,
    NEAREST_NEIGHBOR,
    NOISE_FLOOR,
    Neighbors,
    mean_array,
    representable,
    second_reading,
)
from t2twin.translate.evaluation.metrics.forces import (
    MEAN_ARRAY_OF_FORCE,
    ForceBin,
    mean_array_of_force,
)
from t2twin.translate.evaluation.prepare import EvaluationInputs
from t2twin.translate.inference.predictor import FieldPredictor
from t2twin.translate.models.layouts import same_layout
from t2twin.translate.uncertainty.estimate import Estimate

PREDICTIONS = "predictions.npz"
TRUTH, STD = "truth", "std of "
PAIR_ARRAYS = ("shape", "family", "x_mm", "y_mm", "yaw_rad", "force_n")
"""Arrays that are not of models."""


@dataclass(frozen=True)
class Predictions:
    """Predicted and true counts of P pairs.

    truth: (P, N), counts. by_model: the same by the model's name. presses: (P,) arrays by the names
    in PAIR_ARRAYS. std_by_model: (P, N), counts, the standard deviations of models that predict
    them.
    """

    truth: np.ndarray
    by_model: dict[str, np.ndarray]
    presses: dict[str, np.ndarray]
    std_by_model: dict[str, np.ndarray] = field(default_factory=dict)

    def rmse_counts(self, model: str) -> np.ndarray:
        """RMSE of each pair, over its taxels: (P,), counts."""
        return np.sqrt(np.square(self.by_model[model] - self.truth).mean(axis=1, dtype=float))


def predict_baselines(
    inputs: EvaluationInputs,
    pairs: Pairs,
    train: Pairs,
    near: Neighbors,
    bins: tuple[ForceBin, ...],
) -> dict[str, np.ndarray]:
    """(P, N) counts of the trivial predictors and of the floors that are known, by row."""
    rows = {MEAN_ARRAY: np.tile(mean_array(train), (len(pairs), 1))}
    if len(bins) > 1:
        rows[MEAN_ARRAY_OF_FORCE] = mean_array_of_force(bins, pairs, train)
    rows[NEAREST_NEIGHBOR] = train.counts[near.index[:, 0]]
    repeated = second_reading(pairs.counts, inputs.dataset)
    if repeated is not None:
        rows[NOISE_FLOOR] = repeated
    x_mm, y_mm = inputs.info.x_mm, inputs.info.y_mm
    for run in inputs.trained.values():  # the first of another layout
        if not isinstance(run, FieldPredictor) and not same_layout(run.config.data, x_mm, y_mm):
            projection = representable(run.config.data, x_mm, y_mm)
            rows[LAYOUT_FLOOR] = (pairs.counts @ projection.T).astype(np.float32)
            break
    return rows


def predict_runs(
    inputs: EvaluationInputs, split: str, cache: Path
) -> tuple[dict[str, np.ndarray], dict[str, Estimate]]:
    """(P, N) counts that each run predicts, and the estimates of field runs."""
    has_field = inputs.info.field_x_mm is not None
    background = inputs.background
    predictions, estimates = {}, {}
    for name, run in inputs.applied.items():
        preset = run.config.preset
        # Pairs with a field usually have background frames too.
        with_field = isinstance(run, FieldPredictor) and has_field
        own = load_pairs(inputs.data_dir, split, preset.size, preset.grey, cache, with_field)
        if isinstance(run, FieldPredictor):
            fixed = None if background is None else background.at_size(preset.size)
            images = own.inputs if fixed is None else InputImages(own.images, fixed)
            found = run.estimate_pixels(images, progress=name)
            estimates[name] = as_readings(found, inputs.dataset)
            predictions[name] = estimates[name].counts
        else:
            predictions[name] = run.predict_pixels(own.images, progress=name)
    return predictions, estimates


def as_readings(estimate: Estimate, info: DatasetInfo) -> Estimate:
    """An estimate of readings of the dataset's array, from one of noiseless counts.

    Counts at rest and noise are known properties of the array, which field runs do not predict.
    """
    if info.parameters is None:
        return estimate
    mean, noise = expected_reading(info.parameters.cyskin.imperfections, estimate.counts)
    std = np.hypot(estimate.counts_std, noise)
    return replace(estimate, counts=mean.astype(np.float32), counts_std=std.astype(np.float32))


def read_predictions(folder: Path) -> Predictions:
    """Reads the predictions in the folder of an evaluation.

    Raises T2TwinError if the file is missing or damaged.
    """
    path = folder / PREDICTIONS
    if not path.is_file():
        raise T2TwinError(f"{folder} contains no {PREDICTIONS}; evaluate the runs again")
    try:
        with path.open("rb") as file, np.load(file) as arrays:
            truth = arrays[TRUTH]
            presses = {name: arrays[name] for name in PAIR_ARRAYS}
            known = (TRUTH, *PAIR_ARRAYS)
            models = {name: arrays[name] for name in arrays.files if name not in known}
    except (OSError, ValueError, TypeError, KeyError, EOFError, zipfile.BadZipFile, zlib.error):
        raise T2TwinError(f"{path} is damaged; evaluate the runs again") from None
    stds = {name: models.pop(name) for name in list(models) if name.startswith(STD)}
    stds = {name.removeprefix(STD): std for name, std in stds.items()}
    return Predictions(truth, models, presses, stds)


def write_predictions(folder: Path, predictions: Predictions) -> None:
    """Writes folder/predictions.npz."""
    with atomic_write(folder / PREDICTIONS) as temporary, temporary.open("wb") as file:
        np.savez_compressed(
            file,
            allow_pickle=False,
            **{TRUTH: predictions.truth},
            **predictions.by_model,
            **{f"{STD}{name}": stds for name, stds in predictions.std_by_model.items()},
            **predictions.presses,
        )
