"""The paper's table and what it lacks: every run, trivial predictors and floors on one split.

Shape letters: P pairs, N taxels.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write, locked
from t2twin.sim.dataset.info import SPLITS as ALL_SPLITS
from t2twin.sim.dataset.store import read_info
from t2twin.translate.data.pairs import (
    DataInfo,
    Pairs,
    Pictures,
    load_info,
    load_pairs,
    usable_cache,
)
from t2twin.translate.evaluation.background import Background, background_of
from t2twin.translate.evaluation.findings import findings, gap
from t2twin.translate.evaluation.metrics import bootstrap
from t2twin.translate.evaluation.metrics.array_errors import CONTACT_LEVEL
from t2twin.translate.evaluation.metrics.baselines import (
    FEATURE_SIZE,
    MEAN_ARRAY,
    NEAREST_NEIGHBOR,
    PAPER,
    Neighbors,
    mean_array,
    neighbors,
)
from t2twin.translate.evaluation.metrics.floors import (
    LAYOUT_FLOOR,
    NOISE_FLOOR,
    FieldOfView,
    second_reading,
    seen_through,
    view_on,
)
from t2twin.translate.evaluation.metrics.forces import (
    MEAN_ARRAY_OF_FORCE,
    ForceBin,
    force_bins,
    mean_array_of_force,
)
from t2twin.translate.evaluation.metrics.irreducible_error import (
    NEIGHBORS,
    lookalikes,
)
from t2twin.translate.evaluation.metrics.reliability import with_certainty
from t2twin.translate.evaluation.predictions import (
    Predictions,
    row_of_run,
    rows_of,
    write_predictions,
)
from t2twin.translate.evaluation.records import (
    FORMAT,
    Bootstrap,
    Evaluation,
    Finding,
    PaperRow,
    TaxelCounts,
    ViewSummary,
    write_evaluation,
    write_findings,
)
from t2twin.translate.evaluation.table import markdown
from t2twin.translate.inference.predictor import TrainedTranslator, load_run
from t2twin.translate.models.layouts import same_layout
from t2twin.translate.uncertainty.estimate import Estimate

TABLE = "results.md"
VAL, TEST = "val", "test"
SPLITS = (VAL, TEST)


def evaluate(
    runs: Sequence[str | Path],
    data_dir: str | Path,
    split: str,
    out_dir: str | Path,
    background: str | Path | None = None,
) -> Evaluation:
    """Compares runs and baselines on one split; writes metrics.json and predictions.npz.

    runs: folders that `train` has made. touch2touch runs may be of another taxel layout than the
    data set, which is then read from the images that they draw. split: "val" or "test" (or
    "train"). Returns what metrics.json holds (module records), whose rows are, in order:

    - mean-array and nearest-neighbour (module baselines), between them mean-array-of-force where
      the presses are of several forces (module forces);
    - noise-floor, where the data set names its imperfections (module noise_floor);
    - layout-floor, for runs of another layout (module layout_floor);
    - the runs, by their models' names, with the folder's where two are of one model.

    predictions.npz holds the counts that each row predicts of every pair (module predictions).
    background: an image of the dataset's DIGIT with nothing touching it, for field runs; unless
    given, the pairs' own frames or that of the default calibration, where the dataset names either.
    Raises T2TwinError for no runs, a folder that is no run, a layout that a run cannot give, a
    background frame that no run uses, and where that split or training has no pairs.
    """
    data_dir, out_dir = arguments.path(data_dir, "data_dir"), arguments.path(out_dir, "out_dir")
    arguments.choice(split, "split", ALL_SPLITS)
    info, loaded, frames = check_asked(runs, data_dir, (split,), background)
    with locked(out_dir):
        return _evaluate(loaded, info, data_dir, split, out_dir, frames)


def check_asked(
    runs: Sequence[str | Path],
    data_dir: Path,
    splits: Sequence[str],
    background: str | Path | None = None,
) -> tuple[DataInfo, list[TrainedTranslator], Background | None]:
    """Reads what `evaluate` needs of a dataset, of runs and of the background frame, which is None
    where no run uses one. Raises T2TwinError as `evaluate` does."""
    if not arguments.paths(runs, "runs"):
        raise T2TwinError("there is no run to evaluate; give at least one folder of `train`")
    _check_pairs(data_dir, (*splits, "train"))
    info = load_info(data_dir)
    loaded = [load_run(run) for run in runs]
    for run in loaded:
        _at(run, info)
    run_names(loaded)
    if any(run.translator.learns_field for run in loaded):
        file = None if background is None else arguments.path(background, "background")
        return info, loaded, background_of(data_dir, file)
    if background is not None:
        raise T2TwinError(
            f"{background} is a background frame, which field runs use alone; none of the runs "
            "is one"
        )
    return info, loaded, None


def _evaluate(
    loaded: list[TrainedTranslator],
    info: DataInfo,
    data_dir: Path,
    split: str,
    out_dir: Path,
    background: Background | None,
) -> Evaluation:
    trained = dict(zip(run_names(loaded), loaded, strict=True))
    applied = {name: _at(run, info) for name, run in trained.items()}
    cache = usable_cache(data_dir, out_dir)
    pairs, train = (load_pairs(data_dir, s, FEATURE_SIZE, False, cache) for s in (split, "train"))
    near = neighbors(train.images, pairs.images, NEIGHBORS, progress=NEAREST_NEIGHBOR)
    bins = force_bins(pairs, train)
    predictions = _without_runs(data_dir, pairs, train, near, bins)
    predictions |= _layout_floor(loaded, info, pairs)
    of_runs, estimates = _of_runs(applied, data_dir, split, cache, background)
    predictions |= of_runs
    view = view_on(info.x_mm, info.y_mm)
    models, differences = rows_of(predictions, pairs, info, view, bins)
    models |= {name: row_of_run(models[name], run, info) for name, run in trained.items()}
    models = with_certainty(models, estimates, pairs.counts, pairs.force_n)
    # Of the training split every pair is its own nearest.
    compared = split != "train"
    alike = lookalikes(data_dir, split, pairs, train, near, view.groups) if compared else None
    evaluation = Evaluation(
        format=FORMAT,
        split=split,
        pairs=len(pairs),
        full_scale_counts=info.full_scale_counts,
        contact_level=CONTACT_LEVEL,
        info_sha256=info.sha256,
        layout=info.layout,
        view=_view(view),
        models=models,
        bootstrap=_bootstrap(pairs),
        paired=differences,
        lookalikes=alike,
        paper=_paper(data_dir, split),
        findings=findings(models, differences),
        world=info.world,
        background=None if background is None else background.source,
    )
    write_predictions(out_dir, _predictions(predictions, estimates, pairs))
    write_evaluation(out_dir, evaluation)
    return evaluation


def _at(run: TrainedTranslator, info: DataInfo) -> TrainedTranslator:
    """A run at a dataset's layout."""
    return run.at_layout(info.x_mm, info.y_mm, info.layout, info.pad_diameter_mm)


