"""Keeps the more accurate of two runs: the trained one, and the one that initialized its training.

Both are evaluated on the same held-out presses. The trained run is kept if its RMSE is lower on the
real frames and also on their simulated frames; one of the two may be lower by chance.
"""

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from t2twin.adaptation.real_frame_evaluation import (
    PressComparison,
    SimulatedReference,
    evaluate_frames,
    predict_counts,
)
from t2twin.adaptation.record import INITIAL, TRAINED, RunScores
from t2twin.core.files import atomic_write
from t2twin.core.templates import render
from t2twin.translate.inference.load import load_run
from t2twin.translate.inference.predictor import CountsPredictor
from t2twin.translate.runs.card import CARD, LIMITS
from t2twin.translate.runs.config import BEST, CONFIG, LOG


@dataclass(frozen=True)
class Candidate:
    """A run, with its scores on the held-out presses."""

    run_dir: Path
    run: CountsPredictor
    comparisons: list[PressComparison]
    scores: RunScores

    @classmethod
    def of(
        cls, run_dir: Path, references: Sequence[SimulatedReference], background: np.ndarray
    ) -> "Candidate":
        """Evaluates a run. background: (320, 240, 3) uint8, of the real unit."""
        run = load_run(run_dir)
        comparisons = evaluate_frames(run, references, background)
        counts = predict_counts(run, background, background)
        scores = RunScores.of(comparisons, background_counts=float(counts.max()))
        return cls(run_dir, run, comparisons, scores)


def choose(candidates: Mapping[str, Candidate]) -> str:
    """TRAINED or INITIAL, the name of the candidate to keep."""
    trained, initial = candidates[TRAINED].scores, candidates.get(INITIAL)
    if initial is None:
        return TRAINED
    is_better = all(
        getattr(trained, frames).rmse_percent < getattr(initial.scores, frames).rmse_percent
        for frames in ("real", "simulated")
    )
    return TRAINED if is_better else INITIAL


def publish(candidates: Mapping[str, Candidate], kept: str, out_dir: Path) -> None:
    """Copies the kept run to out_dir, with the scores of all candidates in its card."""
    out_dir.mkdir(exist_ok=True)
    source = candidates[kept].run_dir
    for name in (BEST, LOG, CONFIG):
        if (source / name).is_file():
            with atomic_write(out_dir / name) as temporary:
                shutil.copyfile(source / name, temporary)
    card = source / CARD
    text = card.read_text(encoding="utf-8") if card.is_file() else LIMITS
    scores = {name: candidate.scores for name, candidate in candidates.items()}
    section = render("adaptation/templates/card.md", kept=kept, scores=scores)
    with atomic_write(out_dir / CARD) as temporary:
        temporary.write_text(text.replace(LIMITS, f"{section}\n{LIMITS}", 1), encoding="utf-8")
