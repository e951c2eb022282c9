"""Evaluation of runs on several datasets, with one table of all results."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write
from t2twin.sim.dataset.info import SPLITS as ALL_SPLITS
from t2twin.translate.evaluation.evaluate import evaluate_split, evaluate_splits
from t2twin.translate.evaluation.metrics.baselines import MEAN_ARRAY, NEAREST_NEIGHBOR
from t2twin.translate.evaluation.metrics.forces import MEAN_ARRAY_OF_FORCE
from t2twin.translate.evaluation.prepare import prepare, splits_with_pairs
from t2twin.translate.evaluation.records import Evaluation, ModelRow
from t2twin.translate.evaluation.table import interval_text, markdown_table, training_data

TABLE = "worlds.md"
BOTH = "both"
"""Validation and test, as far as a dataset has them."""

TRIVIAL = (MEAN_ARRAY, MEAN_ARRAY_OF_FORCE, NEAREST_NEIGHBOR)

BothSplits = Mapping[str, Evaluation]


def evaluate_worlds(
    runs: Sequence[str | Path],
    data_dirs: Sequence[str | Path],
    split: str,
    out_dir: str | Path,
    background: str | Path | None = None,
) -> dict[str, dict[str, Evaluation]]:
    """Evaluates runs on datasets, each into out_dir/NAME, and writes worlds.md.

    split: "val", "test" or "both" (evaluate.evaluate_both); a dataset may lack one of both.
    background: as for `evaluate`.
    Returns the evaluations by folder name of the dataset and by split. Raises T2TwinError, before
    the first evaluation, for two datasets with equal folder names, and as `evaluate`.
    """
    folders, out_dir = arguments.paths(data_dirs, "data_dirs"), arguments.path(out_dir, "out_dir")
    arguments.choice(split, "split", (*ALL_SPLITS, BOTH))
    if not folders:
        raise T2TwinError("there is no dataset to evaluate on; give at least one")
    names = [data_dir.resolve().name for data_dir in folders]
    for name, data_dir in zip(names, folders, strict=True):
        if names.count(name) > 1:
            raise T2TwinError(
                f"{data_dir} is not the only dataset in a folder {name!r}; evaluations are written "
                "to folders of these names, which must differ"
            )
        prepare(runs, data_dir, _splits(data_dir, split), background)
    worlds: dict[str, dict[str, Evaluation]] = {}
    for name, data_dir in zip(names, folders, strict=True):
        splits = _splits(data_dir, split)
        inputs = prepare(runs, data_dir, splits, background)
        if split == BOTH:
            worlds[name] = evaluate_splits(inputs, splits, out_dir / name)
        else:
            worlds[name] = {split: evaluate_split(inputs, split, out_dir / name)}
    with atomic_write(out_dir / TABLE) as temporary:
        temporary.write_text(worlds_markdown(worlds))
    return worlds


def _splits(data_dir: Path, split: str) -> tuple[str, ...]:
    return splits_with_pairs(data_dir) if split == BOTH else (split,)


def worlds_markdown(worlds: Mapping[str, BothSplits]) -> str:
    """Two tables in Markdown, with one row per run and one column per dataset and split.

    worlds: evaluations of the same runs, by name of the dataset and by split.
    """
    return (
        "RMSE in percent of full scale, with its interval by bootstrap over shapes:\n\n"
        + _markdown(worlds, _percent)
        + "\nThe same relative to the mean array's RMSE (by force, if there are several "
        "forces):\n\n"
        + _markdown(worlds, _of_mean_array)
        + "\nMean arrays and nearest neighbors are from the training pairs of each dataset.\n"
    )


def _markdown(worlds: Mapping[str, BothSplits], cell: Callable[[Evaluation, ModelRow], str]) -> str:
    shown = {name: next(iter(splits.values())).world_shown for name, splits in worlds.items()}
    columns = {}
    for name, splits in worlds.items():
        # The name of the world, with the folder for several datasets of one world.
        unique = list(shown.values()).count(shown[name]) == 1
        title = shown[name] if unique else f"{shown[name]} ({name})"
        columns |= {f"{title}, {split}": evaluation for split, evaluation in splits.items()}
    evaluations = columns.values()
    known = {one.info_sha256: one.world for one in evaluations if one.world is not None}
    runs = next(iter(evaluations)).runs
    lines = [["", "trained on", "pairs", "steps", *columns]]
    for name in (*(name for name in TRIVIAL if any(name in e.models for e in evaluations)), *runs):
        cells = [cell(e, e.models[name]) if name in e.models else "-" for e in evaluations]
        what = training_data(runs[name], known) if name in runs else ("", "", "")
        lines.append([name, *what, *cells])
    return markdown_table(lines)


def _percent(evaluation: Evaluation, row: ModelRow) -> str:
    interval = interval_text(row.interval["rmse_percent"], "{:.2f}")
    return f"{row.overall.rmse_percent:.2f}" + (f" ({interval})" if interval else "")


def _of_mean_array(evaluation: Evaluation, row: ModelRow) -> str:
    models = evaluation.models
    level = models.get(MEAN_ARRAY_OF_FORCE, models[MEAN_ARRAY]).overall.rmse_counts
    return f"{row.overall.rmse_counts / level:.2f}" if level else "-"
