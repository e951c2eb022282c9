"""What a calibration came to, as calibration.json holds it.

How sure a calibration's depths and forces are, in words.
"""

from dataclasses import asdict
from pathlib import Path

import msgspec

from t2twin.core.files import atomic_write
from t2twin.sim.contact.elastomer import DIGIT_GEL
from t2twin.sim.digit.calibrate.calibrate import CalibrationReport
from t2twin.sim.digit.calibrate.measurements import FORCES
from t2twin.sim.digit.calibrate.uncertainty import Bounds, CalibrationUncertainty

FORMAT = 1


def write_record(path: Path, report: CalibrationReport) -> None:
    """Names, scores, each held-out press, and the ranges. Raises T2TwinError where it cannot be
    written."""
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
        "certainty": None if report.certainty is None else asdict(report.certainty),
    }
    with atomic_write(path) as temporary:
        temporary.write_bytes(msgspec.json.format(msgspec.json.encode(content), indent=1))


def lines_of(certainty: CalibrationUncertainty) -> list[str]:
    """Sentences, and a table of the presses, a string a line."""
    lines = [
        *sentences_of(certainty),
        "",
        f"{'press':34s} {'deep mm':>7s} {'from':>6s} {'to':>6s} {'force N':>8s} {'from':>6s} "
        f"{'to':>6s}",
    ]
    for press in certainty.presses:
        depth, force = press.depth_mm, press.force_n
        line = f"{press.name:34s} {depth.at:7.2f} {depth.low:6.2f} {depth.high:6.2f}"
        if force is not None:
            line += f" {force.at:8.2f} {force.low:6.2f} {force.high:6.2f}"
        lines.append(line)
    return [*lines, ""]


def sentences_of(certainty: CalibrationUncertainty) -> list[str]:
    """On what the ranges rest."""
    ball_mm = certainty.tolerance.ball_mm
    balls = f"The balls' diameters are taken to be right within {ball_mm:g} mm."
    return [balls, _of_scale(certainty), _of_modulus(certainty)]


def _of_scale(certainty: CalibrationUncertainty) -> str:
    scale, tolerance = certainty.scale_px_per_mm, certainty.tolerance
    if not certainty.depths_known:
        return (
            f"The scale is {scale.at:g} px/mm, within {tolerance.scale_px_per_mm:g}, as stated; "
            f"known displacements in {FORCES} would settle it."
        )
    return (
        f"The scale is {_ranged(scale)} px/mm by {certainty.depths_known} displacements known "
        f"within {tolerance.depth_mm:g} mm, which are missed by {certainty.depth_off_mm:.3f} mm "
        "(root mean square)."
    )


def _of_modulus(certainty: CalibrationUncertainty) -> str:
    young, tolerance = certainty.young_mpa, certainty.tolerance
    if young is None:
        return (
            f"The gel's modulus is {DIGIT_GEL.young_mpa:g} MPa, within {tolerance.young_mpa:g}, as "
            f"assumed; known forces in {FORCES} would settle it."
        )
    return (
        f"The gel's modulus is {_ranged(young)} MPa by {certainty.forces_known} forces known "
        f"within {tolerance.force_n:g} N, which are missed by {certainty.force_off_n:.2f} N; "
        "presses into this calibration's DIGIT are into such a gel."
    )


def _ranged(span: Bounds) -> str:
    return f"{span.at:.2f} ({span.low:.2f} to {span.high:.2f})"
