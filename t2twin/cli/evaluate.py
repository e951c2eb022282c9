"""t2twin evaluate"""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

if TYPE_CHECKING:
    from t2twin.translate.evaluation.records import Evaluation

Split = Literal["val", "test", "both"]


def evaluate(
    runs: tyro.conf.Positional[
        Annotated[
            tuple[Path, ...], tyro.conf.arg(metavar="RUN", help_behavior_hint="(one or more)")
        ]
    ],
    data: Annotated[
        tuple[Path, ...], tyro.conf.arg(metavar="DIR", help_behavior_hint="(one or more)")
    ],
    split: Split = "val",
    out: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None,
    background: Annotated[Path | None, tyro.conf.arg(metavar="IMAGE")] = None,
) -> None:
    """Evaluate trained translators, with baselines and error floors; writes metrics.json.

    Args:
        runs: Folders of trained runs.
        data: Folder of the dataset, of training or any other. touch2touch also accepts another
            taxel layout inside its own, field any on the cover. With several datasets, each has a
            folder of its name, and worlds.md is a table of all.
        split: val (in the paper's protocol: new versions of primitives), test (hand tools) or both.
            With both, writes DIR/val, DIR/test, DIR/findings.json and DIR/results.md.
        out: Output folder. Default: runs/evaluate/SPLIT; runs/evaluate with both or several
            datasets.
        background: Image of the datasets' DIGIT without contact, for field runs. Default: each
            pair's own, or that of the default calibration, if the dataset was made with either.
    """
    from t2twin.core.errors import T2TwinError
    from t2twin.translate.models.distributed import use_all_cores

    if not runs:
        raise T2TwinError(
            "there is no run to evaluate; give one run's folder or more before --data"
        )
    if not data:
        raise T2TwinError("there is no dataset to evaluate on; give its folder with --data")
    folder = out or Path("runs/evaluate") / ("" if split == "both" or len(data) > 1 else split)
    use_all_cores()
    first, *others = list(data)
    if others:
        _evaluate_worlds(runs, data, split, folder, background)
    else:
        _evaluate_one(runs, first, split, folder, background)
    print(f"written to {folder}")


def _evaluate_worlds(
    runs: tuple[Path, ...], data: tuple[Path, ...], split: Split, out: Path, background: Path | None
) -> None:
    from t2twin.translate.evaluation.cross_dataset import evaluate_worlds, worlds_markdown

    worlds = evaluate_worlds(runs, data, split, out, background)
    for name, evaluations in worlds.items():
        print(f"{name}\n")
        _print(evaluations)
    print(worlds_markdown(worlds))


def _evaluate_one(
    runs: tuple[Path, ...], data: Path, split: Split, out: Path, background: Path | None
) -> None:
    from t2twin.sim.dataset.store import read_info
    from t2twin.translate.evaluation.evaluate import evaluate as evaluate_split
    from t2twin.translate.evaluation.evaluate import evaluate_both
    from t2twin.translate.evaluation.findings import gap_between
    from t2twin.translate.evaluation.table import findings_text

    if split == "both":
        evaluations = evaluate_both(runs, data, out, background)
    else:
        evaluations = {split: evaluate_split(runs, data, split, out, background)}
    _print(evaluations)
    gap = gap_between(evaluations, read_info(data))
    if gap:
        print(findings_text(gap))


def _print(evaluations: "dict[str, Evaluation]") -> None:
    from t2twin.translate.evaluation.table import (
        by_force_text,
        findings_text,
        irreducible_error_text,
        table,
    )

    for name, evaluation in evaluations.items():
        print(table(evaluation))
        if evaluation.has_forces:
            print(by_force_text(evaluation))
        if evaluation.findings:
            print(findings_text(evaluation.findings))
        if evaluation.irreducible_error:
            print(irreducible_error_text(evaluation.irreducible_error, name))
        print()
