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
from t2twin.sim.calibrate.fit import BallFit, Measurements, Presses, State
from t2twin.sim.contact.types import FORCE_RANGE_N
from t2twin.sim.optical.camera.pinhole import Camera
from t2twin.sim.optical.gel_camera import GelCamera
from t2twin.sim.tables import read_rows

FORCES = "forces.csv"
"""Name of the file of measurements."""
SMALLEST_BALL_MM = 1.0
"""Smallest diameter of a ball, mm (assumed); the largest fits into the image."""
SCALES = (0.5, 2.0)
"""Range of scales, in parts of the sensor's (assumed)."""
SCALE_SHARE, YOUNG_SHARE = 0.1, 0.2
"""Default tolerances of the scale, for a sensor whose file has no range of it, and of the modulus,
in parts of the file's values (assumed). That of the modulus is Gent's range, Shore 10A to 15A."""
DEPTH_RATIO_TOLERANCE = 2e-3
"""Largest deviation from 1 of the ratio of fitted to measured depths (assumed)."""
MAX_FITS = 6
"""Largest number of fits, each at the scale that follows from the last one; three are common."""

Force = Annotated[float, Meta(ge=FORCE_RANGE_N[0], le=FORCE_RANGE_N[1])]
Depth = Annotated[float, Meta(gt=0.0)]


@dataclass(frozen=True)
class Tolerance:
    """Largest errors, in either direction.

    ball_mm: of the ball diameters. scale_px_per_mm: of the image scale; unused if displacements are
    measured; by default as far as the sensor's file lets units differ, or a tenth. depth_mm: of the
    displacements, mainly of their zero at first contact. force_n: of the forces. young_mpa: of the
    gel's modulus in the sensor's file, by default a fifth; unused if forces are measured.

    The defaults are assumed: a caliper for the ball, a stage zeroed by eye, and a kitchen scale.

    Raises T2TwinError for a value that is negative or not finite.
    """

    ball_mm: float = 0.1
    scale_px_per_mm: float | None = None
    depth_mm: float = 0.03
    force_n: float = 0.05
    young_mpa: float | None = None

    def __post_init__(self) -> None:
        for field in fields(self):
            if getattr(self, field.name) is not None:
                arguments.number(getattr(self, field.name), f"the tolerance {field.name}", low=0.0)

    def of(self, sensor: GelCamera) -> "Tolerance":
        """The same, complete, for a sensor."""
        scale, units = sensor.camera.scale_px_per_mm, sensor.spec.units
        low, high = ((1 - SCALE_SHARE) * scale, (1 + SCALE_SHARE) * scale)
        if units is not None:
            low, high = units.scale_px_per_mm
        return replace(
            self,
            scale_px_per_mm=_given(self.scale_px_per_mm, max(scale - low, high - scale)),
            young_mpa=_given(self.young_mpa, YOUNG_SHARE * sensor.own_gel.young_mpa),
        )


def _given(value: float | None, default: float) -> float:
    return default if value is None else value


@dataclass(frozen=True)
class _Row:
    """One press of the file."""

    file: str
    force_n: Force | None = None
    depth_mm: Depth | None = None
    ball_diameter_mm: float | None = None


def read_measurements(
    folder: Path, names: Sequence[str], ball_diameter_mm: float, sensor: GelCamera
) -> Measurements:
    """The measurements of the named frames of a folder; its file FORCES may be missing.

    ball_diameter_mm: of presses without a diameter in the file. Raises T2TwinError for a diameter
    that check_ball refuses, a depth beyond the gel's thickness, an invalid file, and a row without
    a frame or with the frame of another row.
    """
    check_ball(ball_diameter_mm, "the ball's diameter in mm", sensor)
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
        if row.ball_diameter_mm is not None:
            check_ball(row.ball_diameter_mm, f"{path}: ball_diameter_mm of {row.file}", sensor)
        if row.depth_mm is not None and row.depth_mm > sensor.own_gel.thickness_mm:
            raise T2TwinError(
                f"{path}: depth_mm of {row.file} is {row.depth_mm:g}; it must be at most "
                f"{sensor.own_gel.thickness_mm:g}, the gel's thickness"
            )
        for values, value in (
            (measurements.diameters_mm, row.ball_diameter_mm),
            (measurements.depths_mm, row.depth_mm),
            (measurements.forces_n, row.force_n),
        ):
            if value is not None:
                values[index[row.file]] = value
    return measurements


def check_ball(diameter_mm: float, name: str, sensor: GelCamera) -> None:
    """Raises T2TwinError for a diameter that is below SMALLEST_BALL_MM or wider than the image."""
    largest_mm = 2.0 * min(sensor.camera.seen_half_extent_mm())
    arguments.number(diameter_mm, name, SMALLEST_BALL_MM, max(largest_mm, SMALLEST_BALL_MM))


def scale_range(sensor: GelCamera) -> tuple[float, float]:
    """Lowest and highest scale that a fit can have, px/mm."""
    low, high = (share * sensor.camera.scale_px_per_mm for share in SCALES)
    return low, high


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
    displacements that no scale in scale_range explains.
    """
    model = BallFit(presses, camera)
    fit = Fit(model, model.fit(start))
    if not presses.measurements.has_depths:
        return fit
    low, high = scale_range(presses.sensor)
    for _ in range(MAX_FITS):
        ratio = _depth_ratio(fit, presses.measurements)
        if abs(ratio - 1.0) < DEPTH_RATIO_TOLERANCE:
            return fit
        scale = model.camera.scale_px_per_mm * float(np.sqrt(ratio))
        if not low <= scale <= high:
            break
        model = BallFit(presses, replace(camera, scale_px_per_mm=scale))
        fit = Fit(model, model.fit(fit.state))
    raise T2TwinError(
        "the displacements do not fit the frames at any scale from "
        f"{low:g} to {high:g} px/mm; they must be in mm, from the "
        "ball's first contact"
    )


def _depth_ratio(fit: Fit, measurements: Measurements) -> float:
    """Fitted over measured depths, by least squares."""
    is_measured = np.isfinite(measurements.depths_mm)
    fitted, measured = fit.depths_mm[is_measured], measurements.depths_mm[is_measured]
    return float(fitted @ measured / (measured @ measured))
