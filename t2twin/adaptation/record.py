"""Files of an adaptation: the fitted calibration, its held-out presses, and the results.

calibration.npz has the format of `t2twin calibrate`. presses.json contains positions, depths and
scores of the held-out presses, so that an interrupted adaptation resumes without a new fit.
adapted.json contains the results.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from t2twin.adaptation.real_frame_evaluation import (
    FrameResult,
    PressComparison,
    SimulatedReference,
)
from t2twin.core.errors import T2TwinError
from t2twin.core.files import read_file, write_json
from t2twin.core.records import decode_json
from t2twin.sim.digit.calibrate.calibrate import CalibrationReport
from t2twin.sim.digit.calibrate.uncertainty import CalibrationUncertainty
from t2twin.translate.inference.predictor import CountsPredictor

CALIBRATION, PRESSES, RECORD = "calibration.npz", "presses.json", "adapted.json"
TRAINED, INITIAL = "trained", "initial"
"""Names of the runs of an adaptation: its own, and the one that initialized the training."""

FORMAT = 2
"""Format of presses.json."""


@dataclass(frozen=True)
class HeldOutPress:
    """A held-out press, and scores of its image, simulated with a calibration without it."""

    name: str
    x_mm: float
    y_mm: float
    depth_mm: float
    psnr_db: float
    ssim: float


@dataclass(frozen=True)
class FittedCalibration:
    """Content of presses.json.

    inputs_digest: SHA-256 of the frames and numbers of the fit. trained: number of presses of the
    scored fit. psnr_db, ssim: means over the contact crops of the held-out presses.
    uncertainty: ranges of depths and forces.
    """

    format: int
    inputs_digest: str
    ball_diameter_mm: float
    trained: int
    psnr_db: float
    ssim: float
    held_out: tuple[HeldOutPress, ...]
    uncertainty: CalibrationUncertainty

    @property
    def poses(self) -> np.ndarray:
        """(n, 3): x_mm, y_mm, depth_mm of the held-out presses."""
        return np.array([(press.x_mm, press.y_mm, press.depth_mm) for press in self.held_out])

    @property
    def diameters_mm(self) -> list[float]:
        """Ball diameters of the held-out presses."""
        diameters = {press.name: press.ball_diameter_mm for press in self.uncertainty.presses}
        return [diameters[press.name] for press in self.held_out]


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
class RunScores:
    """Scores of a run on the real and the simulated frames of the held-out presses.

    background_counts: largest predicted count on the real background frame.
    """

    real: AdaptationScores
    simulated: AdaptationScores
    background_counts: float

    @classmethod
    def of(cls, comparisons: Sequence[PressComparison], background_counts: float) -> "RunScores":
        real, simulated = (
            [one.real for one in comparisons],
            [one.simulated for one in comparisons],
        )
        return cls(AdaptationScores.of(real), AdaptationScores.of(simulated), background_counts)


@dataclass(frozen=True)
class AdaptationResult:
    """Content of adapted.json.

    model: the trained model. kept: name of the more accurate run, TRAINED or INITIAL. runs: scores
    by name; INITIAL, the run that initialized the training, is missing if there is none. presses:
    number of held-out presses. optics_psnr_db, optics_ssim: of the calibrated optics on them.
    zero_rmse_percent, mean_array_rmse_percent: baselines, no counts and the mean array of the
    presses. minutes: by step. uncertainty: ranges of the presses' depths and forces.
    """

    model: str
    kept: str
    runs: dict[str, RunScores]
    presses: int
    optics_psnr_db: float
    optics_ssim: float
    zero_rmse_percent: float
    mean_array_rmse_percent: float
    minutes: dict[str, float]
    uncertainty: CalibrationUncertainty

    @property
    def scores(self) -> RunScores:
        """Scores of the kept run."""
        return self.runs[self.kept]


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


def write_fitted(
    folder: Path, report: CalibrationReport, inputs_digest: str, ball_diameter_mm: float
) -> FittedCalibration:
    """Writes calibration.npz, then presses.json; returns the content of the latter.

    report: of a calibration with tolerances.
    """
    assert report.uncertainty is not None
    fitted = FittedCalibration(
        format=FORMAT,
        inputs_digest=inputs_digest,
        ball_diameter_mm=ball_diameter_mm,
        trained=len(report.trained),
        psnr_db=report.scores.calibrated.psnr_db,
        ssim=report.scores.calibrated.ssim,
        held_out=tuple(
            HeldOutPress(name, float(x), float(y), float(depth), score.psnr_db, score.ssim)
            for name, (x, y, depth), score in zip(
                report.held_out, report.poses, report.each, strict=True
            )
        ),
        uncertainty=report.uncertainty,
    )
    report.calibration.save(folder / CALIBRATION)
    write_json(folder / PRESSES, asdict(fitted))
    return fitted


def read_fitted(folder: Path) -> FittedCalibration | None:
    """Reads presses.json; None if the fit is missing or incomplete.

    Raises T2TwinError for an unreadable file.
    """
    path = folder / PRESSES
    if not path.is_file() or not (folder / CALIBRATION).is_file():
        return None
    fitted = decode_json(read_file(path), FittedCalibration, path)
    if fitted.format != FORMAT:
        raise T2TwinError(f"{path} is of format {fitted.format}; expected {FORMAT}")
    return fitted
