"""What a calibration came to, as calibration.json holds it."""

from dataclasses import asdict
from pathlib import Path

import msgspec

from t2twin.primitives_cad.writing import whole_file
from t2twin.sim.digit.calibrate.calibrate import CalibrationReport

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
    with whole_file(path) as temporary:
        temporary.write_bytes(msgspec.json.format(msgspec.json.encode(content), indent=1))
