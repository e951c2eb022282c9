"""When a training ends, and its result."""

from dataclasses import dataclass
from pathlib import Path

from t2twin.translate.runs.config import RunConfig
from t2twin.translate.runs.log import EpochRecord, best_epoch


@dataclass(frozen=True)
class TrainingResult:
    """Result of a finished training.

    best_rmse_counts: RMSE on the validation split, counts, the root of the L3 of Grella et al.
    2023. best_rmse_percent: the same in percent of full scale. best_rmse_grey: for a run that
    predicts DIGIT images, the RMSE of its pixels, grey levels; best_rmse_counts is None then.
    """

    run_dir: Path
    epochs: int
    best_epoch: int
    best_rmse_counts: float | None
    best_rmse_percent: float
    stop_reason: str
    best_rmse_grey: float | None = None

    @property
    def summary(self) -> str:
        """The result as one clause."""
        grey = self.best_rmse_grey
        rmse = f"{self.best_rmse_counts:.0f} counts" if grey is None else f"{grey:.1f} grey levels"
        return (
            f"{self.stop_reason}; the best of {self.epochs} epochs is {self.best_epoch}, with a "
            f"validation RMSE of {rmse} ({self.best_rmse_percent:.2f} %)"
        )


def training_result(run_dir: Path, history: list[EpochRecord], reason: str) -> TrainingResult:
    """The result of a run with at least one epoch."""
    best = best_epoch(history)
    return TrainingResult(
        run_dir=run_dir,
        epochs=len(history),
        best_epoch=best.epoch,
        best_rmse_counts=best.val_rmse_counts,
        best_rmse_percent=best.val_rmse_percent,
        stop_reason=reason,
        best_rmse_grey=best.val_rmse_grey,
    )


def stop_reason(config: RunConfig, history: list[EpochRecord]) -> str | None:
    """Why a run with this history is finished, or None."""
    if not history:
        return None
    if len(history) >= config.planned_epochs:
        return "all its epochs are done"
    if len(history) - best_epoch(history).epoch >= config.preset.patience:
        return f"{config.preset.patience} epochs brought no better validation"
    seconds = sum(record.seconds for record in history)
    if config.minutes is not None and seconds >= 60 * config.minutes:
        return f"its {config.minutes:g} minutes are over"
    return None
