"""Evaluation of trained runs: the paper's table, with baselines, error floors and intervals.

Shape letters: P pairs, N taxels, S side and c channels of a picture.
"""

import zipfile
import zlib
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import msgspec
import numpy as np
import pandas as pd
import torch
from PIL import Image

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError, warn
from t2twin.core.files import check_own, result_folder, sha256_of, write_json
from t2twin.core.frame_order import UPRIGHT
from t2twin.core.tables import markdown
from t2twin.sim.dataset.generate import sensor_info
from t2twin.sim.dataset.info import COUNTS, IMAGE, ArrayInfo, CameraInfo, DatasetInfo
from t2twin.sim.dataset.info import SPLITS as ALL_SPLITS
from t2twin.sim.dataset.store import read_info
from t2twin.sim.optical.gel_camera import GelCamera
from t2twin.sim.sensors.files import bundled_sensors
from t2twin.sim.sensors.pair import SensorPair
from t2twin.translate.data.images import COLORS, read_image, to_input, to_pixels
from t2twin.translate.data.pairs import (
    DataInfo,
    ImageFile,
    Pairs,
    Pictures,
    has_backgrounds,
    load_info,
    load_pairs,
    usable_cache,
)
from t2twin.translate.evaluation import baselines, metrics
from t2twin.translate.evaluation.records import METRICS, Evaluation, Figures, ModelRow
from t2twin.translate.evaluation.table import results_tables
from t2twin.translate.inference.estimate import Estimate, half_width
from t2twin.translate.inference.load import load
from t2twin.translate.inference.predictor import TrainedTranslator, parts_of
from t2twin.translate.models.field import CONTACT_KPA, EVEN, center_of_pressure
from t2twin.translate.models.field_net import side_of_maps
from t2twin.translate.runs.config import BEST, read_log
from t2twin.translate.uncertainty.ood import unlike

SPLITS = ("val", "test")

RESULTS, BOTH = "results.md", "both"  # table of validation and test, as far as there are pairs
KIND = "evaluation"  # of result
MAX_SHAPES = 200  # with figures of their own (assumed: more are not read)
TOUCH2TOUCH, RESNET18 = "touch2touch", "resnet18"  # the paper's: their difference has an interval
OF_PAIRS, OF_OPTICS = "each pair's own", "that of the default optics"  # frames that are not files
CLASSIFIED = 200  # first pairs of a split, whose images are classified (assumed: a few seconds)
FALSE_ALARMS = 0.05  # share of them that is usual (assumed; of validation pairs 1 to 2 %)
MIN_CELLS = 4  # of a contact (assumed: smaller ones are not resolved)
# Arrays of the pairs in predictions.npz, besides the truth and each model's predictions and std
PREDICTIONS, TRUTH, STD = "predictions.npz", "truth", "std of "
PAIR_ARRAYS = ("shape", "family", "x_mm", "y_mm", "yaw_rad", "force_n")

Found = tuple[dict[str, pd.DataFrame], dict[str, dict[str, Any]], "Predictions", dict[str, Any]]
"""Values of the pairs and further fields by row, predictions, and fields of the evaluation."""


@dataclass(frozen=True)
class EvaluationInputs:
    """What an evaluation reads."""

    data_dir: Path
    dataset: DatasetInfo
    info: DataInfo
    trained: dict[str, TrainedTranslator]  # runs by name, at their own layouts
    applied: dict[str, TrainedTranslator]  # the same at the dataset's layout
    background: str | None  # source of the background frames of field runs, None if unknown
    frame: np.ndarray | None  # one for all pairs, None if each has its own
    reverse: bool  # whether source and target of the runs exchange those of the dataset


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
    loaded = [load(run, engine="torch") for run in runs]
    first, source, target = loaded[0].config.data, dataset.source, dataset.target
    reverse = first.source.value != source.value
    if source.value == target.value:
        names = (first.source.name, first.target.name)
        reverse = names == (target.name, source.name) and source.name != target.name
    info = load_info(data_dir, reverse)
    for run in loaded:
        own = run.config.data
        if own.direction != first.direction:
            raise T2TwinError(
                f"{loaded[0].name} predicts {first.direction} and {run.name} {own.direction}; "
                "evaluate runs of one direction together"
            )
        _check_sensors(run, info, data_dir)
    applied = trained = dict(zip(run_names(loaded), loaded, strict=True))
    if loaded[0].config.is_image_to_counts:
        applied = {name: run._at_layout(info.array.taxels) for name, run in trained.items()}
    still = None, None
    if any(run.config.has_uncertainty for run in loaded):
        still = _background(dataset, data_dir, background)
    elif background is not None:
        raise T2TwinError(
            f"{background} is a background frame, which only field runs use; none of the runs is "
            "one"
        )
    return EvaluationInputs(data_dir, dataset, info, trained, applied, *still, reverse)


