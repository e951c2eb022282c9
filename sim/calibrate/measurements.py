"""Presses with measurements: the fit at the scale that agrees with them, and its uncertainty.

Ball diameters, displacements and forces are read from `forces.csv` in the folder of the frames. It
has a column file, and any of force_n, depth_mm and ball_diameter_mm; a cell may be empty. A
Tolerance bounds their errors.

Frames alone hardly determine the scale. A larger ball pressed deeper and seen from farther away
gives the same image. So does the same ball pressed deeper at a smaller scale, except for changes
that LEDs and response absorb. A measured depth determines the scale: at a given contact width in
pixels, a ball's depth is inversely proportional to the square of the scale.

For bounds of depths and forces, all presses are fitted twice more. All inputs are then at the end
of their tolerances where presses come out deepest, or shallowest.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from os.path import lexists
from pathlib import Path
from typing import Annotated

import numpy as np
from msgspec import Meta

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.tables import Table
from t2twin.primitives_cad.shape import ball
from t2twin.sim.calibrate.fit import BallFit, Measurements, Presses, State
from t2twin.sim.contact.contact_solver import force_at_depth, solve_contact
from t2twin.sim.contact.types import FORCE_RANGE_N, PressCommand
from t2twin.sim.optical.camera import Camera
from t2twin.sim.optical.gel_camera import GelCamera
from t2twin.sim.tables import read_rows

FORCES = "forces.csv"  # name of the file of measurements
SMALLEST_BALL_MM = 1.0  # smallest diameter of a ball, mm (assumed); the largest fits into the image
SCALES = (0.5, 2.0)  # range of scales, in parts of the sensor's (assumed)
SCALE_SHARE, YOUNG_SHARE = 0.1, 0.2
"""Default tolerances of the scale, for a sensor whose file has no range of it, and of the modulus,
in parts of the file's values (assumed). That of the modulus is Gent's range, Shore 10A to 15A."""
DEPTH_RATIO_TOLERANCE = 2e-3
"""Largest deviation from 1 of the ratio of fitted to measured depths (assumed)."""
MAX_FITS = 6
"""Largest number of fits, each at the scale that follows from the last one; three are common."""
SHALLOWEST_SIGN, DEEPEST_SIGN = 1.0, -1.0
"""Signs of the errors of ball diameter and scale that give such depths."""

Force = Annotated[float, Meta(ge=FORCE_RANGE_N[0], le=FORCE_RANGE_N[1])]
Depth = Annotated[float, Meta(gt=0.0)]


@dataclass(frozen=True)
class Tolerance:
    """Largest errors, in either direction; the defaults are assumed: a caliper for the ball, a
    stage zeroed by eye, and a kitchen scale.

    ball_mm: of the ball diameters. scale_px_per_mm: of the image scale; unused if displacements are
    measured; by default as far as the sensor's file lets units differ, or a tenth. depth_mm: of the
    displacements, mainly of their zero at first contact. force_n: of the forces. young_mpa: of the
    gel's modulus in the sensor's file, by default a fifth; unused if forces are measured.
    Raises T2TwinError for a value that is negative or not finite.
    """

    ball_mm: float = 0.1
    scale_px_per_mm: float | None = None
    depth_mm: float = 0.03
    force_n: float = 0.05
    young_mpa: float | None = None

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if value is not None:
                arguments.number(value, f"the tolerance {name}", low=0.0)

    def of(self, sensor: GelCamera) -> "Tolerance":
        """The same, complete, for a sensor."""
        scale, units = sensor.camera.scale_px_per_mm, sensor.spec.units
        low, high = ((1 - SCALE_SHARE) * scale, (1 + SCALE_SHARE) * scale)
        if units is not None:
            low, high = units.scale_px_per_mm
        complete = self
        if self.scale_px_per_mm is None:
            complete = replace(complete, scale_px_per_mm=max(scale - low, high - scale))
        if self.young_mpa is None:
            complete = replace(complete, young_mpa=YOUNG_SHARE * sensor.own_gel.young_mpa)
        return complete


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
    path, rows = folder / FORCES, {}
    thickness_mm = sensor.own_gel.thickness_mm
    # a broken link is an error
    for row in read_rows(path, _Row) if lexists(path) else ():
        if row.file not in names:
            raise T2TwinError(f"{path} names {row.file}, which is not a frame in {folder}")
        if row.file in rows:
            raise T2TwinError(f"{path} names {row.file} twice; each frame has one row")
        rows[row.file] = row
        if row.ball_diameter_mm is not None:
            check_ball(row.ball_diameter_mm, f"{path}: ball_diameter_mm of {row.file}", sensor)
        if row.depth_mm is not None and row.depth_mm > thickness_mm:
            raise T2TwinError(
                f"{path}: depth_mm of {row.file} is {row.depth_mm:g}; it must be at most "
                f"{thickness_mm:g}, the gel's thickness"
            )
    found = [rows.get(name, _Row(name)) for name in names]
    diameters = [row.ball_diameter_mm or ball_diameter_mm for row in found]
    return Measurements(
        np.array(diameters, float),
        np.array([row.depth_mm for row in found], float),
        np.array([row.force_n for row in found], float),
    )


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
    fitted, measured = fit.state.poses[is_measured, 2], measurements.depths_mm[is_measured]
    return float(fitted @ measured / (measured @ measured))


@dataclass(frozen=True)
class Bounds:
    """A value, and the bounds of the true one if all errors are within the tolerances."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class PressBounds:
    """Bounds of one press, from the fit to all presses.

    force_n: the twin's at the depth, in a gel of the fitted modulus, or of the sensor's without
    measured forces; None where no allowed force reaches the depth.
    """

    name: str
    ball_diameter_mm: float
    depth_mm: Bounds
    force_n: Bounds | None


