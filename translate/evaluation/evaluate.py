"""Evaluation of trained runs: the paper's table, with baselines, error floors and intervals.

The steps are: prepare and predict (module predictions), score (metrics), write (records, table).

Shape letters: P pairs, N taxels.
"""

from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from PIL import Image

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write, locked
from t2twin.sim.dataset.info import SPLITS as ALL_SPLITS
from t2twin.sim.dataset.store import sha256_of
from t2twin.sim.sensors.defaults import SOURCE, TARGET
from t2twin.translate.data.images import COLORS, to_pixels
from t2twin.translate.data.pairs import DataInfo, ImageFile, Pairs, load_pairs, usable_cache
from t2twin.translate.data.sides import ArraySide, CameraSide
from t2twin.translate.evaluation import metrics
from t2twin.translate.evaluation.baselines import (
    FEATURE_SIZE,
    MEAN_IMAGE,
    NEAREST_NEIGHBOR,
    NEIGHBORS,
    PAPER,
    force_bins,
    neighbors,
    predict_baselines,
    view_on,
)
from t2twin.translate.evaluation.predictions import (
    OF_OPTICS,
    EvaluationInputs,
    Predictions,
    frame_of_own_light,
    predict_runs,
    prepare,
    splits_with_pairs,
    write_predictions,
)
from t2twin.translate.evaluation.records import (
    FORMAT,
    Evaluation,
    Figures,
    ModelRow,
    Values,
    write_evaluation,
)
from t2twin.translate.evaluation.table import results_markdown
from t2twin.translate.inference.predictor import TrainedTranslator
from t2twin.translate.runs.config import BEST
from t2twin.translate.runs.log import read_log

RESULTS, BOTH = "results.md", "both"
"""Table of validation and test, and the name of both, as far as a dataset has them."""

MAX_SHAPES = 200
"""Maximum number of shapes with figures of their own (assumed: more are not read)."""

TOUCH2TOUCH, RESNET18 = "touch2touch", "resnet18"
"""Runs whose difference has an interval: the paper compares these models."""

Found = tuple[dict[str, ModelRow], dict[str, pd.DataFrame], Predictions, dict[str, Any]]
"""Rows, their resampled figures, predictions without presses, further fields of an Evaluation."""