def _check_sensors(run: TrainedTranslator, info: DataInfo, data_dir: Path) -> None:
    """Raises T2TwinError for readings that cannot be compared, and warns of another sensor."""
    own, which = run.config.data, ""
    fits = own.direction == info.direction and own.source.fits(info.source)
    if fits and isinstance(own.target, ArrayInfo):
        which = " and ".join(own.target.incomparable(info.target))
    gives = run.config.is_image_to_counts or own.target.fits(info.target)
    if which or not (fits and gives):
        which = which and f" with another {which}; such counts cannot be compared"
        raise T2TwinError(
            f"{run.name} predicts {own.target.words} from {own.source.words}; "
            f"{data_dir} has {info.source.words} and {info.target.words}{which}"
        )
    sides = [(own.source, info.source), (own.target, info.target)]
    for one, other in sides[: 1 + run.config.predicts_images]:
        if found := one.differences(other):
            which = "" if "name" in found else f" with another {' and '.join(found)}"
            words = f"{one.name}, and {data_dir} is of {other.name}{which}"
            warn(f"{run.name} is trained on {words}; its errors are those on another sensor")


def _background(
    info: DatasetInfo, data_dir: Path, file: str | Path | None
) -> tuple[str | None, np.ndarray | None]:
    """Source of the background frames, None if unknown, and the frame, None if of each pair."""
    if has_backgrounds(info):
        if file is not None:
            raise T2TwinError(
                f"the pairs in {data_dir} contain their own background frames; --background is for "
                "datasets without them"
            )
        return OF_PAIRS, None
    if file is not None:
        return str(file), read_image(arguments.path(file, "background"), info.order or UPRIGHT)
    frame = frame_of_own_light(info, info.camera)
    return None if frame is None else OF_OPTICS, frame


def frame_of_own_light(info: DatasetInfo, camera: CameraInfo) -> np.ndarray | None:
    """The background frame of a bundled sensor in its own light, if all images of a dataset's gel
    camera were made with that, else None."""
    if info.recipe is None or info.recipe.light.kind != "fixed":
        return None
    sensor = bundled_in_own_light(camera)
    return None if sensor is None else sensor.image_renderer.background


def bundled_in_own_light(camera: CameraInfo) -> GelCamera | None:
    """The bundled sensor of a gel camera's name, if it has the same light, else None."""
    if camera.name not in bundled_sensors():
        return None
    sensor = SensorPair.of(camera.name).camera
    return sensor if sensor.optics_sha256 == camera.optics_sha256 else None


def run_names(runs: Sequence[TrainedTranslator]) -> list[str]:
    """Names of runs: their models, with the folder for runs of the same model, each once."""
    folders = [run.run_dir.resolve() for run in runs]
    for run, folder in zip(runs, folders, strict=True):
        if folders.count(folder) > 1:
            raise T2TwinError(f"{run.name} is named twice; name each run once")
    models = [run.config.model for run in runs]
    names = [
        model if models.count(model) == 1 else f"{model} ({run.run_dir.name})"
        for model, run in zip(models, runs, strict=True)
    ]
    if len(set(names)) < len(names):
        return [f"{run.config.model} ({run.name})" for run in runs]
    return names


def splits_with_pairs(data_dir: Path) -> tuple[str, ...]:
    """Those of validation and test that have pairs; an error if neither has."""
    pairs = read_info(data_dir).pairs
    splits = tuple(split for split in SPLITS if pairs[split])
    if not splits:
        raise T2TwinError(
            f"{data_dir} has neither validation nor test pairs; an evaluation needs one of them"
        )
    return splits