@dataclass(frozen=True)
class OpticsUncertainty:
    """Bounds of all presses, the scale and the modulus.

    tolerance: complete. presses: in the order of their names. scale_px_per_mm: the given scale, or
    the fitted one if displacements are measured. own_young_mpa: modulus in the sensor's file.
    young_mpa: the gel's modulus, if forces are measured.
    depth_measurements, force_measurements: how many presses have one. depth_residual_mm,
    force_residual_n: root mean square error of the fit on them; None where there are none.
    """

    tolerance: Tolerance
    presses: tuple[PressBounds, ...]
    scale_px_per_mm: Bounds
    depth_measurements: int
    depth_residual_mm: float | None
    own_young_mpa: float
    young_mpa: Bounds | None
    force_measurements: int
    force_residual_n: float | None


def estimate_uncertainty(
    presses: Presses, fit: Fit, tolerance: Tolerance, report: Callable[[str], object]
) -> OpticsUncertainty:
    """Bounds around a fit to all presses.

    tolerance: complete. report: called with progress messages. Raises T2TwinError where the presses
    cannot be fitted within the tolerances.
    """
    assert tolerance.young_mpa is not None
    measurements, own_mpa = presses.measurements, presses.sensor.own_gel.young_mpa
    estimates = [_estimate(presses, fit, own_mpa)]
    for sign, word in ((DEEPEST_SIGN, "deepest"), (SHALLOWEST_SIGN, "shallowest")):
        report(f"fitting within the tolerances, {word}")
        moved, camera = shifted(presses, fit.model.camera, tolerance, sign)
        try:
            moved_fit = fit_presses(moved, camera, fit.state)
        except T2TwinError as error:
            raise T2TwinError(
                f"with all inputs at the end of their tolerances where presses are {word}, "
                f"{error}; or give smaller tolerances"
            ) from error
        estimates.append(_estimate(moved, moved_fit, own_mpa - sign * tolerance.young_mpa))
    depths_mm, forces_n, scales, moduli_mpa = zip(*estimates, strict=True)
    press_bounds = (
        PressBounds(
            name, float(diameter), _bounds(depths),
            _bounds(forces) if np.isfinite(forces).all() else None,
        )
        for name, diameter, depths, forces in zip(
            presses.names, measurements.diameters_mm, np.transpose(depths_mm),
            np.transpose(forces_n), strict=True,
        )
    )  # fmt: skip
    return OpticsUncertainty(
        tolerance=tolerance,
        presses=tuple(press_bounds),
        scale_px_per_mm=_bounds(scales),
        depth_measurements=int(np.isfinite(measurements.depths_mm).sum()),
        depth_residual_mm=_residual(depths_mm[0], measurements.depths_mm),
        own_young_mpa=own_mpa,
        young_mpa=_bounds(moduli_mpa) if measurements.has_forces else None,
        force_measurements=int(np.isfinite(measurements.forces_n).sum()),
        force_residual_n=_residual(forces_n[0], measurements.forces_n),
    )


def shifted(
    presses: Presses, camera: Camera, tolerance: Tolerance, sign: float
) -> tuple[Presses, Camera]:
    """The presses and camera with every input at one end of its tolerance, which is complete.

    Raises T2TwinError if a ball, scale or modulus is then out of range.
    """
    assert tolerance.scale_px_per_mm is not None and tolerance.young_mpa is not None
    given, own_mpa = presses.measurements, presses.sensor.own_gel.young_mpa
    measurements = Measurements(
        diameters_mm=given.diameters_mm + sign * tolerance.ball_mm,
        depths_mm=np.maximum(given.depths_mm - sign * tolerance.depth_mm, tolerance.depth_mm),
        forces_n=np.maximum(given.forces_n + sign * tolerance.force_n, FORCE_RANGE_N[0]),
    )
    for diameter_mm in measurements.diameters_mm.tolist():
        check_ball(diameter_mm, "the ball's diameter in mm, within its tolerance,", presses.sensor)
    if not given.has_depths:
        scale = camera.scale_px_per_mm + sign * tolerance.scale_px_per_mm
        low, high = scale_range(presses.sensor)
        if not low <= scale <= high:
            raise T2TwinError(
                f"the scale within its tolerance, {scale:g} px/mm, is beyond {low:g} to {high:g} "
                "px/mm"
            )
        camera = replace(camera, scale_px_per_mm=scale)
    if not tolerance.young_mpa < own_mpa:
        raise T2TwinError(
            f"the tolerance of the modulus is {tolerance.young_mpa:g} MPa; it must be less than "
            f"the sensor's modulus, {own_mpa:g} MPa"
        )
    return replace(presses, measurements=measurements), camera


