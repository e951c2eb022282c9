"""Bounds of the presses' depths and forces, from the tolerances of the inputs.

Frames fit almost as well with a smaller ball, or at a smaller scale, pressed deeper. So all presses
are fitted twice more: with all inputs at the end of their tolerances where presses come out
deepest, and at the end where they come out shallowest.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.core.tables import Table
from t2twin.primitives_cad.shape import ball
from t2twin.sim.calibrate.fit import Measurements, Presses
from t2twin.sim.calibrate.measurements import (
    FORCES,
    Fit,
    Tolerance,
    check_ball,
    fit_presses,
    scale_range,
)
from t2twin.sim.contact.contact_solver import force_at_depth, solve_contact
from t2twin.sim.contact.types import FORCE_RANGE_N, PressCommand
from t2twin.sim.optical.camera.pinhole import Camera
from t2twin.sim.optical.gel_camera import GelCamera

SHALLOWEST, DEEPEST = 1.0, -1.0
"""Signs of the errors of ball diameter and scale that give such depths."""


@dataclass(frozen=True)
class Bounds:
    """A value, and the bounds of the true value if all errors are within the tolerances."""

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


@dataclass(frozen=True)
class _Estimate:
    """Result of one fit. depths_mm, forces_n: (n,), the latter NaN where there is none."""

    depths_mm: np.ndarray
    forces_n: np.ndarray
    scale_px_per_mm: float
    young_mpa: float


def check_tolerance(
    measurements: Measurements, sensor: GelCamera, camera: Camera, tolerance: Tolerance
) -> None:
    """Raises T2TwinError if a ball, scale or modulus within its tolerance would be out of range."""
    for diameter_mm in measurements.diameters_mm.tolist():
        for error_mm in (-tolerance.ball_mm, tolerance.ball_mm):
            check_ball(diameter_mm + error_mm, "the ball's diameter in mm", sensor)
    scale, error, young_mpa = camera.scale_px_per_mm, tolerance.scale_px_per_mm, tolerance.young_mpa
    assert error is not None and young_mpa is not None
    low, high = scale_range(sensor)
    if error and not low <= scale - error <= scale + error <= high:
        raise T2TwinError(
            f"a scale of {scale:g} px/mm, {error:g} either way, reaches beyond {low:g} to {high:g} "
            "px/mm"
        )
    if not young_mpa < sensor.own_gel.young_mpa:
        raise T2TwinError(
            f"the tolerance of the modulus is {young_mpa:g} MPa; it must be less than the sensor's "
            f"modulus, {sensor.own_gel.young_mpa:g} MPa"
        )


def estimate_uncertainty(
    presses: Presses,
    names: list[str],
    fit: Fit,
    tolerance: Tolerance,
    report: Callable[[str], object],
) -> OpticsUncertainty:
    """Bounds around a fit to all presses, (n,) names.

    tolerance: complete. report: called with progress messages. Raises T2TwinError where the presses
    cannot be fitted within the tolerances.
    """
    measurements, sensor = presses.measurements, presses.sensor
    assert tolerance.young_mpa is not None
    own_mpa = sensor.own_gel.young_mpa
    nominal = _estimate(presses, fit, own_mpa)
    estimates = [nominal]
    for sign, word in ((DEEPEST, "deepest"), (SHALLOWEST, "shallowest")):
        report(f"fitting within the tolerances, {word}")
        shifted, camera = _shifted(presses, fit.model.camera, tolerance, sign)
        try:
            shifted_fit = fit_presses(shifted, camera, fit.state)
        except T2TwinError as error:
            raise T2TwinError(
                f"with all inputs at the end of their tolerances where presses are {word}, "
                f"{error}; or give smaller tolerances"
            ) from error
        estimates.append(_estimate(shifted, shifted_fit, own_mpa - sign * tolerance.young_mpa))
    depths_mm, forces_n = (
        np.array([getattr(each, name) for each in estimates]) for name in ("depths_mm", "forces_n")
    )
    press_bounds = (
        PressBounds(
            name,
            float(measurements.diameters_mm[i]),
            _bounds(depths_mm[:, i]),
            _bounds(forces_n[:, i]) if np.isfinite(forces_n[:, i]).all() else None,
        )
        for i, name in enumerate(names)
    )
    return OpticsUncertainty(
        tolerance=tolerance,
        presses=tuple(press_bounds),
        scale_px_per_mm=_bounds([each.scale_px_per_mm for each in estimates]),
        depth_measurements=int(np.isfinite(measurements.depths_mm).sum()),
        depth_residual_mm=_residual(nominal.depths_mm, measurements.depths_mm),
        own_young_mpa=own_mpa,
        young_mpa=(
            _bounds([each.young_mpa for each in estimates]) if measurements.has_forces else None
        ),
        force_measurements=int(np.isfinite(measurements.forces_n).sum()),
        force_residual_n=_residual(nominal.forces_n, measurements.forces_n),
    )


def _shifted(
    presses: Presses, camera: Camera, tolerance: Tolerance, sign: float
) -> tuple[Presses, Camera]:
    """The presses and camera with every input at one end of its tolerance."""
    given = presses.measurements
    measurements = Measurements(
        diameters_mm=given.diameters_mm + sign * tolerance.ball_mm,
        depths_mm=np.maximum(given.depths_mm - sign * tolerance.depth_mm, tolerance.depth_mm),
        forces_n=np.maximum(given.forces_n + sign * tolerance.force_n, FORCE_RANGE_N[0]),
    )
    if not given.has_depths:
        assert tolerance.scale_px_per_mm is not None
        scale = camera.scale_px_per_mm + sign * tolerance.scale_px_per_mm
        camera = replace(camera, scale_px_per_mm=scale)
    return replace(presses, measurements=measurements), camera


def _estimate(presses: Presses, fit: Fit, young_mpa: float) -> _Estimate:
    """young_mpa: used where no force is measured."""
    measurements, own_mpa = presses.measurements, presses.sensor.own_gel.young_mpa
    forces_n = ball_forces_n(presses.sensor, fit.state.poses, measurements.diameters_mm)
    if measurements.has_forces:
        young_mpa = own_mpa * force_ratio(measurements.forces_n, forces_n)
    forces_n = forces_n * young_mpa / own_mpa
    return _Estimate(fit.depths_mm, forces_n, fit.model.camera.scale_px_per_mm, young_mpa)


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
    each = zip(poses, diameters_mm.tolist(), strict=True)
    return np.array([_force_n(sensor, pose, diameter_mm) for pose, diameter_mm in each])


def _force_n(sensor: GelCamera, pose: np.ndarray, diameter_mm: float) -> float:
    shape = ball(diameter_mm / 2)
    command = PressCommand(shape.name, float(pose[0]), float(pose[1]), 0.0, 1.0)
    press = partial(solve_contact, shape, elastomer=sensor.own_gel, pitch_mm=sensor.pitch_mm)
    try:
        return force_at_depth(press, command, float(pose[2]))
    except T2TwinError:
        return float("nan")


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
    rows = [[each.name, *_cells(each.depth_mm), *_cells(each.force_n)]
            for each in uncertainty.presses]  # fmt: skip
    heads = ["press", "depth, mm", "low", "high", "force, N", "low", "high"]
    ball_mm = uncertainty.tolerance.ball_mm
    balls = f"The balls' diameters are assumed to be correct within {ball_mm:g} mm."
    notes = [balls, _scale_sentence(uncertainty), _modulus_sentence(uncertainty)]
    return Table(heads, {"": rows}, notes=notes)


def _cells(bounds: Bounds | None) -> list[str]:
    values = (bounds.value, bounds.low, bounds.high) if bounds else ()
    return [f"{value:.2f}" for value in values] or [""] * 3


def _scale_sentence(uncertainty: OpticsUncertainty) -> str:
    scale, tolerance = uncertainty.scale_px_per_mm, uncertainty.tolerance
    if not uncertainty.depth_measurements:
        return (
            f"The scale is {scale.value:g} px/mm within {tolerance.scale_px_per_mm:g}, as given; "
            f"measured displacements in {FORCES} would determine it."
        )
    return (
        f"The scale is {_with_bounds(scale)} px/mm, from {uncertainty.depth_measurements} "
        f"displacements measured within {tolerance.depth_mm:g} mm; their residual is "
        f"{uncertainty.depth_residual_mm:.3f} mm (root mean square)."
    )


def _modulus_sentence(uncertainty: OpticsUncertainty) -> str:
    young, tolerance = uncertainty.young_mpa, uncertainty.tolerance
    if young is None:
        return (
            f"The gel's modulus is the sensor's, {uncertainty.own_young_mpa:g} MPa, within "
            f"{tolerance.young_mpa:g}; measured forces in {FORCES} would determine it."
        )
    return (
        f"The gel's modulus is {_with_bounds(young)} MPa, from {uncertainty.force_measurements} "
        f"forces measured within {tolerance.force_n:g} N; their residual is "
        f"{uncertainty.force_residual_n:.2f} N. A twin with these optics has such a gel."
    )


def _with_bounds(bounds: Bounds) -> str:
    return f"{bounds.value:.2f} ({bounds.low:.2f} to {bounds.high:.2f})"
