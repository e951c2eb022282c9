"""The first step of an adaptation: the calibration, and what it found in the frames, kept as files.

calibration.npz is what `t2twin calibrate` writes; presses.json holds the held-out presses' places,
depths and scores, so that a road that was stopped goes on without fitting again.
"""

from dataclasses import asdict, dataclass
from pathlib import Path

import msgspec
import numpy as np

from t2twin.core.files import atomic_write
from t2twin.core.records import read_json
from t2twin.sim.digit.calibrate.calibrate import CalibrationReport
from t2twin.sim.digit.calibrate.uncertainty import CalibrationUncertainty

CALIBRATION, PRESSES = "calibration.npz", "presses.json"
FORMAT = 2


@dataclass(frozen=True)
class HeldOut:
    """A press that the light was not fitted to, and how near its simulated picture comes."""

    name: str
    x_mm: float
    y_mm: float
    depth_mm: float
    psnr_db: float
    ssim: float


@dataclass(frozen=True)
class Fitted:
    """asked: digest of the frames and numbers that were given. trained: how many presses the
    scored fit took. psnr_db, ssim: means over the held-out presses' contact crops. certainty: how
    sure depths and forces are."""

    format: int
    asked: str
    ball_diameter_mm: float
    trained: int
    psnr_db: float
    ssim: float
    held_out: tuple[HeldOut, ...]
    certainty: CalibrationUncertainty

    @property
    def poses(self) -> np.ndarray:
        """(n, 3) x_mm, y_mm, depth_mm."""
        return np.array([(one.x_mm, one.y_mm, one.depth_mm) for one in self.held_out])

    @property
    def diameters_mm(self) -> list[float]:
        """Of the balls of the held-out presses."""
        own = {press.name: press.ball_diameter_mm for press in self.certainty.presses}
        return [own[one.name] for one in self.held_out]


def write_fitted(
    folder: Path, report: CalibrationReport, asked: str, ball_diameter_mm: float
) -> Fitted:
    """Writes both files, the calibration first, and gives what the second holds. report: of a
    calibration with tolerances."""
    assert report.certainty is not None
    fitted = Fitted(
        format=FORMAT,
        asked=asked,
        ball_diameter_mm=ball_diameter_mm,
        trained=len(report.trained),
        psnr_db=report.scores.calibrated.psnr_db,
        ssim=report.scores.calibrated.ssim,
        held_out=tuple(
            HeldOut(name, float(pose[0]), float(pose[1]), float(pose[2]), score.psnr_db, score.ssim)
            for name, pose, score in zip(report.held_out, report.poses, report.each, strict=True)
        ),
        certainty=report.certainty,
    )
    report.calibration.save(folder / CALIBRATION)
    with atomic_write(folder / PRESSES) as temporary:
        temporary.write_bytes(msgspec.json.format(msgspec.json.encode(asdict(fitted)), indent=1))
    return fitted


def read_fitted(folder: Path) -> Fitted | None:
    """What was kept in a folder, None where the step has not been done. Raises T2TwinError for a
    file that cannot be read."""
    if not (folder / PRESSES).is_file() or not (folder / CALIBRATION).is_file():
        return None
    return read_json(folder / PRESSES, Fitted, FORMAT)
