"""What an adaptation came to, as adapted.json holds it."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import msgspec
import numpy as np

from t2twin.adaptation.fitted import Fitted
from t2twin.adaptation.real_frame_evaluation import Felt, Judged, Judgement, counts_of
from t2twin.core.files import whole_file
from t2twin.sim.digit.calibrate.uncertainty import CalibrationUncertainty
from t2twin.translate.inference.predictor import CountsPredictor

RECORD = "adapted.json"


@dataclass(frozen=True)
class AdaptationScores:
    """Of a translator over the held-out presses, against the twin's CySkin.

    rmse_percent: root of the mean square over all of them, of full scale. centroid_mm: the median.
    one_blob: how many are felt at one place. force_part: median of the absolute error.
    held_percent: share of all counts that intervals of 90 % hold, None of a run that says none.
    """

    rmse_percent: float
    centroid_mm: float
    one_blob: int
    force_part: float
    held_percent: float | None

    @classmethod
    def of(cls, each: Sequence[Judgement]) -> "AdaptationScores":
        return cls(
            rmse_percent=float(np.sqrt(np.mean([one.rmse_percent**2 for one in each]))),
            centroid_mm=float(np.median([one.centroid_mm for one in each])),
            one_blob=sum(one.blobs == 1 for one in each),
            force_part=float(np.median([abs(one.force_part) for one in each])),
            held_percent=_percent([one.held for one in each]),
        )


def _percent(held: Sequence[float | None]) -> float | None:
    known = [share for share in held if share is not None]
    return 100.0 * float(np.mean(known)) if known else None


@dataclass(frozen=True)
class Adapted:
    """model: what was trained. presses: how many were held out. optics_psnr_db, optics_ssim: of
    the light on them. real, simulated: of their frames, and of the twin's pictures of the same
    presses. nothing, constant: of no counts at all, and of the presses' own mean array.
    untouched_counts: the largest of any taxel on the real background. minutes: by step. certainty:
    how sure the presses' depths and forces are."""

    model: str
    presses: int
    optics_psnr_db: float
    optics_ssim: float
    real: AdaptationScores
    simulated: AdaptationScores
    nothing_rmse_percent: float
    constant_rmse_percent: float
    untouched_counts: float
    minutes: dict[str, float]
    certainty: CalibrationUncertainty


def record_of(
    run: CountsPredictor,
    judged: Sequence[Judged],
    background: np.ndarray,
    fitted: Fitted,
    minutes: dict[str, float],
) -> Adapted:
    """background: (320, 240, 3) uint8, the real unit untouched."""
    nothing, constant = trivial_percent([one.felt for one in judged], run)
    return Adapted(
        model=run.config.model,
        presses=len(judged),
        optics_psnr_db=fitted.psnr_db,
        optics_ssim=fitted.ssim,
        real=AdaptationScores.of([one.real for one in judged]),
        simulated=AdaptationScores.of([one.simulated for one in judged]),
        nothing_rmse_percent=nothing,
        constant_rmse_percent=constant,
        untouched_counts=float(np.max(counts_of(run, background, background))),
        minutes=minutes,
        certainty=fitted.certainty,
    )


def trivial_percent(felt: Sequence[Felt], run: CountsPredictor) -> tuple[float, float]:
    """RMSE, percent of full scale, of no counts at all and of the presses' own mean array."""
    truth = np.array([one.counts for one in felt])
    nothing, constant = (
        100.0 * float(np.sqrt(np.mean(off**2))) / run.config.data.full_scale_counts
        for off in (truth, truth - truth.mean(axis=0))
    )
    return nothing, constant


def write_record(folder: Path, adapted: Adapted) -> None:
    with whole_file(folder / RECORD) as temporary:
        temporary.write_bytes(msgspec.json.format(msgspec.json.encode(asdict(adapted)), indent=1))
