"""t2twin adapt"""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from t2twin.cli.calibrate import FitOptions

if TYPE_CHECKING:
    from t2twin.adaptation.record import AdaptationResult


def adapt(
    background: Annotated[Path, tyro.conf.arg(metavar="PNG")],
    presses: Annotated[Path, tyro.conf.arg(metavar="DIR")],
    ball_diameter_mm: float,
    fit: Annotated[FitOptions, tyro.conf.arg(name="")],
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("runs/adapted"),
    minutes: float = 60.0,
    model: Annotated[str, tyro.conf.arg(metavar="MODEL")] = "field",
    init_from: Annotated[Path | None, tyro.conf.arg(metavar="RUN")] = None,
    workers: Annotated[int | None, tyro.conf.arg(metavar="INT")] = None,
) -> None:
    """Adapt a translator to your own DIGIT, from its background frame and presses of one ball.

    Calibrates the optics, simulates presses with them, and trains on these. Evaluates the trained
    and the initial run on the held-out presses, and keeps the better one. The final optics are
    fitted to these too; no network is trained on real frames. Resumes an interrupted adaptation.

    Args:
        background: Frame of the sensor without contact, 240 x 320 or larger, in any orientation.
        presses: Folder of frames of the ball at different, unknown positions and depths. Known
            values belong in its table forces.csv: file, force_n, depth_mm, ball_diameter_mm.
        ball_diameter_mm: Diameter of the ball, mm.
        out: Folder for the calibration, the dataset, the run and the page index.html.
        minutes: Approximate total duration on two cores.
        model: Model to train: field, resnet18 or touch2touch.
        init_from: Run whose weights initialize the training; the pretrained run unless given.
        workers: Processes that press at once; one per core unless given.
    """
    from t2twin.adaptation.pipeline import adapt as run_adaptation
    from t2twin.sim.digit.camera.pinhole import Camera

    result = run_adaptation(
        background, presses, ball_diameter_mm, out, fit.held_out, minutes,
        Camera(fit.scale_px_per_mm), model, init_from, workers, tolerance=fit.tolerance,
    )  # fmt: skip
    _print(result)
    print(f"written to {out}: run {model}, calibration.npz, index.html")


def _print(result: "AdaptationResult") -> None:
    from t2twin.sim.digit.calibrate.uncertainty import uncertainty_lines

    for line in uncertainty_lines(result.uncertainty):
        print(line)
    minutes = ", ".join(f"{name} {spent:.1f}" for name, spent in result.minutes.items())
    print(f"minutes: {minutes}")
    for name, scores in result.runs.items():
        real, percent = scores.real, scores.real.interval_coverage_percent
        coverage = "" if percent is None else f", coverage of 90 % intervals {percent:.0f} %"
        print(
            f"{name} run, {result.presses} held-out presses: RMSE {real.rmse_percent:.2f} % of "
            f"full scale (simulated frames {scores.simulated.rmse_percent:.2f}, zero counts "
            f"{result.zero_rmse_percent:.2f}), centroid error {real.centroid_mm:.1f} mm, force "
            f"error {100 * real.force_error:.0f} %, {real.single_region} with a single contact "
            f"region{coverage}; largest count on the background frame "
            f"{scores.background_counts:.0f}"
        )
    print(f"kept: the {result.kept} run, the more accurate one")
