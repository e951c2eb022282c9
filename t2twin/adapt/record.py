"""What an adaptation came to, as adapted.json holds it."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import msgspec
import numpy as np

from t2twin.adapt.fitted import Fitted
from t2twin.adapt.judged import Felt, Judgement, judge
from t2twin.primitives_cad.writing import whole_file
from t2twin.translate.predict import TrainedTranslator

RECORD = "adapted.json"


@dataclass(frozen=True)
class Scores:
    """Of a translator over the held-out presses, against the twin's CySkin.

    rmse_percent: root of the mean square over all of them, of full scale. centroid_mm: the median.
    one_blob: how many are felt at one place. force_part: median of the absolute error.
    """

    rmse_percent: float
    centroid_mm: float
    one_blob: int
    force_part: float

    @classmethod
    def of(cls, each: Sequence[Judgement]) -> "Scores":
        return cls(
            rmse_percent=float(np.sqrt(np.mean([one.rmse_percent**2 for one in each]))),
            centroid_mm=float(np.median([one.centroid_mm for one in each])),
            one_blob=sum(one.blobs == 1 for one in each),
            force_part=float(np.median([abs(one.force_part) for one in each])),
        )


@dataclass(frozen=True)
class Adapted:
    """model: what was trained. presses: how many were held out. optics_psnr_db, optics_ssim: of
    the light on them. real, simulated: of their frames, and of the twin's pictures of the same
    presses. nothing, constant: of no counts at all, and of the presses' own mean array.
    untouched_counts: the largest of any taxel on the real background. minutes: by step."""

    model: str
    presses: int
    optics_psnr_db: float
    optics_ssim: float
    real: Scores
    simulated: Scores
    nothing_rmse_percent: float
    constant_rmse_percent: float
    untouched_counts: float
    minutes: dict[str, float]


def record_of(
    run: TrainedTranslator,
    felt: Sequence[Felt],
    background: np.ndarray,
    fitted: Fitted,
    minutes: dict[str, float],
) -> Adapted:
    """background: (320, 240, 3) uint8, the real unit untouched."""
    truth = np.array([one.counts for one in felt])
    full_scale = run.config.data.full_scale_counts

    def rmse_percent(off: np.ndarray) -> float:
        return 100.0 * float(np.sqrt(np.mean(off**2))) / full_scale

    return Adapted(
        model=run.config.model,
        presses=len(felt),
        optics_psnr_db=fitted.psnr_db,
        optics_ssim=fitted.ssim,
        real=Scores.of([judge(run, one.frame, one.counts) for one in felt]),
        simulated=Scores.of([judge(run, one.simulated, one.counts) for one in felt]),
        nothing_rmse_percent=rmse_percent(truth),
        constant_rmse_percent=rmse_percent(truth - truth.mean(axis=0)),
        untouched_counts=float(np.max(run.predict(background))),
        minutes=minutes,
    )


def write_record(folder: Path, adapted: Adapted) -> None:
    with whole_file(folder / RECORD) as temporary:
        temporary.write_bytes(msgspec.json.format(msgspec.json.encode(asdict(adapted)), indent=1))
