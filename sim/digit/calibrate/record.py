"""calibration.json, and the printed summary of a calibration's uncertainty."""

from dataclasses import asdict
from pathlib import Path

from t2twin.core.files import write_json
from t2twin.sim.contact.elastomer import DIGIT_GEL
from t2twin.sim.digit.calibrate.calibrate import CalibrationReport
from t2twin.sim.digit.calibrate.measurements import FORCES
from t2twin.sim.digit.calibrate.uncertainty import Bounds, CalibrationUncertainty

FORMAT = 1


def write_record(path: Path, report: CalibrationReport) -> None:
    """Write calibration.json: names, scores, each held-out press, the uncertainty.

    Raises T2TwinError where it cannot be written.
    """
    held_out = [
        {"name": name, "x_mm": pose[0], "y_mm": pose[1], "depth_mm": pose[2], **asdict(score)}
        for name, pose, score in zip(
            report.held_out, report.poses.tolist(), report.each, strict=True
        )
    ]
    content = {
        "format": FORMAT,
        "trained": report.trained,
        "repeated": report.repeated,
        "held_out": held_out,
        "scores": asdict(report.scores),
        "uncertainty": None if report.uncertainty is None else asdict(report.uncertainty),
    }
    write_json(path, content)


def uncertainty_lines(uncertainty: CalibrationUncertainty) -> list[str]:
    """The summary: sentences and a table of the presses, one line each."""
    lines = [
        *uncertainty_sentences(uncertainty),
        "",
        f"{'press':34s} {'deep mm':>7s} {'from':>6s} {'to':>6s} {'force N':>8s} {'from':>6s} "
        f"{'to':>6s}",
    ]
    for press in uncertainty.presses:
        depth, force = press.depth_mm, press.force_n
        line = f"{press.name:34s} {depth.value:7.2f} {depth.low:6.2f} {depth.high:6.2f}"
        if force is not None:
            line += f" {force.value:8.2f} {force.low:6.2f} {force.high:6.2f}"
        lines.append(line)
    return [*lines, ""]


def uncertainty_sentences(uncertainty: CalibrationUncertainty) -> list[str]:
    """The assumptions of the bounds: balls, scale, modulus."""
    ball_mm = uncertainty.tolerance.ball_mm
    balls = f"The balls' diameters are assumed to be correct within {ball_mm:g} mm."
    return [balls, _scale_sentence(uncertainty), _modulus_sentence(uncertainty)]


def _scale_sentence(uncertainty: CalibrationUncertainty) -> str:
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


def _modulus_sentence(uncertainty: CalibrationUncertainty) -> str:
    young, tolerance = uncertainty.young_mpa, uncertainty.tolerance
    if young is None:
        return (
            f"The gel's modulus is the default, {DIGIT_GEL.young_mpa:g} MPa, within "
            f"{tolerance.young_mpa:g}; measured forces in {FORCES} would determine it."
        )
    return (
        f"The gel's modulus is {_with_bounds(young)} MPa, from {uncertainty.force_measurements} "
        f"forces measured within {tolerance.force_n:g} N; their residual is "
        f"{uncertainty.force_residual_n:.2f} N. A DIGIT with this calibration has such a gel."
    )


def _with_bounds(bounds: Bounds) -> str:
    return f"{bounds.value:.2f} ({bounds.low:.2f} to {bounds.high:.2f})"