def predict_runs(
    inputs: EvaluationInputs, split: str, cache: Path
) -> tuple[dict[str, np.ndarray], dict[str, Estimate], dict[str, Figures]]:
    """(P, N) counts or (P, S, S, c) images that each run predicts, estimates of field runs.

    Also the errors of runs that predict the contact, if the pairs have contact maps."""
    target = inputs.info.target
    has_dense_counts = target.value == COUNTS and target.dense_x_mm is not None
    predictions, estimates, contacts = {}, {}, {}
    for name, run in inputs.applied.items():
        preset, is_sure = run.config.preset, run.config.has_uncertainty
        side = side_of_maps(preset.size) if run.config.predicts_contact else None
        own = load_pairs(
            inputs.data_dir, split, preset.size, preset.grey, cache, is_sure and has_dense_counts,
            inputs.reverse, side,
        )  # fmt: skip
        images = own.inputs
        if is_sure and inputs.frame is not None:
            frame = to_pixels(Image.fromarray(inputs.frame), preset.size, grey=False)
            still = np.broadcast_to(frame, (len(own), *frame.shape))
            images = replace(own.images, backgrounds=still)
        if isinstance(images, ImageFile):
            first, order = images[:CLASSIFIED], inputs.dataset.order or UPRIGHT
            classes, frames = run.classify(first), [*map(np.squeeze, first[..., :COLORS])]
            is_usual = np.mean([each.inside is False for each in classes]) <= FALSE_ALARMS
            words = None if is_usual else f"first images of {split}: {unlike(classes, run.name)}"
            warn(words, run._order_warning(classes, inputs.frame, frames, order))
        if not is_sure:
            predictions[name] = run._predict_pixels(images, progress=name)
            continue
        found = run._estimate_pixels(images, progress=name)
        estimates[name] = as_readings(found, inputs.dataset)
        predictions[name] = estimates[name].counts
        if own.contact is not None:
            contacts[name] = contact_metrics(run, images, own.contact, own.force_n, name)
    return predictions, estimates, contacts


def as_readings(estimate: Estimate, info: DatasetInfo) -> Estimate:
    """An estimate of readings of the dataset's array, from one of noiseless counts."""
    array = info.array
    if array.imperfections is None:
        return estimate
    return estimate.of_readings(array.imperfections, array.reading)


def contact_metrics(
    run: TrainedTranslator, pictures: Pictures, contact: ImageFile, force_n: np.ndarray, name: str
) -> Figures:
    """The errors of a run that predicts the contact, in the cells of its maps.

    pictures: inputs of P pairs, as for `_estimate_pixels`. contact: their contact maps. force_n:
    (P,), 0 without contact; other pairs may have their contact outside the view.
    """
    half, view_mm = half_width(metrics.REPORTED_LEVEL), run.config.data.camera.view_mm
    parts, false_contacts = [], []
    for part in parts_of(len(contact), f"contact of {name}"):
        inputs = to_input(pictures[part].astype(np.float32) / 255.0)
        found = SimpleNamespace(**run.translator.predict_all(inputs, True))
        maps = torch.from_numpy(contact[part].astype(np.float32)).to(found.depth_mm.device)
        depth, pressure = maps.unbind(dim=1)
        inside, mask = pressure > CONTACT_KPA, found.probability > EVEN
        cells, total = inside.sum(dim=(1, 2)), pressure.sum(dim=(1, 2))
        error, deepest = found.depth_mm - depth, (depth * inside).amax(dim=(1, 2))
        center, _ = center_of_pressure(pressure, pressure, view_mm)
        off_mm = found.center_mm - center
        values = {
            "depth_mm": ((error.square() * inside).sum(dim=(1, 2)) / cells).sqrt(),
            "deepest": ((found.depth_mm * inside).amax(dim=(1, 2)) - deepest).abs() / deepest,
            "iou": (inside & mask).sum(dim=(1, 2)) / (inside | mask).sum(dim=(1, 2)),
            "force": (found.pressure_kpa.sum(dim=(1, 2)) - total).abs() / total,
            "center_mm": off_mm.square().sum(dim=1).sqrt(),
            "covered": ((error.abs() <= half * found.depth_std_mm) & inside).sum(dim=(1, 2))
            / cells,
            "centered": (off_mm.abs() <= half * found.center_std_mm).float().mean(dim=1),
        }
        table = pd.DataFrame({name: each.double().cpu() for name, each in values.items()})
        parts.append(table[(cells >= MIN_CELLS).cpu().numpy()])
        false_contacts.append(mask.flatten(1).any(dim=1).cpu().numpy()[force_n[part] == 0.0])
    errors, false = pd.concat(parts), np.concatenate(false_contacts)
    middle, mean = errors.median(), errors.mean()
    return metrics.known(
        {
            "pairs": len(errors),
            "depth_rmse_mm": middle.depth_mm,
            "depth_mean_rmse_mm": mean.depth_mm,
            "deepest_error_percent": 100.0 * middle.deepest,
            "deepest_worst_percent": 100.0 * errors.deepest.max(),
            "iou": mean.iou,
            "force_in_view_error_percent": 100.0 * middle.force,
            "center_error_mm": middle.center_mm,
            "depth_coverage_percent": 100.0 * mean.covered,
            "center_coverage_percent": 100.0 * mean.centered,
            "missed_percent": 100.0 * errors.center_mm.isna().mean(),
            "false_percent": 100.0 * pd.Series(false).mean(),
        }
    )


