"""The inputs of an evaluation, the readings that runs predict, and the file predictions.npz.

The inputs are runs, a dataset and background frames, which are checked before the evaluation
starts. The file has the array "truth", one (P, N) array per model under the model's name, and the
arrays "shape", "family", "x_mm", "y_mm", "yaw_rad" and "force_n" of the pairs. For a model with
uncertainty there is another (P, N) array, "std of " and the name.

Shape letters: P pairs, N taxels, S image side.
"""

import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from PIL import Image

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write
from t2twin.sim.dataset.info import DatasetInfo, SensorInfo
from t2twin.sim.dataset.store import read_info
from t2twin.sim.optical.gel_camera import GelCamera
from t2twin.sim.sensors.files import bundled_sensors
from t2twin.sim.sensors.pair import SensorPair
from t2twin.translate.data.images import open_image, to_pixels
from t2twin.translate.data.pairs import (
    DataInfo,
    InputImages,
    has_backgrounds,
    load_info,
    load_pairs,
)
from t2twin.translate.data.sides import ArraySide
from t2twin.translate.evaluation.contact_errors import contact_metrics
from t2twin.translate.evaluation.records import ContactMetrics
from t2twin.translate.inference.load import load_torch
from t2twin.translate.inference.predictor import TrainedTranslator
from t2twin.translate.networks.field_net import side_of_maps
from t2twin.translate.uncertainty.estimate import Estimate, readings_of

SPLITS = ("val", "test")

OF_PAIRS, OF_OPTICS = "each pair's own", "that of the default optics"
"""Sources of frames that are not files."""

PREDICTIONS = "predictions.npz"
TRUTH, STD = "truth", "std of "
PAIR_ARRAYS = ("shape", "family", "x_mm", "y_mm", "yaw_rad", "force_n")
"""Arrays that are not of models."""


@dataclass(frozen=True)
class Background:
    """Background frames of a dataset.

    source: in words. image: one frame for all pairs, or None if each pair has its own.
    """

    source: str
    image: Image.Image | None


@dataclass(frozen=True)
class EvaluationInputs:
    """What an evaluation reads.

    trained: runs by name, at their own layouts. applied: the same at the dataset's layout.
    background: None if no run uses background frames or none are known. reverse: whether source and
    target of the runs exchange those of the dataset.
    """

    data_dir: Path
    dataset: DatasetInfo
    info: DataInfo
    trained: dict[str, TrainedTranslator]
    applied: dict[str, TrainedTranslator]
    background: Background | None
    reverse: bool = False


def prepare(
    runs: Sequence[str | Path],
    data_dir: Path,
    splits: Sequence[str],
    background: str | Path | None = None,
) -> EvaluationInputs:
    """Loads and checks the inputs of an evaluation. Arguments, errors: as for `evaluate`."""
    if not arguments.paths(runs, "runs"):
        raise T2TwinError("there is no run to evaluate; give at least one folder of `train`")
    dataset = read_info(data_dir)
    for split in (*splits, "train"):
        if split in dataset.pairs and not dataset.pairs[split]:
            raise T2TwinError(
                f"{data_dir} has no {split} pairs; an evaluation needs some, and train pairs for "
                "the baselines"
            )
    loaded = [load_torch(run) for run in runs]
    reverse = _is_reverse(loaded, dataset)
    info = load_info(data_dir, reverse)
    for run in loaded:
        _check_sides(run, info, data_dir)
    trained = dict(zip(run_names(loaded), loaded, strict=True))
    applied = {name: _applied(run, info) for name, run in trained.items()}
    has_dense_counts = any(run.has_uncertainty for run in loaded)
    if background is not None and not has_dense_counts:
        raise T2TwinError(
            f"{background} is a background frame, which only field runs use; none of the runs is "
            "one"
        )
    frames = background_of(data_dir, background) if has_dense_counts else None
    return EvaluationInputs(data_dir, dataset, info, trained, applied, frames, reverse)


def _is_reverse(runs: Sequence[TrainedTranslator], dataset: DatasetInfo) -> bool:
    """Whether source and target of the runs exchange those of the dataset.

    Raises T2TwinError for runs of several directions.
    """
    first, source, target = runs[0].config.data, dataset.source, dataset.target
    for run in runs:
        if run.config.direction != first.direction:
            raise T2TwinError(
                f"{runs[0].run_dir} is a {first.direction} run and {run.run_dir} a "
                f"{run.config.direction} run; evaluate runs of one direction together"
            )
    if source.value != target.value:
        return first.source.value != source.value
    names = (first.source.sensor, first.target.sensor)
    return names == (target.name, source.name) and source.name != target.name


def _check_sides(run: TrainedTranslator, info: DataInfo, data_dir: Path) -> None:
    """Raises T2TwinError for a dataset whose readings a run neither takes nor predicts."""
    trained = run.config.data
    is_other = trained.direction != info.direction
    takes = trained.source.fits(info.source)
    gives = run.config.is_image_to_counts or trained.target.fits(info.target)
    if is_other or not takes or not gives:
        raise T2TwinError(
            f"{run.run_dir} predicts {trained.target.words} from {trained.source.words}; "
            f"{data_dir} has {info.source.words} and {info.target.words}"
        )


def _applied(run: TrainedTranslator, info: DataInfo) -> TrainedTranslator:
    """The run at the dataset's layout."""
    if not run.config.is_image_to_counts:
        return run
    array = info.array
    return run.at_layout(array.x_mm, array.y_mm, array.layout, array.pad_diameter_mm)


