"""The rows of an evaluation: figures of each model, overall, by shape, by family and by force.

Shape letters: P pairs, N taxels.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.sim.cyskin.phi import Phi
from t2twin.sim.dataset.store import sha256_of
from t2twin.translate.data.pairs import DataInfo, Pairs
from t2twin.translate.evaluation.findings import paired
from t2twin.translate.evaluation.metrics import bootstrap
from t2twin.translate.evaluation.metrics.array_errors import compare
from t2twin.translate.evaluation.metrics.floors import FieldOfView
from t2twin.translate.evaluation.metrics.forces import ForceBin, by_force
from t2twin.translate.evaluation.metrics.motion import by_motion, shear_metrics
from t2twin.translate.evaluation.metrics.reliability import uncertainty_metrics
from t2twin.translate.evaluation.prepare import EvaluationInputs
from t2twin.translate.evaluation.records import Bootstrap, Difference, ModelRow
from t2twin.translate.inference.predictor import CountsPredictor, TrainedTranslator
from t2twin.translate.runs.config import BEST
from t2twin.translate.runs.log import read_log
from t2twin.translate.uncertainty.estimate import Estimate

MAX_SHAPES = 200
"""Maximum number of shapes with figures of their own (assumed: more are not read)."""


def score(
    inputs: EvaluationInputs,
    predictions: Mapping[str, np.ndarray],
    estimates: Mapping[str, Estimate],
    pairs: Pairs,
    view: FieldOfView,
    bins: tuple[ForceBin, ...],
) -> tuple[dict[str, ModelRow], dict[str, Difference]]:
    """Each model's row, and touch2touch minus ResNet18 in the same resamples, by figure.

    predictions: (P, N) counts by the model's name. bins: the pairs by force.
    """
    info = inputs.info
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
            by_motion=by_motion(figures, pairs, full_scale, estimates.get(name)),
            shear=shear_metrics(estimates[name], pairs) if name in estimates else None,
        )
    differences = paired(rows, resampled)
    rows |= {name: _with_run(rows[name], run, info) for name, run in inputs.trained.items()}
    for name, estimate in estimates.items():
        metrics = uncertainty_metrics(estimate, pairs.counts, pairs.force_n)
        rows[name] = replace(rows[name], uncertainty=metrics)
    return rows, differences


def bootstrap_settings(pairs: Pairs) -> Bootstrap:
    """The settings of the intervals for these pairs."""
    return Bootstrap(
        over="shapes",
        shapes=int(np.unique(pairs.shapes).size),
        resamples=bootstrap.RESAMPLES,
        seed=bootstrap.SEED,
        confidence=bootstrap.CONFIDENCE,
    )


def _with_run(row: ModelRow, run: CountsPredictor, info: DataInfo) -> ModelRow:
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
        trained_layout=trained.layout,
        trained_data=trained.sha256,
        trained_world=info.world if same_data else trained.world,
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