@dataclass(frozen=True)
class Predictions:
    """Predicted and true counts or images of P pairs."""

    truth: np.ndarray  # (P, N), counts, or (P, S, S, c) uint8 images
    by_model: dict[str, np.ndarray]  # the same by the model's name
    presses: dict[str, np.ndarray]  # (P,) arrays by the names in PAIR_ARRAYS
    std_by_model: dict[str, np.ndarray]  # (P, N), counts, of models that predict it

    def rmse_counts(self, model: str) -> np.ndarray:
        """RMSE of each pair, over its taxels: (P,), counts."""
        return np.sqrt(np.square(self.by_model[model] - self.truth).mean(axis=1, dtype=float))


def read_predictions(folder: Path) -> Predictions:
    """The predictions of an evaluation's folder; an error if the file is missing or damaged."""
    path = folder / PREDICTIONS
    try:
        with path.open("rb") as file, np.load(file) as arrays:
            models = dict(arrays)
        truth = models.pop(TRUTH)
        presses = {name: models.pop(name) for name in PAIR_ARRAYS}
    except (OSError, ValueError, TypeError, KeyError, EOFError, zipfile.BadZipFile, zlib.error):
        raise T2TwinError(f"{path} is missing or damaged; evaluate the runs again") from None
    stds = {n.removeprefix(STD): models.pop(n) for n in list(models) if n.startswith(STD)}
    return Predictions(truth, models, presses, stds)


def evaluate(
    runs: Sequence[str | Path],
    data_dir: str | Path,
    split: str,
    out_dir: str | Path,
    background: str | Path | None = None,
) -> Evaluation:
    """Evaluates runs and baselines; writes metrics.json and predictions.npz into out_dir.

    runs: folders that `train` has made, all of one direction between the dataset's sensors.
    touch2touch and field runs from images to counts may have another taxel layout than the dataset,
    which is then read from their images or dense counts. split of data_dir: "val", "test", "train".
    background: an image of the dataset's sensor without contact, in the order of imported images,
    for field runs. The default is that of each pair, or of the default optics.
    Returns the content of metrics.json: baselines and floors, then the runs, by their models'
    names. predictions.npz contains the counts or images of each row.
    Warns with T2TwinWarning of another source, and of images unlike a run's training, of the first
    200. Raises T2TwinError for no runs, a folder that is not a run, and a layout that a run cannot
    be read at. It also does for counts of another cover, full scale or gain, a background frame
    without a field run, and for a split or training split without pairs.
    """
    data_dir, out_dir = arguments.path(data_dir, "data_dir"), arguments.path(out_dir, "out_dir")
    arguments.choice(split, "split", ALL_SPLITS)
    return evaluate_splits(runs, data_dir, split, out_dir, background)[split]


