"""Makes a run that ships of a training's run, and of what evaluation says of it.

    t2twin evaluate RUN --data data/paper data/forces --split both --out EVALUATION
    python -m t2twin.translate.evaluation.publish_pretrained RUN EVALUATION/paper EVALUATION/forces

What only a training needs stays behind. The learnt weights go into half precision, which is three
decimal digits; what was fitted or counted stays as it is. The card tells the figures.
"""

import shutil
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import torch
from safetensors.torch import load_file, save_file

from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write
from t2twin.translate.evaluation.metrics.reliability import NAMED_KEPT, NAMED_LEVEL
from t2twin.translate.evaluation.records import Evaluation, ModelRow, read_evaluation
from t2twin.translate.runs.card import CARD, LIMITS
from t2twin.translate.runs.config import BEST, CONFIG, LOG, load_config
from t2twin.translate.runs.pretrained import HOME

MIN_NUMBERS = 1000
"""Numbers in a tensor of at least two axes from which it goes into half precision (assumed: less
than a hundredth of all are in smaller ones)."""

KEPT = ("correlation", "mean_frame", "running_mean", "running_var")
"""Ends of the names of tensors that are not learnt, which keep their precision."""

SPLITS = {"val": "new versions of primitives", "test": "hand tools"}
"""What the splits of the protocol's presses hold."""

HEAD = """## Measured

RMSE in percent of full scale, how far the contacts overlap, what intervals of 90 % hold, by how
much the RMSE falls without the least sure fifth of the presses, and how far the force is off
(median). None of these presses was trained on.

| presses | pairs | RMSE % | contact IoU | held % | falls by % | force off % |
|---|---|---|---|---|---|---|
"""


def ship(run_dir: Path, evaluations: Sequence[Path] = (), home: Path = HOME) -> Path:
    """Writes a finished run into home, by its model's name, over an earlier one; its folder there.

    evaluations: folders that `t2twin evaluate` has made of this run, for its card.
    Raises T2TwinError where run_dir holds no run, or one that has not finished, and for folders
    that hold no evaluation of it.
    """
    config = load_config(run_dir)
    for name in (BEST, CARD, LOG):
        if not (run_dir / name).is_file():
            raise T2TwinError(f"{run_dir / name} is not there; the run has not finished")
    card = (run_dir / CARD).read_text(encoding="utf-8")
    rows = [row for folder in evaluations for row in _rows(folder, config.data.sha256)]
    folder = home / config.model
    folder.mkdir(parents=True, exist_ok=True)
    weights = {name: _halved(name, tensor) for name, tensor in load_file(run_dir / BEST).items()}
    with atomic_write(folder / BEST) as temporary:
        save_file(weights, temporary)
        temporary.chmod(0o644)  # safetensors lets only the owner read
    for name in (CONFIG, LOG):
        shutil.copyfile(run_dir / name, folder / name)
    with atomic_write(folder / CARD) as temporary:
        temporary.write_text(_with_figures(card, rows), encoding="utf-8")
    return folder


def _halved(name: str, tensor: torch.Tensor) -> torch.Tensor:
    learnt = tensor.dim() >= 2 and tensor.numel() >= MIN_NUMBERS and not name.endswith(KEPT)
    return tensor.half() if learnt else tensor


def _with_figures(card: str, rows: Sequence[str]) -> str:
    """The card with a table before its limits."""
    if not rows:
        return card
    before, limits, after = card.partition(LIMITS)
    return before + HEAD + "\n".join(rows) + "\n\n" + limits + after


def _rows(folder: Path, sha256: str) -> Iterator[str]:
    """Of an evaluation's splits: over all, and at each force where there are several."""
    there = [split for split in SPLITS if (folder / split).is_dir()]
    if not there:
        raise T2TwinError(f"{folder} holds no evaluation; give folders of `t2twin evaluate`")
    for split in there:
        evaluation = read_evaluation(folder / split)
        row = _row_of(evaluation, sha256, folder)
        sure, overall = row.certainty, row.overall
        held = falls = force = ""
        if sure is not None:
            held = f"{100 * sure.held_at(NAMED_LEVEL):.1f}"
            falls = f"{100 * sure.falls_by(NAMED_KEPT):.0f}"
            error = sure.force_median_error_percent
            force = "" if error is None else f"{error:.1f}"
        iou = "" if overall.contact_iou is None else f"{overall.contact_iou:.3f}"
        yield (
            f"| {evaluation.world or folder.name}, {SPLITS[split]} | {overall.pairs:,} | "
            f"{overall.rmse_percent:.2f} | {iou} | {held} | {falls} | {force} |"
        )


def _row_of(evaluation: Evaluation, sha256: str, folder: Path) -> ModelRow:
    for row in evaluation.runs.values():
        if row.trained_data == sha256:
            return row
    raise T2TwinError(f"{folder} does not say anything of this run; evaluate it first")


if __name__ == "__main__":
    try:
        print(ship(Path(sys.argv[1]), [Path(folder) for folder in sys.argv[2:]]))
    except T2TwinError as error:
        sys.exit(str(error))
