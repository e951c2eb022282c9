"""t2twin adapt"""

from pathlib import Path
from typing import Annotated

import tyro


def adapt(
    background: Annotated[Path, tyro.conf.arg(metavar="PNG")],
    presses: Annotated[Path, tyro.conf.arg(metavar="DIR")],
    ball_diameter_mm: float,
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("runs/adapted"),
    minutes: float = 60.0,
    model: Annotated[str, tyro.conf.arg(metavar="MODEL")] = "field",
    start: Annotated[Path | None, tyro.conf.arg(metavar="RUN")] = None,
    held_out: Annotated[int | None, tyro.conf.arg(metavar="INT")] = None,
    scale_px_per_mm: float = 19.2,
    ball_tolerance_mm: float = 0.1,
    scale_tolerance_px_per_mm: float = 2.0,
    depth_tolerance_mm: float = 0.03,
    force_tolerance_n: float = 0.05,
    young_tolerance_mpa: float = 0.1,
    workers: Annotated[int | None, tyro.conf.arg(metavar="INT")] = None,
) -> None:
    """Make a translator of your own DIGIT from its background and presses of one ball.

    Fits the light, presses shapes into a twin of that unit, trains on them, and checks the result
    on the presses that the light was not fitted to. Goes on where it was stopped.

    Args:
        background: A frame of the untouched sensor, 240 wide, 320 high or larger, or on its side.
        presses: Folder of frames of the ball pressed in at different places and depths, which
            need not be known. What is known stands in a table in it, forces.csv: a column file, and
            any of force_n, depth_mm (from the first touch) and ball_diameter_mm.
        ball_diameter_mm: The ball's diameter, mm.
        out: Folder for the calibration, the data, the run and the page, index.html.
        minutes: How long all of it may take, about, on two cores.
        model: What is trained: field, resnet18 or touch2touch.
        start: A run of that model, of a wider world, whose weights the training begins with; the
            field that ships unless given.
        held_out: How many presses, the last by name, are kept out to check; a third unless given.
        scale_px_per_mm: Picture scale in the middle of the gel, 17.2 to 19.6 from one unit to
            another; found, where displacements are known.
        ball_tolerance_mm: How far the diameters may be off, mm.
        scale_tolerance_px_per_mm: How far the scale may be off, where no displacements are known.
        depth_tolerance_mm: How far known displacements may be off, mm.
        force_tolerance_n: How far known forces may be off, N.
        young_tolerance_mpa: How far the gel's modulus, 0.5 MPa as assumed, may be off, where no
            forces are known.
        workers: Processes that press at once; as many as there are cores unless given.
    """
    from t2twin.adaptation.pipeline import adapt as walk
    from t2twin.sim.dataset.pool import check_workers
    from t2twin.sim.digit.calibrate.measurements import Tolerance
    from t2twin.sim.digit.calibrate.record import uncertainty_lines
    from t2twin.sim.digit.camera.pinhole import Camera

    check_workers(workers)  # before the fit, which takes minutes
    camera = Camera(scale_px_per_mm)
    tolerance = Tolerance(
        ball_tolerance_mm,
        scale_tolerance_px_per_mm,
        depth_tolerance_mm,
        force_tolerance_n,
        young_tolerance_mpa,
    )
    adapted = walk(
        background, presses, ball_diameter_mm, out, held_out, minutes, camera, model, start,
        workers, tolerance=tolerance,
    )  # fmt: skip
    for line in uncertainty_lines(adapted.certainty):
        print(line)
    real, simulated = adapted.real, adapted.simulated
    shares = ", ".join(f"{name} {spent:.1f}" for name, spent in adapted.minutes.items())
    print(f"minutes: {shares}")
    print(
        f"{adapted.presses} real frames kept out: RMSE {real.rmse_percent:.2f} % of full scale "
        f"(simulated {simulated.rmse_percent:.2f}, no counts {adapted.nothing_rmse_percent:.2f}), "
        f"centroid {real.centroid_mm:.1f} mm off, force {100 * real.force_part:.0f} % off, "
        f"{real.one_blob} felt as one{_held(real.held_percent)}; "
        f"untouched {adapted.untouched_counts:.0f} counts at most"
    )
    print(f"written to {out}: {model}, for translate, calibration.npz, and index.html to look at")


def _held(percent: float | None) -> str:
    return "" if percent is None else f", intervals of 90 % hold {percent:.0f} %"
