"""Evaluation of trained runs: the paper's table, with baselines, error floors and intervals.

The steps are: prepare (module prepare), predict (predictions), score (scoring), write (files).
"""

from collections.abc import Sequence
from pathlib import Path

from t2twin.core import arguments
from t2twin.core.files import atomic_write, locked
from t2twin.sim.dataset.info import SPLITS as ALL_SPLITS
from t2twin.translate.data.pairs import load_pairs, usable_cache
from t2twin.translate.evaluation.files import TABLE, write_evaluation, write_findings
from t2twin.translate.evaluation.findings import findings, gap_between
from t2twin.translate.evaluation.metrics.array_errors import CONTACT_LEVEL
from t2twin.translate.evaluation.metrics.baselines import (
    FEATURE_SIZE,
    NEAREST_NEIGHBOR,
    PAPER,
    neighbors,
)
from t2twin.translate.evaluation.metrics.floors import view_on
from t2twin.translate.evaluation.metrics.forces import force_bins
from t2twin.translate.evaluation.metrics.irreducible_error import (
    NEIGHBORS,
    estimate_irreducible_error,
)
from t2twin.translate.evaluation.predictions import (
    Predictions,
    predict_baselines,
    predict_runs,
    write_predictions,
)
from t2twin.translate.evaluation.prepare import EvaluationInputs, prepare, splits_with_pairs
from t2twin.translate.evaluation.records import FORMAT, Evaluation, TaxelCounts, ViewSummary
from t2twin.translate.evaluation.scoring import bootstrap_settings, score
from t2twin.translate.evaluation.table import markdown


def evaluate(
    runs: Sequence[str | Path],
    data_dir: str | Path,
    split: str,
    out_dir: str | Path,
    background: str | Path | None = None,
) -> Evaluation:
    """Evaluates runs and baselines on one split; writes metrics.json and predictions.npz.

    runs: folders that `train` has made. touch2touch and field runs may have another taxel layout
    than the dataset, which is then read from their images or fields. split: "val" or "test" (or
    "train"). Returns the content of metrics.json (module records). The rows are, in order:

    - mean-array and nearest-neighbour (module baselines), between them mean-array-of-force for
      presses of several forces (module forces);
    - noise-floor, if the noise of the dataset is known, and layout-floor, for runs of another
      layout (module floors);
    - the runs, by their models' names, with the folder's name for runs of the same model.

    predictions.npz contains the counts of each row (module predictions). background: an image of
    the dataset's DIGIT without contact, for field runs. The default is the frames of the pairs, or
    that of the default calibration, if the dataset was made with either.
    Raises T2TwinError for no runs, a folder that is not a run, and a layout that a run cannot be
    read at. It also does for a background frame without a field run, and for a split or training
    split without pairs.
    """
    data_dir, out_dir = arguments.path(data_dir, "data_dir"), arguments.path(out_dir, "out_dir")
    arguments.choice(split, "split", ALL_SPLITS)
    return evaluate_split(prepare(runs, data_dir, (split,), background), split, out_dir)


def evaluate_both(
    runs: Sequence[str | Path],
    data_dir: Path,
    out_dir: Path,
    background: str | Path | None = None,
) -> dict[str, Evaluation]:
    """`evaluate` on validation and test, into out_dir/val and out_dir/test.

    Also writes out_dir/findings.json and out_dir/results.md, a table in Markdown. A split without
    pairs is left out. background: as for `evaluate`.

    Returns the evaluations by split. Raises T2TwinError as `evaluate`, and if both are empty.
    """
    splits = splits_with_pairs(data_dir)
    return evaluate_splits(prepare(runs, data_dir, splits, background), splits, out_dir)


def evaluate_splits(
    inputs: EvaluationInputs, splits: Sequence[str], out_dir: Path
) -> dict[str, Evaluation]:
    """As `evaluate_both`, with inputs that are prepared."""
    evaluations = {split: evaluate_split(inputs, split, out_dir / split) for split in splits}
    write_findings(out_dir, evaluations, gap_between(evaluations, inputs.dataset))
    with atomic_write(out_dir / TABLE) as temporary:
        temporary.write_text(markdown(evaluations))
    return evaluations


def evaluate_split(inputs: EvaluationInputs, split: str, out_dir: Path) -> Evaluation:
    """As `evaluate`, with inputs that are prepared."""
    with locked(out_dir):
        evaluation, predictions = _evaluate(inputs, split, usable_cache(inputs.data_dir, out_dir))
        write_predictions(out_dir, predictions)
        write_evaluation(out_dir, evaluation)
    return evaluation


def _evaluate(inputs: EvaluationInputs, split: str, cache: Path) -> tuple[Evaluation, Predictions]:
    data_dir, info = inputs.data_dir, inputs.info
    pairs, train = (load_pairs(data_dir, s, FEATURE_SIZE, False, cache) for s in (split, "train"))
    near = neighbors(train.images, pairs.images, NEIGHBORS, progress=NEAREST_NEIGHBOR)
    bins = force_bins(pairs, train)
    predictions = predict_baselines(inputs, pairs, train, near, bins)
    predicted, estimates = predict_runs(inputs, split, cache)
    predictions |= predicted
    view = view_on(info.x_mm, info.y_mm)
    rows, differences = score(inputs, predictions, estimates, pairs, view, bins)
    # In the training split, each pair is its own nearest neighbor.
    irreducible = None
    if split != "train":
        irreducible = estimate_irreducible_error(data_dir, split, pairs, train, near, view.groups)
    evaluation = Evaluation(
        format=FORMAT,
        split=split,
        pairs=len(pairs),
        full_scale_counts=info.full_scale_counts,
        contact_level=CONTACT_LEVEL,
        info_sha256=info.sha256,
        layout=info.layout,
        view=ViewSummary(
            width_mm=2 * view.half_width_mm,
            height_mm=2 * view.half_height_mm,
            pitch_mm=view.pitch_mm,
            taxels=TaxelCounts(**{name: int(mask.sum()) for name, mask in view.groups.items()}),
        ),
        models=rows,
        bootstrap=bootstrap_settings(pairs),
        paired=differences,
        irreducible_error=irreducible,
        paper=PAPER.get(split, {}) if inputs.dataset.is_protocol else {},
        findings=findings(rows, differences),
        world=info.world,
        background=None if inputs.background is None else inputs.background.source,
    )
    return evaluation, Predictions(
        truth=pairs.counts,
        by_model=predictions,
        presses={"shape": pairs.shapes, "family": pairs.families}
        | {name: getattr(pairs, name) for name in ("x_mm", "y_mm", "yaw_rad", "force_n")},
        std_by_model={name: each.counts_std for name, each in estimates.items()},
    )
