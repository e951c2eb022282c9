"""Each model's row of an evaluation: its figures, overall, by shape, by family and by force.

Shape letters: P pairs, N taxels.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from t2twin.primitives_cad.errors import T2TwinError
from t2twin.sim.dataset.store import sha256_of
from t2twin.translate.data.pairs import DataInfo, Pairs
from t2twin.translate.evaluation import bootstrap
from t2twin.translate.evaluation.field_of_view import FieldOfView
from t2twin.translate.evaluation.findings import paired
from t2twin.translate.evaluation.forces import ForceBin, by_force
from t2twin.translate.evaluation.metrics import compare
from t2twin.translate.evaluation.records import Difference, ModelRow
from t2twin.translate.phi import Phi
from t2twin.translate.predict import TrainedTranslator
from t2twin.translate.runs.config import BEST
from t2twin.translate.runs.log import read_log

MOST_SHAPES = 200
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
    few = np.unique(pairs.shapes).size <= MOST_SHAPES
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
