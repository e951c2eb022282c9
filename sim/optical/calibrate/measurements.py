"""Presses with measurements, and their fit at the image scale that agrees with them.

Ball diameters, displacements and forces are read from `forces.csv` in the folder of the frames. It
has a column file, and any of force_n, depth_mm and ball_diameter_mm; a cell may be empty. A
Tolerance bounds their errors.

Frames alone hardly determine the scale. A larger ball pressed deeper and seen from farther away
gives the same image. So does the same ball pressed deeper at a smaller scale, except for changes
that LEDs and response absorb. A measured depth determines the scale: at a given contact width in
pixels, a ball's depth is inversely proportional to the square of the scale.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from os.path import lexists
from pathlib import Path
from typing import Annotated

import numpy as np
from msgspec import Meta

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.types import FORCE_RANGE_N
from t2twin.sim.optical.calibrate.fit import BallFit, State
from t2twin.sim.optical.camera.pinhole import Camera
from t2twin.sim.tables import read_rows

FORCES = "forces.csv"
"""Name of the file of measurements."""
BALL_MM = (1.0, 12.0)
"""Ball diameters that press a DIGIT's gel and fit into its image, mm."""
DEEPEST_MM = 4.0
"""Largest displacement, mm: the gel is 4.07 mm thick."""
SCALES_PX_PER_MM = (10.0, 40.0)
"""Range of scales (assumed: public units have 17.2 to 19.6)."""
DEPTH_RATIO_TOLERANCE = 2e-3
"""Largest deviation from 1 of the ratio of fitted to measured depths (assumed)."""
MAX_FITS = 6
"""Largest number of fits, each at the scale that follows from the last one; three are common."""

Force = Annotated[float, Meta(ge=FORCE_RANGE_N[0], le=FORCE_RANGE_N[1])]
Depth = Annotated[float, Meta(gt=0.0, le=DEEPEST_MM)]
Diameter = Annotated[float, Meta(ge=BALL_MM[0], le=BALL_MM[1])]


@dataclass(frozen=True)
class Tolerance:
    """Largest errors, in either direction.

    ball_mm: of the ball diameters. scale_px_per_mm: of the image scale; unused if displacements are
    measured. depth_mm: of the displacements, mainly of their zero at first contact. force_n: of the
    forces. young_mpa: of the gel's default modulus; unused if forces are measured.

    The defaults are assumed: a caliper for the ball, a stage zeroed by eye, and a kitchen scale.
    The scale's is from 19.2 px/mm to 17.2, the lowest of public units. The modulus' is Gent's 0.41
    to 0.57 MPa of Shore 10A to 15A.

    Raises T2TwinError for a value that is negative or not finite.
    """

    ball_mm: float = 0.1
    scale_px_per_mm: float = 2.0
    depth_mm: float = 0.03
    force_n: float = 0.05
    young_mpa: float = 0.1

    def __post_init__(self) -> None:
        for field in fields(self):
            arguments.number(getattr(self, field.name), f"the tolerance {field.name}", low=0.0)


@dataclass(frozen=True)
class _Row:
    """One press of the file."""

    file: str
    force_n: Force | None = None
    depth_mm: Depth | None = None
    ball_diameter_mm: Diameter | None = None


@dataclass(frozen=True)
class Measurements:
    """Measurements of n presses, each (n,).

    diameters_mm: of the balls. depths_mm: from first contact. forces_n. The last two are NaN where
    there is no measurement.
    """

    diameters_mm: np.ndarray
    depths_mm: np.ndarray
    forces_n: np.ndarray

    def subset(self, presses: Sequence[int]) -> "Measurements":
        """The measurements of the presses with these indices."""
        return Measurements(
            self.diameters_mm[presses], self.depths_mm[presses], self.forces_n[presses]
        )

    @property
    def has_depths(self) -> bool:
        return bool(np.isfinite(self.depths_mm).any())

    @property
    def has_forces(self) -> bool:
        return bool(np.isfinite(self.forces_n).any())


def read_measurements(folder: Path, names: Sequence[str], ball_diameter_mm: float) -> Measurements:
    """The measurements of the named frames of a folder; its file FORCES may be missing.

    ball_diameter_mm: of presses without a diameter in the file. Raises T2TwinError for a diameter
    outside BALL_MM, an invalid file, and a row without a frame or with the frame of another row.
    """
    check_ball(ball_diameter_mm)
    path, index = folder / FORCES, {name: number for number, name in enumerate(names)}
    missing = np.full(len(names), np.nan)
    measurements = Measurements(
        np.full(len(names), float(ball_diameter_mm)), missing.copy(), missing.copy()
    )
    if not lexists(path):  # a broken link is an error
        return measurements
    seen = set()
    for row in read_rows(path, _Row, "a table of presses"):
        if row.file not in index:
            raise T2TwinError(f"{path} names {row.file}, which is not a frame in {folder}")
        if row.file in seen:
            raise T2TwinError(f"{path} names {row.file} twice; each frame has one row")
        seen.add(row.file)
        for values, value in (
            (measurements.diameters_mm, row.ball_diameter_mm),
            (measurements.depths_mm, row.depth_mm),
            (measurements.forces_n, row.force_n),
        ):
            if value is not None:
                values[index[row.file]] = value
    return measurements


def check_ball(diameter_mm: float) -> None:
    """Raises T2TwinError for a ball diameter outside BALL_MM."""
    arguments.number(diameter_mm, "the ball's diameter in mm", *BALL_MM)


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