def run_names(runs: Sequence[TrainedTranslator]) -> list[str]:
    """What runs are called: by model, and by folder too where two are of one model.

    Raises T2TwinError for a run that is named twice.
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


def evaluate_both(
    runs: list[Path], data_dir: Path, out_dir: Path, background: str | Path | None = None
) -> dict[str, Evaluation]:
    """`evaluate` of validation and test, into out_dir/val and out_dir/test.

    Beside them go findings.json and results.md, a table in Markdown. Where a dataset has only one
    of the two splits, the other is left out. background: as for `evaluate`.

    Returns them by split. Raises T2TwinError as `evaluate` does, and where both are empty.
    """
    splits = splits_there(data_dir)
    evaluations = {
        split: evaluate(runs, data_dir, split, out_dir / split, background) for split in splits
    }
    write_findings(out_dir, evaluations, gap_between(evaluations, data_dir))
    with atomic_write(out_dir / TABLE) as temporary:
        temporary.write_text(markdown(evaluations))
    return evaluations


def splits_there(data_dir: Path) -> tuple[str, ...]:
    """Those of validation and test that have pairs.

    Raises T2TwinError where neither has, and where there is no dataset.
    """
    pairs = read_info(data_dir).pairs
    splits = tuple(split for split in SPLITS if pairs[split])
    if not splits:
        raise T2TwinError(
            f"{data_dir} has neither validation nor test pairs; runs are evaluated on one or both"
        )
    return splits


def gap_between(evaluations: Mapping[str, Evaluation], data_dir: Path) -> dict[str, Finding]:
    """How much worse each run is on the tools than on validation (findings.gap).

    evaluations: by split. Empty without both splits, and where they are not the paper's.
    """
    if set(evaluations) != set(SPLITS) or not read_info(data_dir).is_protocol:
        return {}
    return gap(evaluations[VAL].models, evaluations[TEST].models)


def _check_pairs(data_dir: Path, splits: Sequence[str]) -> None:
    pairs = read_info(data_dir).pairs
    for split in splits:
        if split in pairs and not pairs[split]:
            raise T2TwinError(
                f"{data_dir} has no {split} pairs; an evaluation needs some, and train pairs for "
                "the rows beside the runs"
            )


def _paper(data_dir: Path, split: str) -> dict[str, PaperRow]:
    """The paper's figures stand beside its own protocol alone."""
    return PAPER.get(split, {}) if read_info(data_dir).is_protocol else {}


