"""Results of an adaptation, written to adapted.json."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import msgspec
import numpy as np

from t2twin.adaptation.fitted_calibration import FittedCalibration
from t2twin.adaptation.real_frame_evaluation import (
    FrameResult,
    PressComparison,
    SimulatedReference,
    predict_counts,
)
from t2twin.core.files import atomic_write
from t2twin.sim.digit.calibrate.uncertainty import CalibrationUncertainty
from t2twin.translate.inference.predictor import CountsPredictor

RECORD = "adapted.json"


@dataclass(frozen=True)
class AdaptationScores:
    """Scores of a translator over the held-out presses, relative to the simulated CySkin.

    rmse_percent: over all presses, percent of full scale. centroid_mm: median. single_region:
    presses with exactly one predicted contact region. force_error: median absolute relative error.
    interval_coverage_percent: counts within their 90 % intervals, None without intervals.
    """

    rmse_percent: float
    centroid_mm: float
    single_region: int
    force_error: float
    interval_coverage_percent: float | None

    @classmethod
    def of(cls, results: Sequence[FrameResult]) -> "AdaptationScores":
        covered = [result.coverage for result in results if result.coverage is not None]
        return cls(
            rmse_percent=float(np.sqrt(np.mean([result.rmse_percent**2 for result in results]))),
            centroid_mm=float(np.median([result.centroid_mm for result in results])),
            single_region=sum(result.regions == 1 for result in results),
            force_error=float(np.median([abs(result.force_error) for result in results])),
            interval_coverage_percent=100.0 * float(np.mean(covered)) if covered else None,
        )


@dataclass(frozen=True)
class AdaptationResult:
    """Content of adapted.json.

    model: the trained model. presses: number of held-out presses. optics_psnr_db, optics_ssim: of
    the calibrated optics on them. real, simulated: scores on the real and the simulated frames.
    zero_rmse_percent, mean_array_rmse_percent: baselines, no counts and the mean array of the
    presses. background_counts: largest predicted count on the real background frame. minutes: by
    step. uncertainty: ranges of the presses' depths and forces.
    """

    model: str
    presses: int
    optics_psnr_db: float
    optics_ssim: float
    real: AdaptationScores
    simulated: AdaptationScores
    zero_rmse_percent: float
    mean_array_rmse_percent: float
    background_counts: float
    minutes: dict[str, float]
    uncertainty: CalibrationUncertainty


def record_of(
    run: CountsPredictor,
    comparisons: Sequence[PressComparison],
    background: np.ndarray,
    fitted: FittedCalibration,
    minutes: dict[str, float],
) -> AdaptationResult:
    """Summarizes an adaptation. background: (320, 240, 3) uint8, of the real unit."""
    zero, mean_array = baseline_rmse_percent([one.reference for one in comparisons], run)
    return AdaptationResult(
        model=run.config.model,
        presses=len(comparisons),
        optics_psnr_db=fitted.psnr_db,
        optics_ssim=fitted.ssim,
        real=AdaptationScores.of([one.real for one in comparisons]),
        simulated=AdaptationScores.of([one.simulated for one in comparisons]),
        zero_rmse_percent=zero,
        mean_array_rmse_percent=mean_array,
        background_counts=float(np.max(predict_counts(run, background, background))),
        minutes=minutes,
        uncertainty=fitted.uncertainty,
    )


def baseline_rmse_percent(
    references: Sequence[SimulatedReference], run: CountsPredictor
) -> tuple[float, float]:
    """RMSE, percent of full scale, of zero counts and of the mean array of the presses."""
    truth = np.array([reference.counts for reference in references])
    zero, mean_array = (
        100.0 * float(np.sqrt(np.mean(residual**2))) / run.config.data.full_scale_counts
        for residual in (truth, truth - truth.mean(axis=0))
    )
    return zero, mean_array


def write_record(folder: Path, result: AdaptationResult) -> None:
    with atomic_write(folder / RECORD) as temporary:
        temporary.write_bytes(msgspec.json.format(msgspec.json.encode(asdict(result)), indent=1))
