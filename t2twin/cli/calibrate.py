"""t2twin calibrate"""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

if TYPE_CHECKING:
    import numpy as np

    from t2twin.sim.digit.calibrate.calibrate import CalibrationReport
    from t2twin.sim.digit.camera.pinhole import Camera

FILES = ("calibration_strip.png", "calibration.json", "calibration.npz")
"""What is written into --out where there are presses."""


def calibrate(
    background: Annotated[Path, tyro.conf.arg(metavar="PNG")],
    presses: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None,
    ball_diameter_mm: Annotated[float | None, tyro.conf.arg(metavar="FLOAT")] = None,
    held_out: Annotated[int | None, tyro.conf.arg(metavar="INT")] = None,
    scale_px_per_mm: float = 19.2,
    ball_tolerance_mm: float = 0.1,
    scale_tolerance_px_per_mm: float = 2.0,
    depth_tolerance_mm: float = 0.03,
    force_tolerance_n: float = 0.05,
    young_tolerance_mpa: float = 0.1,
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("runs/calibration"),
) -> None:
    """Fit the DIGIT's light to your own sensor, from its background and presses of one ball.

    From the background alone, without presses, a light is guessed that is far from a fitted one.

    Args:
        background: A frame of the untouched sensor, 240 wide, 320 high or larger, or on its side.
        presses: Folder of frames of the ball pressed in at different places and depths, which
            need not be known. What is known stands in a table in it, forces.csv: a column file, and
            any of force_n, depth_mm (from the first touch) and ball_diameter_mm.
        ball_diameter_mm: The ball's diameter, mm.
        held_out: How many presses, the last by name, are kept out of the fit to score it; a third
            unless given.
        scale_px_per_mm: Picture scale in the middle of the gel, 17.2 to 19.6 from one unit to
            another; found, where displacements are known.
        ball_tolerance_mm: How far the diameters may be off, mm.
        scale_tolerance_px_per_mm: How far the scale may be off, where no displacements are known.
        depth_tolerance_mm: How far known displacements may be off, mm.
        force_tolerance_n: How far known forces may be off, N.
        young_tolerance_mpa: How far the gel's modulus, 0.5 MPa as assumed, may be off, where no
            forces are known.
        out: Folder for calibration.npz and, where there are presses, calibration.json and
            calibration_strip.png.
    """
    from t2twin.core.errors import T2TwinError
    from t2twin.core.files import check_replaceable, locked
    from t2twin.sim.digit.calibrate.calibrate import calibrate as fit
    from t2twin.sim.digit.calibrate.measurements import Tolerance
    from t2twin.sim.digit.camera.pinhole import Camera

    camera = Camera(scale_px_per_mm)
    if presses is None:
        if ball_diameter_mm is not None or held_out is not None:
            raise T2TwinError(
                "--presses is missing, the folder of frames of the ball; the background alone "
                "takes neither --ball-diameter-mm nor --held-out"
            )
        _guess(background, camera, out)
        return
    if ball_diameter_mm is None:
        raise T2TwinError("--ball-diameter-mm is missing: that of the ball of --presses")
    tolerance = Tolerance(
        ball_tolerance_mm,
        scale_tolerance_px_per_mm,
        depth_tolerance_mm,
        force_tolerance_n,
        young_tolerance_mpa,
    )
    with locked(out):
        for name in FILES:  # a fit takes minutes
            check_replaceable(out / name)
        report = fit(background, presses, ball_diameter_mm, held_out, camera, print, tolerance)
        _write(report, out)
    print(f"written to {out}: calibration.npz, for press and simdata as --calibration,")
    print("calibration.json, all that is printed here, and calibration_strip.png, the held-out")
    print("presses: real above, simulated below")


def _guess(background: Path, camera: "Camera", out: Path) -> None:
    from t2twin.core.files import locked
    from t2twin.sim.digit.calibrate.background_light import guess_light

    with locked(out):
        guess_light(background, camera, print).save(out / "calibration.npz")
    print(f"written to {out}: calibration.npz, for press and simdata as --calibration. It is the")
    print("mean light of drawn DIGITs on your background, a guess: presses of a ball make it a fit")


def _write(report: "CalibrationReport", out: Path) -> None:
    """Writes the files, and prints what they hold."""
    import numpy as np
    from PIL import Image

    from t2twin.core.files import atomic_write
    from t2twin.sim.digit.calibrate.record import lines_of, write_record

    strip = np.concatenate([np.concatenate([*row], axis=1) for row in _strip(report)])
    with atomic_write(out / "calibration_strip.png") as temporary:
        Image.fromarray(strip).save(temporary)
    write_record(out / "calibration.json", report)
    report.calibration.save(out / "calibration.npz")
    sure = [] if report.certainty is None else lines_of(report.certainty)
    for line in (*_in_words(report), *sure):
        print(line)


def _strip(report: "CalibrationReport") -> "tuple[np.ndarray, np.ndarray]":
    """The held-out frames, and the simulated ones with one frame's noise, (n, 320, 240, 3) each."""
    import numpy as np

    noise, rng = report.calibration.noise, np.random.default_rng(0)
    if noise is None:
        return report.real, report.simulated
    noisy = [picture + noise.draw(rng) for picture in report.simulated]
    return report.real, np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def _in_words(report: "CalibrationReport") -> list[str]:
    count = len(report.held_out)
    lines = []
    if report.repeated:
        lines.append(f"left out as copies of others: {', '.join(report.repeated)}")
    lines += [
        f"fitted to {report.trained[0]} to {report.trained[-1]}, {len(report.trained)} presses",
        f"scored on {report.held_out[0]} to {report.held_out[-1]}, {count} presses that the fit "
        "did not see; the place and depth",
        "of each is found from its own frame, everything else is as fitted; what is written was",
        "then fitted to all of them",
        "",
        f"{'press':34s} {'x mm':>6s} {'y mm':>6s} {'deep mm':>7s} {'L1':>6s} {'SSIM':>6s} "
        f"{'PSNR dB':>8s}",
    ]
    for name, pose, score in zip(report.held_out, report.poses, report.each, strict=True):
        lines.append(
            f"{name:34s} {pose[0]:6.2f} {pose[1]:6.2f} {pose[2]:7.2f} {score.l1:6.2f} "
            f"{score.ssim:6.3f} {score.psnr_db:8.2f}"
        )
    lines += ["", f"{'mean, contact crop of 100 x 100 px':34s} {'':21s} {'L1':>6s} {'SSIM':>6s} "
              f"{'PSNR dB':>8s}"]  # fmt: skip
    rows = {
        "calibrated": report.scores.calibrated,
        "cut and paste": report.scores.cut_and_paste,
        "do nothing": report.scores.do_nothing,
        "noise floor: one press, two frames": report.scores.repeats_floor,
        "noise floor: two frames, away": report.scores.untouched_floor,
    }
    for name, score in rows.items():
        if score is None:
            continue
        lines.append(f"{name:34s} {'':21s} {score.l1:6.2f} {score.ssim:6.3f} {score.psnr_db:8.2f}")
    return [*lines, ""]
