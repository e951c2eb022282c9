"""Fits presses at a given image scale, or at the one that agrees with measured displacements.

Frames alone hardly determine the scale. A larger ball pressed deeper and seen from farther away
gives the same image. So does the same ball pressed deeper at a smaller scale, except for changes
that LEDs and response absorb. A measured depth determines the scale: at a given contact width in
pixels, a ball's depth is inversely proportional to the square of the scale.
"""

from dataclasses import dataclass, replace

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.sim.digit.calibrate.fit import BallFit
from t2twin.sim.digit.calibrate.measurements import Measurements
from t2twin.sim.digit.calibrate.samples import State
from t2twin.sim.digit.camera.pinhole import Camera

SCALES_PX_PER_MM = (10.0, 40.0)
"""Range of scales (assumed: public units have 17.2 to 19.6)."""
DEPTH_RATIO_TOLERANCE = 2e-3
"""Largest deviation from 1 of the ratio of fitted to measured depths (assumed)."""
MAX_FITS = 6
"""Largest number of fits, each at the scale that follows from the last one; three are common."""


@dataclass(frozen=True)
class Presses:
    """background: (ROWS, COLUMNS, 3) uint8, cleaned. frames: (n, ROWS, COLUMNS, 3) uint8. patches:
    (n, 2) row and column of each contact, px."""

    background: np.ndarray
    frames: np.ndarray
    patches: np.ndarray
    measurements: Measurements

    def model(self, camera: Camera) -> BallFit:
        radii_mm = self.measurements.diameters_mm / 2
        return BallFit(self.background, self.frames, self.patches, radii_mm, camera)


@dataclass(frozen=True)
class Fit:
    """A model and its fitted state."""

    model: BallFit
    state: State

    @property
    def depths_mm(self) -> np.ndarray:
        """(n,) of the presses."""
        return self.state.poses[:, 2]


def fit_presses(presses: Presses, camera: Camera, start: State | None = None) -> Fit:
    """The fit at the camera's scale, or at the scale that measured displacements give.

    start: state of another fit, whose LEDs and terms are the initial ones. Raises T2TwinError for
    displacements that no scale in SCALES_PX_PER_MM explains.
    """
    model = presses.model(camera)
    fit = Fit(model, model.fit(start))
    if not presses.measurements.has_depths:
        return fit
    for _ in range(MAX_FITS):
        ratio = _depth_ratio(fit, presses.measurements)
        if abs(ratio - 1.0) < DEPTH_RATIO_TOLERANCE:
            return fit
        scale = model.camera.scale_px_per_mm * float(np.sqrt(ratio))
        if not SCALES_PX_PER_MM[0] <= scale <= SCALES_PX_PER_MM[1]:
            break
        model = presses.model(replace(camera, scale_px_per_mm=scale))
        fit = Fit(model, model.fit(fit.state))
    raise T2TwinError(
        "the displacements do not fit the frames at any scale from "
        f"{SCALES_PX_PER_MM[0]:g} to {SCALES_PX_PER_MM[1]:g} px/mm; they must be in mm, from the "
        "ball's first contact"
    )


def _depth_ratio(fit: Fit, measurements: Measurements) -> float:
    """Fitted over measured depths, by least squares."""
    is_measured = np.isfinite(measurements.depths_mm)
    fitted, measured = fit.depths_mm[is_measured], measurements.depths_mm[is_measured]
    return float(fitted @ measured / (measured @ measured))