def evaluate_splits(
    runs: Sequence[str | Path],
    data_dir: Path,
    split: str,
    out_dir: Path,
    background: str | Path | None = None,
) -> dict[str, Evaluation]:
    """`evaluate` on one split, or on "both", validation and test as far as they have pairs, into
    out_dir/val and out_dir/test, with their tables in results.md. Returns evaluations by split."""
    is_both = split == BOTH
    splits = splits_with_pairs(data_dir) if is_both else (split,)
    inputs = prepare(runs, data_dir, splits, background)
    evaluations, files = {}, [PREDICTIONS, METRICS]
    was_both = RESULTS in check_own(out_dir, (), KIND)
    with result_folder(out_dir, KIND, [RESULTS] if is_both else files) as whole:
        for each in splits:
            folder = out_dir / each if is_both else out_dir
            with result_folder(folder, KIND, files) if is_both else nullcontext(whole) as temporary:
                cache = usable_cache(inputs.data_dir, folder)
                evaluations[each], found = _evaluate(inputs, each, cache)
                stds = {f"{STD}{name}": values for name, values in found.std_by_model.items()}
                arrays = {TRUTH: found.truth} | found.by_model | stds | found.presses
                np.savez_compressed(temporary / PREDICTIONS, allow_pickle=False, **arrays)
                write_json(temporary / METRICS, msgspec.to_builtins(evaluations[each]))
        if is_both:
            tables = map(markdown, results_tables(evaluations))
            (whole / RESULTS).write_text("\n".join(tables), encoding="utf-8")
    for each in {*SPLITS} - {*(splits if is_both else ())} if was_both else ():
        with result_folder(out_dir / each, KIND):
            pass  # without new files, the earlier ones are removed
    return evaluations


def _evaluate(inputs: EvaluationInputs, split: str, cache: Path) -> tuple[Evaluation, Predictions]:
    info = inputs.info
    pairs, train = (
        load_pairs(inputs.data_dir, s, baselines.FEATURE_SIZE, False, cache, reverse=inputs.reverse)
        for s in (split, "train")
    )
    find = _counts if info.target.value == COUNTS else _images
    tables, more, predictions, fields_of_target = find(inputs, split, cache, pairs, train)
    full_scale, shapes = info.target.full_scale, pairs.shapes
    number, moving, rows = int(np.unique(shapes).size), pairs.is_moving, {}
    groups = {"by_family": pairs.families}
    if number <= MAX_SHAPES:
        groups["by_shape"] = shapes
    if moving is not None:
        groups["by_motion"] = np.where(moving, "moving", "still")
    for name, values in tables.items():
        rows[name] = ModelRow(
            overall=metrics.overall(values, full_scale),
            interval=metrics.intervals(values, full_scale, shapes),
            **{by: metrics.by_name(values, full_scale, names) for by, names in groups.items()},
            **more.get(name, {}),
            **(_run_fields(inputs.trained[name], info) if name in inputs.trained else {}),
        )
    paired = {}
    if {TOUCH2TOUCH, RESNET18} <= tables.keys():
        paired = metrics.paired(tables[TOUCH2TOUCH], tables[RESNET18], full_scale, shapes)
    papers = SensorPair.of()  # the paper's rows are those of its protocol, sensors and direction
    sides = (info.source, sensor_info(papers.source)), (info.target, sensor_info(papers.target))
    is_papers = all(one.fits(other) and not one.differences(other) for one, other in sides)
    evaluation = Evaluation(
        split=split,
        pairs=len(pairs),
        contact_level=metrics.CONTACT_LEVEL,
        info_sha256=info.sha256,
        models=rows,
        shapes=number,
        paired=paired,
        paper=baselines.PAPER.get(split, {}) if is_papers and inputs.dataset.scale else {},
        recipe=info.recipe,
        source=info.source.name,
        target=info.target.name,
        **fields_of_target,
    )
    presses = {name: getattr(pairs, name) for name in ("x_mm", "y_mm", "yaw_rad", "force_n")}
    presses |= {"shape": shapes, "family": pairs.families}
    return evaluation, replace(predictions, presses=presses)