def background_of(data_dir: Path, file: str | Path | None = None) -> Background | None:
    """The background frames of a dataset, None if none are known.

    They are those of the pairs, if the pairs have them. Otherwise they are `file`, an image of the
    sensor without contact, or the frame of its own light, if all images were made with it.
    Raises T2TwinError for a file that is not an image, and for one with pairs that have their own.
    """
    info = read_info(data_dir)
    if has_backgrounds(info):
        if file is not None:
            raise T2TwinError(
                f"the pairs in {data_dir} contain their own background frames; --background is for "
                "datasets without them"
            )
        return Background(OF_PAIRS, None)
    if file is not None:
        return Background(str(file), open_image(arguments.path(file, "background")))
    frame = frame_of_own_light(info)
    return None if frame is None else Background(OF_OPTICS, Image.fromarray(frame))


def frame_of_own_light(info: DatasetInfo, role: str | None = None) -> np.ndarray | None:
    """The background frame of a bundled sensor in its own light, if all images of a dataset were
    made with that, else None.

    role: of the gel camera, by default the first.
    """
    if info.recipe is None or info.recipe.light.kind != "fixed":
        return None
    sensor = bundled_in_own_light(info.camera if role is None else info.sensors[role])
    return None if sensor is None else sensor.image_renderer.background


def bundled_in_own_light(camera: SensorInfo) -> GelCamera | None:
    """The bundled sensor of a gel camera's name, if it has the same light, else None."""
    if camera.name not in bundled_sensors():
        return None
    sensor = SensorPair.of(camera.name).camera
    return sensor if sensor.optics_sha256 == camera.optics_sha256 else None


def run_names(runs: Sequence[TrainedTranslator]) -> list[str]:
    """Names of runs: their models, with the folder for runs of the same model.

    Raises T2TwinError for a run that occurs twice.
    """
    folders = [run.run_dir.resolve() for run in runs]
    twice = [
        run.run_dir for run, folder in zip(runs, folders, strict=True) if folders.count(folder) > 1
    ]
    if twice:
        raise T2TwinError(f"{twice[0]} is named twice; name each run once")
    models = [run.config.model for run in runs]
    names = [
        model if models.count(model) == 1 else f"{model} ({run.run_dir.name})"
        for model, run in zip(models, runs, strict=True)
    ]
    if len(set(names)) < len(names):
        return [f"{run.config.model} ({run.run_dir})" for run in runs]
    return names


def splits_with_pairs(data_dir: Path) -> tuple[str, ...]:
    """Those of validation and test that have pairs.

    Raises T2TwinError if neither has, and if there is no dataset.
    """
    pairs = read_info(data_dir).pairs
    splits = tuple(split for split in SPLITS if pairs[split])
    if not splits:
        raise T2TwinError(
            f"{data_dir} has neither validation nor test pairs; an evaluation needs one of them"
        )
    return splits


@dataclass(frozen=True)
class Predictions:
    """Predicted and true counts or images of P pairs.

    truth: (P, N), counts, or (P, S, S, c) uint8 images. by_model: the same by the model's name.
    presses: (P,) arrays by the names in PAIR_ARRAYS. std_by_model: (P, N), counts, the standard
    deviations of models that predict them.
    """

    truth: np.ndarray
    by_model: dict[str, np.ndarray]
    presses: dict[str, np.ndarray]
    std_by_model: dict[str, np.ndarray] = field(default_factory=dict)

    def rmse_counts(self, model: str) -> np.ndarray:
        """RMSE of each pair, over its taxels: (P,), counts."""
        return np.sqrt(np.square(self.by_model[model] - self.truth).mean(axis=1, dtype=float))


def predict_runs(
    inputs: EvaluationInputs, split: str, cache: Path
) -> tuple[dict[str, np.ndarray], dict[str, Estimate], dict[str, ContactMetrics]]:
    """(P, N) counts or (P, S, S, c) images that each run predicts, and estimates of field runs.

    Also the errors of runs that predict the contact, if the pairs have contact maps.
    """
    target = inputs.info.target
    has_dense_counts = isinstance(target, ArraySide) and target.dense_x_mm is not None
    background = inputs.background
    predictions, estimates, contacts = {}, {}, {}
    for name, run in inputs.applied.items():
        preset = run.config.preset
        has_contact = run.predicts_contact
        # Pairs with dense counts usually have background frames too.
        with_dense_counts = run.has_uncertainty and has_dense_counts
        own = load_pairs(
            inputs.data_dir, split, preset.size, preset.grey, cache, with_dense_counts,
            inputs.reverse, side_of_maps(preset.size) if has_contact else None,
        )  # fmt: skip
        if run.has_uncertainty:
            images = own.inputs
            if background is not None and background.image is not None:
                frame = to_pixels(background.image, preset.size, grey=False)
                images = InputImages(own.images, np.broadcast_to(frame, (len(own), *frame.shape)))
            found = run.estimate_pixels(images, progress=name)
            estimates[name] = as_readings(found, inputs.dataset)
            predictions[name] = estimates[name].counts
            if own.contact is not None:
                title = f"contact of {name}"
                contacts[name] = contact_metrics(run, images, own.contact, own.force_n, title)
        else:
            predictions[name] = run.predict_pixels(own.inputs, progress=name)
    return predictions, estimates, contacts


def as_readings(estimate: Estimate, info: DatasetInfo) -> Estimate:
    """An estimate of readings of the dataset's array, from one of noiseless counts."""
    array = info.array
    if array.imperfections is None:
        return estimate
    counts, std = readings_of(estimate, array.imperfections, array.reading)
    return replace(estimate, counts=counts, counts_std=std)


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
    stds = {n.removeprefix(STD): models.pop(n) for n in list(models) if n.startswith(STD)}
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