def _without_runs(
    data_dir: Path, pairs: Pairs, train: Pairs, near: Neighbors, bins: tuple[ForceBin, ...]
) -> dict[str, np.ndarray]:
    """(P, N) counts of the trivial predictors, and of the noise floor where it is known."""
    rows = {MEAN_ARRAY: np.tile(mean_array(train), (len(pairs), 1))}
    if len(bins) > 1:
        rows[MEAN_ARRAY_OF_FORCE] = mean_array_of_force(bins, pairs, train)
    rows[NEAREST_NEIGHBOR] = train.counts[near.index[:, 0]]
    again = second_reading(pairs.counts, read_info(data_dir))
    return rows if again is None else rows | {NOISE_FLOOR: again}


def _layout_floor(
    trained: list[TrainedTranslator], info: DataInfo, pairs: Pairs
) -> dict[str, np.ndarray]:
    """(P, N) counts, of the first run that was trained on another layout's counts, if any was."""
    for run in trained:
        own = same_layout(run.config.data, info.x_mm, info.y_mm)
        if not own and not run.translator.learns_field:
            kept = seen_through(run.config.data, info.x_mm, info.y_mm)
            return {LAYOUT_FLOOR: (pairs.counts @ kept.T).astype(np.float32)}
    return {}


def _of_runs(
    runs: Mapping[str, TrainedTranslator],
    data_dir: Path,
    split: str,
    cache: Path,
    background: Background | None,
) -> tuple[dict[str, np.ndarray], dict[str, Estimate]]:
    """(P, N) counts that each run predicts, and the estimates of field runs."""
    has_field = load_info(data_dir).field_x_mm is not None
    predictions, estimates = {}, {}
    for name, run in runs.items():
        preset, tells = run.config.preset, run.translator.learns_field
        # Pairs with a field mostly hold their DIGITs' background frames too.
        own = load_pairs(data_dir, split, preset.size, preset.grey, cache, tells and has_field)
        if tells:
            fixed = None if background is None else background.at_size(preset.size)
            pictures = own.pictures if fixed is None else Pictures(own.images, fixed)
            estimates[name] = run.estimate_pixels(pictures, progress=name)
            predictions[name] = estimates[name].counts
        else:
            predictions[name] = run.predict_pixels(own.images, progress=name)
    return predictions, estimates


def _view(view: FieldOfView) -> ViewSummary:
    return ViewSummary(
        width_mm=2 * view.half_width_mm,
        height_mm=2 * view.half_height_mm,
        pitch_mm=view.pitch_mm,
        taxels=TaxelCounts(**{name: int(mask.sum()) for name, mask in view.groups.items()}),
    )


def _bootstrap(pairs: Pairs) -> Bootstrap:
    return Bootstrap(
        over="shapes",
        shapes=int(np.unique(pairs.shapes).size),
        resamples=bootstrap.RESAMPLES,
        seed=bootstrap.SEED,
        confidence=bootstrap.CONFIDENCE,
    )


def _predictions(
    predictions: dict[str, np.ndarray], estimates: Mapping[str, Estimate], pairs: Pairs
) -> Predictions:
    return Predictions(
        truth=pairs.counts,
        by_model=predictions,
        shapes=pairs.shapes,
        families=pairs.families,
        x_mm=pairs.x_mm,
        y_mm=pairs.y_mm,
        yaw_rad=pairs.yaw_rad,
        force_n=pairs.force_n,
        std_by_model={name: each.counts_std for name, each in estimates.items()},
    )