def _estimate(
    presses: Presses, fit: Fit, young_mpa: float
) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Depths and forces (n,), scale and modulus; young_mpa is used where no force is measured."""
    measurements, own_mpa = presses.measurements, presses.sensor.own_gel.young_mpa
    forces_n = ball_forces_n(presses.sensor, fit.state.poses, measurements.diameters_mm)
    if measurements.has_forces:
        young_mpa = own_mpa * force_ratio(measurements.forces_n, forces_n)
    forces_n = forces_n * young_mpa / own_mpa
    return fit.state.poses[:, 2], forces_n, fit.model.camera.scale_px_per_mm, young_mpa


def _bounds(values: Sequence[float] | np.ndarray) -> Bounds:
    """The first of these values, their minimum and their maximum."""
    return Bounds(float(values[0]), float(min(values)), float(max(values)))


def _residual(fitted: np.ndarray, measured: np.ndarray) -> float | None:
    """Root mean square difference where both are finite; None where they never are."""
    residual = (fitted - measured)[np.isfinite(fitted - measured)]
    return float(np.sqrt(np.mean(residual**2))) if residual.size else None


def ball_forces_n(sensor: GelCamera, poses: np.ndarray, diameters_mm: np.ndarray) -> np.ndarray:
    """(n,) N: forces of balls in the gel of a sensor's file; NaN where no allowed force reaches the
    depth.

    poses: (n, 3) x_mm, y_mm, depth_mm.
    """
    forces_n = np.full(len(poses), np.nan)
    for index, (x_mm, y_mm, depth_mm) in enumerate(poses.tolist()):
        shape = ball(float(diameters_mm[index]) / 2)
        command = PressCommand(shape.name, x_mm, y_mm, 0.0, 1.0)
        press = partial(solve_contact, shape, elastomer=sensor.own_gel, pitch_mm=sensor.pitch_mm)
        with suppress(T2TwinError):
            forces_n[index] = force_at_depth(press, command, depth_mm)
    return forces_n


def force_ratio(measured_n: np.ndarray, own_n: np.ndarray) -> float:
    """Modulus of the gel in parts of the sensor's, by least squares over the presses with both
    forces.

    measured_n: (n,), NaN where not measured. own_n: (n,) the twin's at the same depths, in the
    sensor's gel. At a given depth the force of a frictionless contact is proportional to the
    modulus, since the layer's stiffening depends on its strain alone. Raises T2TwinError where no
    press has both.
    """
    both = np.isfinite(measured_n) & np.isfinite(own_n)
    if not both.any():
        raise T2TwinError("no press with a measured force can be pressed that deep in the twin")
    measured, own = measured_n[both], own_n[both]
    return float((measured @ own) / (own @ own))


def uncertainty_table(uncertainty: OpticsUncertainty) -> Table:
    """The bounds of the presses; below, the assumptions: balls, scale, modulus."""
    one, tolerance = uncertainty, uncertainty.tolerance
    rows = [[each.name, *_cells(each.depth_mm), *_cells(each.force_n)] for each in one.presses]
    heads = ["press", "depth, mm", "low", "high", "force, N", "low", "high"]
    scale = (
        f"The scale is {one.scale_px_per_mm.value:g} px/mm within {tolerance.scale_px_per_mm:g}, "
        f"as given; measured displacements in {FORCES} would determine it."
    )
    if one.depth_measurements:
        scale = (
            f"The scale is {_with_bounds(one.scale_px_per_mm)} px/mm, from "
            f"{one.depth_measurements} displacements measured within {tolerance.depth_mm:g} mm; "
            f"their residual is {one.depth_residual_mm:.3f} mm (root mean square)."
        )
    modulus = (
        f"The gel's modulus is the sensor's, {one.own_young_mpa:g} MPa, within "
        f"{tolerance.young_mpa:g}; measured forces in {FORCES} would determine it."
    )
    if one.young_mpa is not None:
        modulus = (
            f"The gel's modulus is {_with_bounds(one.young_mpa)} MPa, from "
            f"{one.force_measurements} forces measured within {tolerance.force_n:g} N; their "
            f"residual is {one.force_residual_n:.2f} N. A twin with these optics has such a gel."
        )
    balls = f"The balls' diameters are assumed to be correct within {tolerance.ball_mm:g} mm."
    return Table(heads, {"": rows}, notes=[balls, scale, modulus])


def _cells(bounds: Bounds | None) -> list[str]:
    return [f"{value:.2f}" for value in vars(bounds).values()] if bounds else [""] * 3


def _with_bounds(bounds: Bounds) -> str:
    return f"{bounds.value:.2f} ({bounds.low:.2f} to {bounds.high:.2f})"