def _counts(inputs: EvaluationInputs, split: str, cache: Path, pairs: Pairs, train: Pairs) -> Found:
    """Of predicted counts."""
    array, source = inputs.info.array, inputs.info.source
    full_scale, bins = array.full_scale_counts, baselines.force_bins(pairs, train)
    layouts = [
        run.config.data.array for run in inputs.trained.values() if not run.config.has_uncertainty
    ]
    near, _ = baselines.neighbors(
        train.source, pairs.source, baselines.NEIGHBORS, progress=baselines.NEAREST_NEIGHBOR
    )
    of_force = bins[1] if bins[0]["low_n"].nunique() > 1 and np.isfinite(bins[1]).all() else None
    predictions = baselines.predict_baselines(pairs, train, near[:, 0], of_force, array, layouts)
    predicted, estimates, contacts = predict_runs(inputs, split, cache)
    predictions |= predicted
    view, groups = None, {}
    if source.value == IMAGE:
        view, groups = baselines.view_on(array.x_mm, array.y_mm, source.view_mm)
    tables, more = {}, {}
    stds = {name: each.counts_std for name, each in estimates.items()}
    for name, counts in predictions.items():
        values = metrics.compare(
            counts, pairs.counts, array.phi, full_scale, f"figures of {name}", groups,
            stds.get(name),
        )  # fmt: skip
        tables[name] = values
        more[name] = {"by_force": metrics.by_force(counts, values, pairs, bins, full_scale)}
        if name in estimates:
            more[name] |= {
                "uncertainty": metrics.uncertainty_metrics(
                    estimates[name], pairs.counts, pairs.force_n
                ),
                "shear": metrics.shear_metrics(estimates[name], pairs),
                "contact": contacts.get(name),
            }
    of_evaluation = {
        "full_scale_counts": full_scale,
        "layout": array.layout,
        "view": view,
        "background": inputs.background,
    }
    return tables, more, Predictions(pairs.counts, predictions, {}, stds), of_evaluation


def _images(inputs: EvaluationInputs, split: str, cache: Path, pairs: Pairs, train: Pairs) -> Found:
    """Of predicted images, compared as the runs' largest pictures, and in grey if one run is."""
    near, _ = baselines.neighbors(
        train.source, pairs.source, baselines.NEIGHBORS, progress=baselines.NEAREST_NEIGHBOR
    )
    presets = [run.config.preset for run in inputs.trained.values()]
    size, grey = max(each.size for each in presets), any(each.grey for each in presets)
    true, known = (
        load_pairs(inputs.data_dir, s, size, grey, cache, reverse=inputs.reverse).target
        for s in (split, "train")
    )
    assert isinstance(true, ImageFile) and isinstance(known, ImageFile)
    mean, truth = np.rint(known.mean()).astype(np.uint8), true[:]
    predictions = {
        baselines.MEAN_IMAGE: np.broadcast_to(mean, (len(near), *mean.shape)),
        baselines.NEAREST_NEIGHBOR: known[near[:, 0]],
    }
    for name, images in predict_runs(inputs, split, cache)[0].items():
        if images.shape[1:] != mean.shape:  # other sizes, and colors where one run is grey
            shown = (each if each.shape[-1] == COLORS else each[..., 0] for each in images)
            resized = [to_pixels(Image.fromarray(each), size, grey) for each in shown]
            images = np.stack(resized)
        predictions[name] = images
    native = frame_of_own_light(inputs.dataset, cast(CameraInfo, inputs.info.target))
    frame = None if native is None else to_pixels(Image.fromarray(native), size, grey)
    of_evaluation = {
        "background": None if frame is None else OF_OPTICS,
        "pictures": f"{size} x {size} pixels, {'grey' if grey else 'red, green and blue'}",
    }
    tables = {n: metrics.compare_images(each, truth, frame) for n, each in predictions.items()}
    return tables, {}, Predictions(truth, predictions, {}, {}), of_evaluation


def _run_fields(run: TrainedTranslator, info: DataInfo) -> dict[str, Any]:
    """The fields of a row on its run and training. info: of the dataset of the evaluation."""
    trained = run.config.data
    steps = run.config.epoch_steps
    try:
        trained_steps = None if steps is None else steps * len(read_log(run.run_dir))
    except T2TwinError:  # prediction does not need the log
        trained_steps = None
    return {
        "run": run.name,
        "weights_sha256": sha256_of(run.run_dir / BEST),
        "same_data": trained.sha256 == info.sha256,
        "trained_layout": trained.target.layout if trained.target.value == COUNTS else None,
        "trained_data": trained.sha256,
        "trained_recipe": trained.recipe,
        "trained_pairs": trained.train_pairs,
        "trained_steps": trained_steps,
    }
