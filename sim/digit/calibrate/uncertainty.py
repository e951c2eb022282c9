"""What a ball's frames leave open: ranges of depth and force, from stated tolerances.

Frames fit almost as well with a smaller ball or at a smaller scale, pressed deeper, as with a
larger one. So everything is fitted twice more, where all that is stated is off so that presses come
out deepest, and so that they come out shallowest.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.elastomer import DIGIT_GEL
from t2twin.sim.contact.types import FORCE_RANGE_N
from t2twin.sim.digit.calibrate.forces import BallForces, fitted_young_mpa
from t2twin.sim.digit.calibrate.measurements import Measurements, Tolerance, check_ball
from t2twin.sim.digit.calibrate.scale import SCALES_PX_PER_MM, Fit, Presses, fitted
from t2twin.sim.digit.camera.pinhole import Camera

SHALLOWEST, DEEPEST = 1.0, -1.0
"""Signs of the balls' and the scale's errors with which presses come out so."""


@dataclass(frozen=True)
class Bounds:
    """A value, and the range in which the truth lies if what is stated is right."""

    at: float
    low: float
    high: float


@dataclass(frozen=True)
class PressSpans:
    """A press, as found in its frame, in the fit to all. Forces are the twin's for the depth, in a
    gel of the fitted modulus, or of the assumed one; None where the twin goes not so deep."""

    name: str
    ball_diameter_mm: float
    depth_mm: Bounds
    force_n: Bounds | None


@dataclass(frozen=True)
class CalibrationUncertainty:
    """What follows from tolerances and anchors.

    presses: by their names. scale_px_per_mm: as stated, or, where depths_known is not 0, as that
    many displacements ask for; depth_off_mm: root mean square by which those are missed. young_mpa:
    the gel's modulus from forces_known forces; force_off_n: the same of them. None where none are
    known.
    """

    tolerance: Tolerance
    presses: tuple[PressSpans, ...]
    scale_px_per_mm: Bounds
    depths_known: int
    depth_off_mm: float | None
    young_mpa: Bounds | None
    forces_known: int
    force_off_n: float | None


@dataclass(frozen=True)
class _End:
    """One end of the ranges. depths_mm, forces_n: (n,), the latter NaN where there is none."""

    depths_mm: np.ndarray
    forces_n: np.ndarray
    scale_px_per_mm: float
    young_mpa: float


def check_tolerance(known: Measurements, camera: Camera, tolerance: Tolerance) -> None:
    """Raises T2TwinError where a ball, a scale or a modulus within its tolerance could not be."""
    for diameter_mm in known.diameters_mm:
        check_ball(float(diameter_mm) - tolerance.ball_mm)
        check_ball(float(diameter_mm) + tolerance.ball_mm)
    scale, off = camera.scale_px_per_mm, tolerance.scale_px_per_mm
    if off and not SCALES_PX_PER_MM[0] <= scale - off <= scale + off <= SCALES_PX_PER_MM[1]:
        raise T2TwinError(
            f"a scale of {scale:g} px/mm, {off:g} either way, reaches beyond "
            f"{SCALES_PX_PER_MM[0]:g} to {SCALES_PX_PER_MM[1]:g} px/mm"
        )
    if not tolerance.young_mpa < DIGIT_GEL.young_mpa:
        raise T2TwinError(
            f"the modulus is {DIGIT_GEL.young_mpa:g} MPa as assumed; its tolerance, "
            f"{tolerance.young_mpa:g} MPa, must be less"
        )


def certainty_of(
    presses: Presses,
    names: list[str],
    fit: Fit,
    tolerance: Tolerance,
    say: Callable[[str], object],
) -> CalibrationUncertainty:
    """Of a fit to all presses, (n,) names. say: told how far it is."""
    forces = BallForces()
    middle = _end(presses.known, fit, forces, DIGIT_GEL.young_mpa)
    ends = [middle]
    for sign, word in ((DEEPEST, "deepest"), (SHALLOWEST, "shallowest")):
        say(f"fitting within the tolerances, {word}")
        off, camera = _off(presses, fit.model.camera, tolerance, sign)
        young_mpa = DIGIT_GEL.young_mpa - sign * tolerance.young_mpa
        ends.append(_end(off.known, fitted(off, camera, fit.state), forces, young_mpa))
    known = presses.known
    return CalibrationUncertainty(
        tolerance=tolerance,
        presses=tuple(
            PressSpans(
                name,
                float(known.diameters_mm[i]),
                _span([end.depths_mm[i] for end in ends]),
                _force_span([end.forces_n[i] for end in ends]),
            )
            for i, name in enumerate(names)
        ),
        scale_px_per_mm=_span([end.scale_px_per_mm for end in ends]),
        depths_known=int(np.isfinite(known.depths_mm).sum()),
        depth_off_mm=_off_by(middle.depths_mm, known.depths_mm),
        young_mpa=_span([end.young_mpa for end in ends]) if known.has_forces else None,
        forces_known=int(np.isfinite(known.forces_n).sum()),
        force_off_n=_off_by(middle.forces_n, known.forces_n),
    )


def _off(
    presses: Presses, camera: Camera, tolerance: Tolerance, sign: float
) -> tuple[Presses, Camera]:
    """The same presses and camera if all that is stated were off by its tolerance."""
    known = presses.known
    off = Measurements(
        diameters_mm=known.diameters_mm + sign * tolerance.ball_mm,
        depths_mm=np.maximum(known.depths_mm - sign * tolerance.depth_mm, tolerance.depth_mm),
        forces_n=np.maximum(known.forces_n + sign * tolerance.force_n, FORCE_RANGE_N[0]),
    )
    if not known.has_depths:
        scale = camera.scale_px_per_mm + sign * tolerance.scale_px_per_mm
        camera = replace(camera, scale_px_per_mm=scale)
    return replace(presses, known=off), camera


def _end(known: Measurements, fit: Fit, forces: BallForces, young_mpa: float) -> _End:
    """young_mpa: taken where no force is known."""
    forces_n = forces.of(fit.state.poses, known.diameters_mm)
    if known.has_forces:
        young_mpa = fitted_young_mpa(known.forces_n, forces_n)
    forces_n = forces_n * young_mpa / DIGIT_GEL.young_mpa
    return _End(fit.depths_mm, forces_n, fit.model.camera.scale_px_per_mm, young_mpa)


def _span(values: list[float]) -> Bounds:
    """The first of these values, and the least and the greatest."""
    return Bounds(float(values[0]), float(min(values)), float(max(values)))


def _force_span(values: list[float]) -> Bounds | None:
    return _span(values) if np.isfinite(values).all() else None


def _off_by(found: np.ndarray, known: np.ndarray) -> float | None:
    """Root mean square of what is found of what is known; None where nothing is."""
    off = (found - known)[np.isfinite(found - known)]
    return float(np.sqrt(np.mean(off**2))) if off.size else None
