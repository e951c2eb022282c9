"""Fitting presses at a scale that is stated, or at the one that known displacements ask for.

Frames alone hardly tell the picture's scale: the same picture, in pixels, is that of a larger ball
pressed deeper, seen from farther, and of the same ball pressed deeper at a smaller scale but for
what LEDs and response take up. A depth that is known settles it: at a given width of the contact
in pixels a ball's depth falls with the square of the scale.
"""

from dataclasses import dataclass, replace

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.sim.digit.calibrate.fit import BallFit, State
from t2twin.sim.digit.calibrate.measurements import Measurements
from t2twin.sim.digit.camera.pinhole import Camera

SCALES_PX_PER_MM = (10.0, 40.0)
"""Scales that displacements may ask for (assumed: public units have 17.2 to 19.6)."""
NEAR = 2e-3
"""Depths found are as those known when their ratio is this near to 1 (assumed)."""
ROUNDS = 6
"""Most fits, each at the scale that the last one asks for; three are common."""


@dataclass(frozen=True)
class Presses:
    """background: (ROWS, COLUMNS, 3) uint8, cleaned. frames: (n, ROWS, COLUMNS, 3) uint8. patches:
    (n, 2) rows and columns, px, where they are touched."""

    background: np.ndarray
    frames: np.ndarray
    patches: np.ndarray
    known: Measurements

    def model(self, camera: Camera) -> BallFit:
        radii_mm = self.known.diameters_mm / 2
        return BallFit(self.background, self.frames, self.patches, radii_mm, camera)


@dataclass(frozen=True)
class Fit:
    """A model and the state that it was fitted to."""

    model: BallFit
    state: State

    @property
    def depths_mm(self) -> np.ndarray:
        """(n,) of the presses."""
        return self.state.poses[:, 2]


def fitted(presses: Presses, camera: Camera, start: State | None = None) -> Fit:
    """The fit at the camera's scale; where displacements are known, at the one that they ask for.

    start: another fit's end, from which LEDs and terms are taken. Raises T2TwinError for
    displacements that no scale of SCALES_PX_PER_MM explains.
    """
    model = presses.model(camera)
    fit = Fit(model, model.fit(start))
    if not presses.known.has_depths:
        return fit
    for _ in range(ROUNDS):
        ratio = _over_known(fit, presses.known)
        if abs(ratio - 1.0) < NEAR:
            return fit
        scale = model.camera.scale_px_per_mm * float(np.sqrt(ratio))
        if not SCALES_PX_PER_MM[0] <= scale <= SCALES_PX_PER_MM[1]:
            break
        model = presses.model(replace(camera, scale_px_per_mm=scale))
        fit = Fit(model, model.fit(fit.state))
    raise T2TwinError(
        "the displacements do not fit the frames at any scale from "
        f"{SCALES_PX_PER_MM[0]:g} to {SCALES_PX_PER_MM[1]:g} px/mm; they must be in mm, from the "
        "ball's first touch"
    )


def _over_known(fit: Fit, known: Measurements) -> float:
    """Depths found over those known, by least squares."""
    there = np.isfinite(known.depths_mm)
    found, wanted = fit.depths_mm[there], known.depths_mm[there]
    return float(found @ wanted / (wanted @ wanted))