def evaluate(
    runs: Sequence[str | Path],
    data_dir: str | Path,
    split: str,
    out_dir: str | Path,
    background: str | Path | None = None,
) -> Evaluation:
    """Evaluates runs and baselines on one split; writes metrics.json and predictions.npz.

    runs: folders that `train` has made, all of one direction between the dataset's sensors.
    touch2touch and field runs from images to counts may have another taxel layout than the dataset,
    which is then read from their images or dense counts. split: "val" or "test" (or "train").
    Returns the content of metrics.json (module records). The rows are the baselines and floors
    (module baselines), then the runs, by their models' names, with the folder's name for runs of
    the same model. predictions.npz contains the counts or images of each row.
    background: an image of the dataset's sensor without contact, for field runs. The default is the
    frames of the pairs, or that of the default optics, if the dataset was made with either.
    Raises T2TwinError for no runs, a folder that is not a run, sensors other than the dataset's,
    and a layout that a run cannot be read at. It also does for a background frame without a field
    run, and for a split or training split without pairs.
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
    """`evaluate` on one split, or on "both", validation and test; returns evaluations by split.

    Of both, those without pairs are left out. They are written to out_dir/val and out_dir/test,
    with out_dir/results.md, a table in Markdown.
    Raises T2TwinError as `evaluate`, and if both are empty.
    """
    is_both = split == BOTH
    splits = splits_with_pairs(data_dir) if is_both else (split,)
    inputs = prepare(runs, data_dir, splits, background)
    evaluations = {
        each: _evaluate_split(inputs, each, out_dir / each if is_both else out_dir)
        for each in splits
    }
    if is_both:
        with atomic_write(out_dir / RESULTS) as temporary:
            temporary.write_text(results_markdown(evaluations), encoding="utf-8")
    return evaluations


def _evaluate_split(inputs: EvaluationInputs, split: str, out_dir: Path) -> Evaluation:
    with locked(out_dir):
        evaluation, predictions = _evaluate(inputs, split, usable_cache(inputs.data_dir, out_dir))
        write_predictions(out_dir, predictions)
        write_evaluation(out_dir, evaluation)
    return evaluation


def _evaluate(inputs: EvaluationInputs, split: str, cache: Path) -> tuple[Evaluation, Predictions]:
    info, reverse = inputs.info, inputs.reverse
    pairs, train = (
        load_pairs(inputs.data_dir, s, FEATURE_SIZE, False, cache, reverse=reverse)
        for s in (split, "train")
    )
    find = _counts if isinstance(info.target, ArraySide) else _images
    rows, resampled, predictions, more = find(inputs, split, cache, pairs, train)
    differences = _paired(rows, resampled)
    rows |= {name: _with_run(rows[name], run, info) for name, run in inputs.trained.items()}
    # The paper's rows are those of its protocol, sensors and direction.
    sensors = (info.source.sensor, info.target.sensor)
    is_papers = inputs.dataset.is_protocol and sensors == (SOURCE, TARGET)
    evaluation = Evaluation(
        format=FORMAT,
        split=split,
        pairs=len(pairs),
        contact_level=metrics.CONTACT_LEVEL,
        info_sha256=info.sha256,
        models=rows,
        bootstrap={
            "over": "shapes",
            "shapes": int(np.unique(pairs.shapes).size),
            "resamples": metrics.RESAMPLES,
            "seed": metrics.SEED,
            "confidence": metrics.CONFIDENCE,
        },
        paired=differences,
        paper=PAPER.get(split, {}) if is_papers else {},
        recipe=info.recipe,
        source=info.source.sensor,
        target=info.target.sensor,
        **more,
    )
    presses = {name: getattr(pairs, name) for name in ("x_mm", "y_mm", "yaw_rad", "force_n")}
    presses |= {"shape": pairs.shapes, "family": pairs.families}
    return evaluation, replace(predictions, presses=presses)


def _counts(inputs: EvaluationInputs, split: str, cache: Path, pairs: Pairs, train: Pairs) -> Found:
    """The rows of predicted counts."""
    array, source = inputs.info.array, inputs.info.source
    full_scale, bins = array.full_scale_counts, force_bins(pairs, train)
    layouts = [run.config.data.array for run in inputs.trained.values() if not run.has_uncertainty]
    near = neighbors(train.source, pairs.source, NEIGHBORS, progress=NEAREST_NEIGHBOR)
    predictions = predict_baselines(
        pairs, train, near, bins, inputs.dataset, inputs.target_role, layouts
    )
    predicted, estimates, contacts = predict_runs(inputs, split, cache)
    predictions |= predicted
    view, groups = None, {}
    if isinstance(source, CameraSide):
        view, groups = view_on(array.x_mm, array.y_mm, source.view_mm)
    rows, resampled = {}, {}
    for name, counts in predictions.items():
        title = f"figures of {name}"
        values = metrics.compare(counts, pairs.counts, array.phi, full_scale, title, groups)
        row, resampled[name] = _row(values, pairs, full_scale)
        row = replace(
            row,
            by_force=metrics.by_force(counts, values, pairs, bins, full_scale),
            by_motion=metrics.by_motion(values, pairs, full_scale, estimates.get(name)),
        )
        if (estimate := estimates.get(name)) is not None:
            row = replace(
                row,
                uncertainty=metrics.uncertainty_metrics(estimate, pairs.counts, pairs.force_n),
                shear=metrics.shear_metrics(estimate, pairs),
                contact=contacts.get(name),
            )
        rows[name] = row
    stds = {name: each.counts_std for name, each in estimates.items()}
    more = {
        "full_scale_counts": full_scale,
        "layout": array.layout,
        "view": view,
        "background": inputs.background,
    }
    return rows, resampled, Predictions(pairs.counts, predictions, {}, stds), more


def _images(inputs: EvaluationInputs, split: str, cache: Path, pairs: Pairs, train: Pairs) -> Found:
    """The rows of predicted images, compared as the largest pictures of the runs, and in grey if
    one run is."""
    near = neighbors(train.source, pairs.source, NEIGHBORS, progress=NEAREST_NEIGHBOR).index[:, 0]
    presets = [run.config.preset for run in inputs.trained.values()]
    size, grey = max(each.size for each in presets), any(each.grey for each in presets)
    true, known = (
        load_pairs(inputs.data_dir, s, size, grey, cache, reverse=inputs.reverse).target
        for s in (split, "train")
    )
    assert isinstance(true, ImageFile) and isinstance(known, ImageFile)
    mean, scale = np.rint(known.mean()).astype(np.uint8), inputs.info.target.full_scale
    predictions = {
        MEAN_IMAGE: np.broadcast_to(mean, (len(near), *mean.shape)),
        NEAREST_NEIGHBOR: known[near],
    }
    for name, images in predict_runs(inputs, split, cache)[0].items():
        predictions[name] = _resized(images, size, grey)
    native = frame_of_own_light(inputs.dataset, inputs.target_role)
    frame = None if native is None else to_pixels(Image.fromarray(native), size, grey)
    rows, resampled = {}, {}
    for name, images in predictions.items():
        values = metrics.compare_images(images, true[:], frame)
        rows[name], resampled[name] = _row(values, pairs, scale)
    more = {
        "full_scale_counts": None,
        "layout": None,
        "view": None,
        "background": None if frame is None else OF_OPTICS,
        "pictures": f"{size} x {size} pixels, {'grey' if grey else 'red, green and blue'}",
    }
    return rows, resampled, Predictions(true[:], predictions, {}), more


def _resized(images: np.ndarray, size: int, grey: bool) -> np.ndarray:
    """Predicted pictures, (P, S, S, c) uint8, at another size and in grey, if they differ."""
    if images.shape[1] == size and images.shape[-1] == (1 if grey else COLORS):
        return images
    shown = (each if each.shape[-1] == COLORS else each[..., 0] for each in images)
    return np.stack([to_pixels(Image.fromarray(each), size, grey) for each in shown])


def _row(values: pd.DataFrame, pairs: Pairs, full_scale: float) -> tuple[ModelRow, pd.DataFrame]:
    """The row of a model, and its figures in each resample of the shapes."""
    few = np.unique(pairs.shapes).size <= MAX_SHAPES
    resampled = metrics.figures_of(metrics.resampled_means(values, pairs.shapes), full_scale)
    row = ModelRow(
        overall=metrics.overall(values, full_scale),
        by_shape=metrics.by_name(values, full_scale, pairs.shapes) if few else {},
        by_family=metrics.by_name(values, full_scale, pairs.families),
        interval=metrics.intervals(resampled),
    )
    return row, resampled


def _paired(rows: dict[str, ModelRow], resampled: dict[str, pd.DataFrame]) -> dict[str, Values]:
    """touch2touch minus ResNet18 in the figures that both have, with intervals from the same
    resamples; empty without both."""
    if not {TOUCH2TOUCH, RESNET18} <= rows.keys():
        return {}
    differences = {}
    for figure in (each.name for each in fields(Figures) if each.name in resampled[RESNET18]):
        one, two = (getattr(rows[name].overall, figure) for name in (TOUCH2TOUCH, RESNET18))
        if one is not None and two is not None:
            samples = resampled[TOUCH2TOUCH][figure] - resampled[RESNET18][figure]
            low, high = metrics.interval(samples.to_numpy()) or (None, None)
            differences[figure] = {"difference": one - two, "low": low, "high": high}
    return differences


def _with_run(row: ModelRow, run: TrainedTranslator, info: DataInfo) -> ModelRow:
    """The row with its run and training data. info: of the dataset of the evaluation."""
    trained = run.config.data
    steps = run.config.epoch_steps
    try:
        trained_steps = None if steps is None else steps * len(read_log(run.run_dir))
    except T2TwinError:  # prediction does not need the log
        trained_steps = None
    return replace(
        row,
        run=str(run.run_dir),
        weights_sha256=sha256_of(run.run_dir / BEST),
        same_data=trained.sha256 == info.sha256,
        trained_layout=trained.target.layout if isinstance(trained.target, ArraySide) else None,
        trained_data=trained.sha256,
        trained_recipe=trained.recipe,
        trained_pairs=trained.train_pairs,
        trained_steps=trained_steps,
    )
