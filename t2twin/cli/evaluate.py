"""t2twin evaluate"""

from pathlib import Path
from typing import Annotated, Literal

import tyro


def evaluate(
    runs: tyro.conf.Positional[
        Annotated[
            tuple[Path, ...], tyro.conf.arg(metavar="RUN", help_behavior_hint="(one or more)")
        ]
    ],
    data: Annotated[Path, tyro.conf.arg(metavar="DIR")],
    split: Literal["val", "test", "both"] = "val",
    out: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None,
) -> None:
    """Measure trained translators, with trivial ones and floors beside them; writes metrics.json.

    Args:
        runs: Folders of trained runs.
        data: Folder of the dataset. touch2touch also takes one of another taxel layout, inside the
            one that it was trained on.
        split: val (versions of the primitives never trained on), test (the hand tools) or both,
            which writes DIR/val, DIR/test, DIR/findings.json and DIR/results.md. Of imported pairs
            both are the owner's, and one may be empty.
        out: Folder to write into; runs/evaluate/SPLIT unless given, runs/evaluate for both.
    """
    from t2twin.primitives_cad.errors import T2TwinError
    from t2twin.translate.distributed import use_all_cores
    from t2twin.translate.evaluation.evaluate import evaluate as measure
    from t2twin.translate.evaluation.evaluate import evaluate_both, gap_between
    from t2twin.translate.evaluation.table import findings_text, lookalikes_text, table

    if not runs:
        raise T2TwinError("there is no run to evaluate; give at least one run's folder")
    folder = out or Path("runs/evaluate") / ("" if split == "both" else split)
    use_all_cores()
    if split == "both":
        evaluations = evaluate_both(list(runs), data, folder)
    else:
        evaluations = {split: measure(list(runs), data, split, folder)}
    for name, evaluation in evaluations.items():
        print(table(evaluation))
        if evaluation.findings:
            print(findings_text(evaluation.findings))
        if evaluation.lookalikes:
            print(lookalikes_text(evaluation.lookalikes, name))
        print()
    between = gap_between(evaluations, data)
    if between:
        print(findings_text(between))
    print(f"written to {folder}")
