"""Files of an adaptation's first step: the fitted calibration and its held-out presses.

calibration.npz has the format of `t2twin calibrate`. presses.json contains positions, depths and
scores of the held-out presses, so that an interrupted adaptation resumes without a new fit.
"""

from dataclasses import asdict, dataclass
from pathlib import Path

import msgspec
import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write, read_file
from t2twin.core.records import convert, decode_json
from t2twin.core.renames import translated
from t2twin.sim.digit.calibrate.calibrate import CalibrationReport
from t2twin.sim.digit.calibrate.uncertainty import CalibrationUncertainty

CALIBRATION, PRESSES = "calibration.npz", "presses.json"
FORMAT = 2


@dataclass(frozen=True)
class HeldOutPress:
    """A press that the calibration was not fitted to, and scores of its simulated image."""

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
    with atomic_write(folder / PRESSES) as temporary:
        temporary.write_bytes(msgspec.json.format(msgspec.json.encode(asdict(fitted)), indent=1))
    return fitted


def read_fitted(folder: Path) -> FittedCalibration | None:
    """Reads presses.json, also of version 0.2; None if the fit is missing or incomplete.

    Raises T2TwinError for an unreadable file.
    """
    path = folder / PRESSES
    if not path.is_file() or not (folder / CALIBRATION).is_file():
        return None
    content = translated("json", decode_json(read_file(path), dict, path))
    fitted = convert(content, FittedCalibration, path)
    if fitted.format != FORMAT:
        raise T2TwinError(f"{path} is of format {fitted.format}; expected {FORMAT}")
    return fitted
