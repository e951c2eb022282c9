"""t2twin evaluate"""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

if TYPE_CHECKING:
    from t2twin.translate.evaluation.records import Evaluation


def evaluate(
    runs: tyro.conf.Positional[
        Annotated[
            tuple[Path, ...], tyro.conf.arg(metavar="RUN", help_behavior_hint="(one or more)")
        ]
    ],
    data: Annotated[
        tuple[Path, ...], tyro.conf.arg(metavar="DIR", help_behavior_hint="(one or more)")
    ],
    split: Literal["val", "test", "both"] = "val",
    out: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None,
    background: Annotated[Path | None, tyro.conf.arg(metavar="IMAGE")] = None,
) -> None:
    """Measure trained translators, with trivial ones and floors beside them; writes metrics.json.

    Args:
        runs: Folders of trained runs.
        data: Folder of the dataset, the one that a run was trained on or any other. touch2touch
            also takes one of another taxel layout, inside the one that it was trained on. Of
            several datasets each gets a folder of its name, and worlds.md is a table of all.
        split: val (in the paper's protocol versions of the primitives never trained on), test (the
            hand tools) or both, which writes DIR/val, DIR/test, DIR/findings.json and
            DIR/results.md, of those of the two that the dataset has.
        out: Folder to write into; runs/evaluate/SPLIT unless given, runs/evaluate for both and for
            several datasets.
        background: Image of the datasets' DIGIT with nothing touching it, which field runs compare
            the images with. Unless given, each pair's own where the dataset holds them, or that of
            the default calibration where the dataset was made with it.
    """
    from t2twin.core.errors import T2TwinError
    from t2twin.translate.evaluation.cross_dataset import evaluate_worlds, worlds_markdown
    from t2twin.translate.evaluation.evaluate import evaluate as measure
    from t2twin.translate.evaluation.evaluate import evaluate_both, gap_between
    from t2twin.translate.evaluation.table import findings_text
    from t2twin.translate.models.distributed import use_all_cores

    if not runs:
        raise T2TwinError(
            "there is no run to evaluate; give one run's folder or more before --data"
        )
    if not data:
        raise T2TwinError("there is no dataset to evaluate on; give its folder with --data")
    whole = split == "both" or len(data) > 1
    folder = out or Path("runs/evaluate") / ("" if whole else split)
    use_all_cores()
    first, *others = list(data)
    if others:
        worlds = evaluate_worlds(runs, data, split, folder, background)
        for name, evaluations in worlds.items():
            print(f"{name}\n")
            _print(evaluations)
        print(worlds_markdown(worlds))
    else:
        if split == "both":
            evaluations = evaluate_both(list(runs), first, folder, background)
        else:
            evaluations = {split: measure(list(runs), first, split, folder, background)}
        _print(evaluations)
        between = gap_between(evaluations, first)
        if between:
            print(findings_text(between))
    print(f"written to {folder}")


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
        if evaluation.lookalikes:
            print(irreducible_error_text(evaluation.lookalikes, name))
        print()
