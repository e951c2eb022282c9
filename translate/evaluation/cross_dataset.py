"""Runs by world: each run evaluated on several datasets, and one table of them all."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write
from t2twin.sim.dataset.info import SPLITS as ALL_SPLITS
from t2twin.translate.evaluation.evaluate import check_asked, evaluate, evaluate_both, splits_there
from t2twin.translate.evaluation.metrics.baselines import MEAN_ARRAY, NEAREST_NEIGHBOR
from t2twin.translate.evaluation.metrics.forces import MEAN_ARRAY_OF_FORCE
from t2twin.translate.evaluation.records import Evaluation, ModelRow
from t2twin.translate.evaluation.table import spanned, trained_on

TABLE = "worlds.md"
BOTH = "both"
"""Validation and test, where a dataset has them."""

TRIVIAL = (MEAN_ARRAY, MEAN_ARRAY_OF_FORCE, NEAREST_NEIGHBOR)

BothSplits = Mapping[str, Evaluation]


def evaluate_worlds(
    runs: Sequence[str | Path],
    data_dirs: Sequence[str | Path],
    split: str,
    out_dir: str | Path,
    background: str | Path | None = None,
) -> dict[str, dict[str, Evaluation]]:
    """Evaluates every run on every dataset, into out_dir/NAME of each, and writes worlds.md.

    split: "val", "test" or "both" (evaluate.evaluate_both), of which a dataset may lack one.
    background: as for `evaluate`.
    Returns the evaluations by the datasets' folder names and by split. Raises T2TwinError, before
    anything is evaluated, for two datasets in folders of one name, and as `evaluate` does.
    """
    folders, out_dir = arguments.paths(data_dirs, "data_dirs"), arguments.path(out_dir, "out_dir")
    arguments.choice(split, "split", (*ALL_SPLITS, BOTH))
    if not folders:
        raise T2TwinError("there is no dataset to evaluate on; give at least one")
    names = [data_dir.resolve().name for data_dir in folders]
    for name, data_dir in zip(names, folders, strict=True):
        if names.count(name) > 1:
            raise T2TwinError(
                f"{data_dir} is not the only dataset in a folder {name!r}; evaluations go into "
                "folders of these names, so each must have its own"
            )
        splits = splits_there(data_dir) if split == BOTH else (split,)
        check_asked(runs, data_dir, splits, background)
    worlds: dict[str, dict[str, Evaluation]] = {}
    for name, data_dir in zip(names, folders, strict=True):
        folder = out_dir / name
        if split == BOTH:
            worlds[name] = evaluate_both([Path(run) for run in runs], data_dir, folder, background)
        else:
            worlds[name] = {split: evaluate(runs, data_dir, split, folder, background)}
    with atomic_write(out_dir / TABLE) as temporary:
        temporary.write_text(worlds_markdown(worlds))
    return worlds


def worlds_markdown(worlds: Mapping[str, BothSplits]) -> str:
    """Two tables in Markdown: a row a run, a column a dataset and split.

    worlds: evaluations of the same runs, by what the dataset is called, and by split.
    """
    return (
        "RMSE in percent of full scale, with its interval by bootstrap over shapes:\n\n"
        + _markdown(worlds, _percent)
        + "\nThe same in parts of the mean array's, which knows the force where there are "
        "several:\n\n"
        + _markdown(worlds, _of_mean_array)
        + "\nThe mean arrays and the nearest neighbor are of each dataset's own training pairs.\n"
    )


def _markdown(worlds: Mapping[str, BothSplits], cell: Callable[[Evaluation, str], str]) -> str:
    columns = [
        (f"{_title(name, worlds)}, {split}", evaluation)
        for name, splits in worlds.items()
        for split, evaluation in splits.items()
    ]
    known = {one.info_sha256: one.world for _, one in columns if one.world is not None}
    first = columns[0][1]
    heads = ["", "trained on", "pairs", "steps", *(title for title, _ in columns)]
    lines = [heads, ["---"] * len(heads)]
    names = [*(name for name in TRIVIAL if any(name in one.models for _, one in columns))]
    for name in (*names, *first.runs):
        what = trained_on(first.runs[name], known) if name in first.runs else ("", "", "")
        lines.append([name, *what, *(cell(one, name) for _, one in columns)])
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _title(name: str, worlds: Mapping[str, BothSplits]) -> str:
    """The world's name; the folder's too where several datasets are of one world."""
    shown = {each: next(iter(splits.values())).world_shown for each, splits in worlds.items()}
    alone = list(shown.values()).count(shown[name]) == 1
    return shown[name] if alone else f"{shown[name]} ({name})"


def _percent(evaluation: Evaluation, name: str) -> str:
    row = evaluation.models.get(name)
    if row is None:
        return "-"
    span = spanned(row.interval.rmse_percent, "{:.2f}")
    return f"{row.overall.rmse_percent:.2f}" + (f" ({span})" if span else "")


def _of_mean_array(evaluation: Evaluation, name: str) -> str:
    row, level = evaluation.models.get(name), _level(evaluation.models)
    return "-" if row is None or not level else f"{row.overall.rmse_counts / level:.2f}"


def _level(models: Mapping[str, ModelRow]) -> float:
    best = models.get(MEAN_ARRAY_OF_FORCE, models[MEAN_ARRAY])
    return best.overall.rmse_counts
