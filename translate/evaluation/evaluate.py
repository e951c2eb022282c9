"""Evaluation of trained runs: the paper's table, with baselines, error floors and intervals.

The steps are: prepare and predict (module predictions), score, write (records, table).

Shape letters: P pairs, N taxels.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write, locked
from t2twin.sim.dataset.info import SPLITS as ALL_SPLITS
from t2twin.sim.dataset.store import sha256_of
from t2twin.sim.sensors.defaults import ROLES, SOURCE, TARGET
from t2twin.translate.data.images import to_pixels
from t2twin.translate.data.pairs import DataInfo, Pairs, load_pairs, usable_cache
from t2twin.translate.data.sides import ArraySide, CameraSide
from t2twin.translate.evaluation import array_errors, image_errors
from t2twin.translate.evaluation.array_errors import (
    by_force,
    by_motion,
    shear_metrics,
    uncertainty_metrics,
)
from t2twin.translate.evaluation.baselines import (
    FEATURE_SIZE,
    NEAREST_NEIGHBOR,
    NEIGHBORS,
    PAPER,
    ForceBin,
    Neighbors,
    force_bins,
    neighbors,
    predict_baselines,
    view_on,
)
from t2twin.translate.evaluation.findings import findings, gap_between, paired
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
    Bootstrap,
    Difference,
    Evaluation,
    ModelRow,
    write_evaluation,
    write_findings,
)
from t2twin.translate.evaluation.table import datasets_markdown, results_markdown
from t2twin.translate.inference.predictor import TrainedTranslator
from t2twin.translate.runs.config import BEST
from t2twin.translate.runs.log import read_log
from t2twin.translate.uncertainty.estimate import Estimate

RESULTS, DATASETS_TABLE = "results.md", "datasets.md"
BOTH = "both"
"""Validation and test, as far as a dataset has them."""

MAX_SHAPES = 200
"""Maximum number of shapes with figures of their own (assumed: more are not read)."""


def evaluate(
    runs: Sequence[str | Path],
    data_dir: str | Path,
    split: str,
    out_dir: str | Path,
    background: str | Path | None = None,
) -> Evaluation:
    """Evaluates runs and baselines on one split; writes metrics.json and predictions.npz.

    runs: folders that `train` has made, all of one direction between the dataset's sensors. Images
    are compared as pictures (module image_errors). touch2touch and field runs from images to counts
    may have another taxel layout than the dataset, which is then read from their images or dense
    counts. split: "val" or "test" (or "train"). Returns the content of metrics.json (module
    records). The rows are, in order:

    - mean-array, or mean-image, and nearest-neighbour (module baselines), between them
      mean-array-of-force for presses of several forces (module baselines);
    - noise-floor, if the noise of the dataset is known, and layout-floor, for runs of another
      layout (module baselines);
    - the runs, by their models' names, with the folder's name for runs of the same model.

    predictions.npz contains the counts or images of each row (module predictions). background: an
    image of the dataset's sensor without contact, for field runs. The default is the frames of the
    pairs, or that of the default optics, if the dataset was made with either.
    Raises T2TwinError for no runs, a folder that is not a run, sensors other than the dataset's,
    and a layout that a run cannot be read at. It also does for a background frame without a field
    run, and for a split or training split without pairs.
    """
    data_dir, out_dir = arguments.path(data_dir, "data_dir"), arguments.path(out_dir, "out_dir")
    arguments.choice(split, "split", ALL_SPLITS)
    return evaluate_splits(runs, data_dir, split, out_dir, background)[split]


def evaluate_datasets(
    runs: Sequence[str | Path],
    data_dirs: Sequence[str | Path],
    split: str,
    out_dir: str | Path,
    background: str | Path | None = None,
) -> dict[str, dict[str, Evaluation]]:
    """Evaluates runs on datasets, each into out_dir/NAME, and writes datasets.md.

    split: as for `evaluate_splits`; a dataset may lack one of "both". background: as for
    `evaluate`.
    Returns the evaluations by folder name of the dataset and by split. Raises T2TwinError, before
    the first evaluation, for two datasets with equal folder names, and as `evaluate`.
    """
    folders, out_dir = arguments.paths(data_dirs, "data_dirs"), arguments.path(out_dir, "out_dir")
    arguments.choice(split, "split", (*ALL_SPLITS, BOTH))
    if not folders:
        raise T2TwinError("there is no dataset to evaluate on; give at least one")
    names = [folder.resolve().name for folder in folders]
    for name, folder in zip(names, folders, strict=True):
        if names.count(name) > 1:
            raise T2TwinError(
                f"{folder} is not the only dataset in a folder {name!r}; evaluations are written "
                "to folders of these names, which must differ"
            )
        prepare(runs, folder, _splits(folder, split), background)
    datasets = {
        name: evaluate_splits(runs, folder, split, out_dir / name, background)
        for name, folder in zip(names, folders, strict=True)
    }
    with atomic_write(out_dir / DATASETS_TABLE) as temporary:
        temporary.write_text(datasets_markdown(datasets), encoding="utf-8")
    return datasets


def _splits(data_dir: Path, split: str) -> tuple[str, ...]:
    return splits_with_pairs(data_dir) if split == BOTH else (split,)


def evaluate_splits(
    runs: Sequence[str | Path],
    data_dir: Path,
    split: str,
    out_dir: Path,
    background: str | Path | None = None,
) -> dict[str, Evaluation]:
    """`evaluate` on one split, or on "both", validation and test; returns evaluations by split.

    Of both, those without pairs are left out. They are written to out_dir/val and out_dir/test,
    with out_dir/findings.json and out_dir/results.md, a table in Markdown.
    Raises T2TwinError as `evaluate`, and if both are empty.
    """
    splits = _splits(data_dir, split)
    inputs = prepare(runs, data_dir, splits, background)
    if split != BOTH:
        return {split: _evaluate_split(inputs, split, out_dir)}
    evaluations = {split: _evaluate_split(inputs, split, out_dir / split) for split in splits}
    write_findings(out_dir, evaluations, gap_between(evaluations))
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
    data_dir, info, target = inputs.data_dir, inputs.info, inputs.info.target
    pairs, train = (
        load_pairs(data_dir, s, FEATURE_SIZE, False, cache, reverse=inputs.reverse)
        for s in (split, "train")
    )
    near = neighbors(train.source, pairs.source, NEIGHBORS, progress=NEAREST_NEIGHBOR)
    found = _counts if isinstance(target, ArraySide) else _images
    rows, differences, predictions, more = found(inputs, split, cache, pairs, train, near)
    evaluation = Evaluation(
        format=FORMAT,
        split=split,
        pairs=len(pairs),
        contact_level=array_errors.CONTACT_LEVEL,
        info_sha256=info.sha256,
        models=rows,
        bootstrap=Bootstrap(
            over="shapes",
            shapes=int(np.unique(pairs.shapes).size),
            resamples=array_errors.RESAMPLES,
            seed=array_errors.SEED,
            confidence=array_errors.CONFIDENCE,
        ),
        paired=differences,
        paper=PAPER.get(split, {}) if _is_papers(inputs) else {},
        findings=findings(rows, differences),
        recipe=info.recipe,
        source=info.source.sensor,
        target=target.sensor,
        **more,
    )
    presses = {name: getattr(pairs, name) for name in ("x_mm", "y_mm", "yaw_rad", "force_n")}
    presses |= {"shape": pairs.shapes, "family": pairs.families}
    return evaluation, replace(predictions, presses=presses)


Found = tuple[dict[str, ModelRow], dict[str, Difference], Predictions, dict[str, Any]]
"""Rows, differences, predictions without presses, and further fields of an Evaluation."""


def _counts(
    inputs: EvaluationInputs, split: str, cache: Path, pairs: Pairs, train: Pairs, near: Neighbors
) -> Found:
    """The rows of predicted counts."""
    array, source = inputs.info.array, inputs.info.source
    bins = force_bins(pairs, train)
    predictions = predict_baselines(inputs, pairs, train, near, bins)
    predicted, estimates, contacts = predict_runs(inputs, split, cache)
    predictions |= predicted
    view, groups = None, {}
    if isinstance(source, CameraSide):
        view, groups = view_on(array.x_mm, array.y_mm, source.view_mm)
    rows, differences = _score(inputs, predictions, estimates, pairs, groups, bins)
    rows |= {name: replace(rows[name], contact=found) for name, found in contacts.items()}
    stds = {name: each.counts_std for name, each in estimates.items()}
    background = None if inputs.background is None else inputs.background.source
    return (
        rows,
        differences,
        Predictions(pairs.counts, predictions, {}, stds),
        {
            "full_scale_counts": array.full_scale_counts,
            "layout": array.layout,
            "view": view,
            "background": background,
        },
    )


def _images(
    inputs: EvaluationInputs, split: str, cache: Path, _: Pairs, __: Pairs, near: Neighbors
) -> Found:
    """The rows of predicted images."""
    presets = [run.config.preset for run in inputs.trained.values()]
    size, grey = max(each.size for each in presets), any(each.grey for each in presets)
    pairs, train = (
        load_pairs(inputs.data_dir, s, size, grey, cache, reverse=inputs.reverse)
        for s in (split, "train")
    )
    true, scale = image_errors.images_of(pairs)[:], inputs.info.target.full_scale
    predictions = image_errors.baselines(train, near.index[:, 0])
    for name, images in predict_runs(inputs, split, cache)[0].items():
        predictions[name] = image_errors.resized_to(images, size, grey)
    native = frame_of_own_light(inputs.dataset, ROLES[0 if inputs.reverse else 1])
    frame = None if native is None else to_pixels(Image.fromarray(native), size, grey)
    few, rows = np.unique(pairs.shapes).size <= MAX_SHAPES, {}
    for name, predicted in predictions.items():
        figures = image_errors.compare_images(predicted, true, frame)
        resampled = array_errors.replicates(figures, pairs.shapes, scale)
        rows[name] = ModelRow(
            overall=figures.summary(scale),
            by_shape=figures.by_name(scale, pairs.shapes) if few else {},
            by_family=figures.by_name(scale, pairs.families),
            interval=array_errors.intervals(resampled),
        )
    rows |= {name: _with_run(rows[name], run, inputs.info) for name, run in inputs.trained.items()}
    return (
        rows,
        {},
        Predictions(true, predictions, {}),
        {
            "full_scale_counts": None,
            "layout": None,
            "view": None,
            "background": None if frame is None else OF_OPTICS,
            "pictures": image_errors.words(size, grey),
        },
    )


def _is_papers(inputs: EvaluationInputs) -> bool:
    """Whether it follows the paper's protocol with the paper's sensors and direction."""
    sensors = (inputs.info.source.sensor, inputs.info.target.sensor)
    return inputs.dataset.is_protocol and sensors == (SOURCE, TARGET)


def _score(
    inputs: EvaluationInputs,
    predictions: Mapping[str, np.ndarray],
    estimates: Mapping[str, Estimate],
    pairs: Pairs,
    groups: Mapping[str, np.ndarray],
    bins: tuple[ForceBin, ...],
) -> tuple[dict[str, ModelRow], dict[str, Difference]]:
    """Each model's row, and touch2touch minus ResNet18 in the same resamples, by figure.

    predictions: (P, N) counts by the model's name. groups: of taxels. bins: the pairs by force.
    """
    info, array = inputs.info, inputs.info.array
    full_scale, phi = array.full_scale_counts, array.phi
    few = np.unique(pairs.shapes).size <= MAX_SHAPES
    rows, resampled = {}, {}
    for name, predicted in predictions.items():
        progress = f"figures of {name}"
        figures = array_errors.compare(predicted, pairs.counts, phi, full_scale, progress, groups)
        resampled[name] = array_errors.replicates(figures, pairs.shapes, full_scale)
        rows[name] = ModelRow(
            overall=figures.summary(full_scale),
            by_shape=figures.by_name(full_scale, pairs.shapes) if few else {},
            by_family=figures.by_name(full_scale, pairs.families),
            interval=array_errors.intervals(resampled[name]),
            by_force=by_force(predicted, figures, pairs, bins, full_scale),
            by_motion=by_motion(figures, pairs, full_scale, estimates.get(name)),
            shear=shear_metrics(estimates[name], pairs) if name in estimates else None,
        )
    differences = paired(rows, resampled)
    rows |= {name: _with_run(rows[name], run, info) for name, run in inputs.trained.items()}
    for name, estimate in estimates.items():
        metrics = uncertainty_metrics(estimate, pairs.counts, pairs.force_n)
        rows[name] = replace(rows[name], uncertainty=metrics)
    return rows, differences


def _with_run(row: ModelRow, run: TrainedTranslator, info: DataInfo) -> ModelRow:
    """The row with its run and training data.

    info: of the dataset of the evaluation, which has what configurations of older runs lack.
    """
    trained = run.config.data
    same_data = trained.sha256 == info.sha256
    pairs = info.train_pairs if same_data else trained.train_pairs
    return replace(
        row,
        run=str(run.run_dir),
        weights_sha256=sha256_of(run.run_dir / BEST),
        same_data=same_data,
        trained_layout=trained.target.layout if isinstance(trained.target, ArraySide) else None,
        trained_data=trained.sha256,
        trained_recipe=info.recipe if same_data else trained.recipe,
        trained_pairs=pairs,
        trained_steps=training_steps(run, pairs),
    )


def training_steps(run: TrainedTranslator, pairs: int | None) -> int | None:
    """Number of training steps of a run; None if the log is missing or the number is unknown.

    pairs: number of training pairs; in runs of older versions an epoch is all of them.
    """
    config = run.config
    all_pairs = None if pairs is None else max(1, pairs // config.preset.batch)
    steps = config.epoch_steps or all_pairs
    try:
        return None if steps is None else steps * len(read_log(run.run_dir))
    except T2TwinError:  # prediction does not need the log
        return None
