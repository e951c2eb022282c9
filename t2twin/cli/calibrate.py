"""t2twin calibrate, t2twin adapt"""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from msgspec import structs

from t2twin.core.frame_order import UPRIGHT, FrameOrder
from t2twin.sim.sensors.defaults import SOURCE

if TYPE_CHECKING:
    from t2twin.sim.calibrate.calibrate import OpticsReport, Tolerance
    from t2twin.sim.calibrate.frames import Score
    from t2twin.sim.optical.camera import Camera


@dataclass(frozen=True)
class FitOptions:
    """Options of a fit to presses, of `t2twin calibrate` and `t2twin adapt`.

    Args:
        background: A background frame of the unit, in the size of the sensor's images or larger.
        sensor: Gel camera: a bundled name or a .toml file, whose gel, camera and LEDs hold.
        held_out: Number of presses, the last by name, that are scored and not fitted; default:
            those at a third of the places.
        scale_px_per_mm: Image scale in the middle of the gel; default: of the sensor's file. It is
            fitted if displacements are measured.
        ball_tolerance_mm: Largest error of the diameters, mm; default: 0.1.
        scale_tolerance_px_per_mm: Largest error of the scale, without measured displacements;
            default: as far as the sensor's file lets units differ, or a tenth.
        depth_tolerance_mm: Largest error of measured displacements, mm; default: 0.03.
        force_tolerance_n: Largest error of measured forces, N; default: 0.05.
        young_tolerance_mpa: Largest error of the modulus in the sensor's file, without measured
            forces; default: a fifth.
    """

    background: Path
    sensor: str = SOURCE
    held_out: int | None = None
    scale_px_per_mm: float | None = None
    ball_tolerance_mm: float | None = None
    scale_tolerance_px_per_mm: float | None = None
    depth_tolerance_mm: float | None = None
    force_tolerance_n: float | None = None
    young_tolerance_mpa: float | None = None
    order: Annotated[FrameOrder, tyro.conf.arg(name="")] = UPRIGHT

    @property
    def own_tolerances(self) -> dict[str, float]:
        """The given tolerances, by the name of the option."""
        given = {name: value for name, value in vars(self).items() if value is not None}
        return {name: value for name, value in given.items() if "_tolerance_" in name}

    @property
    def tolerance(self) -> "Tolerance":
        """The tolerances. Raises T2TwinError for a value that is negative or not finite."""
        from t2twin.sim.calibrate.calibrate import Tolerance

        given = self.own_tolerances.items()
        return Tolerance(**{name.replace("_tolerance", ""): value for name, value in given})

    @property
    def camera(self) -> "Camera":
        """The camera of the sensor with the given scale."""
        from t2twin.sim.calibrate.calibrate import sensor_and_camera

        _, camera = sensor_and_camera(self.sensor, None)
        if self.scale_px_per_mm is None:
            return camera
        return structs.replace(camera, scale_px_per_mm=self.scale_px_per_mm)


def calibrate(
    fit: Annotated[FitOptions, tyro.conf.arg(name="")],
    presses: Path | None = None,
    ball_diameter_mm: float | None = None,
    out: Path = Path("runs/optics"),
) -> None:
    """Fit a gel camera's light to your unit, from its background and presses of one ball.

    From the background alone, without presses, the light is a rough guess.

    Args:
        presses: Folder of frames of the ball at different places and depths, which need not be
            known. Measurements are read from a table in it, forces.csv: a column file, and any of
            force_n, depth_mm (from first contact) and ball_diameter_mm.
        ball_diameter_mm: The ball's diameter, mm.
        out: Folder for optics.npz and, with presses, optics.json, optics_strip.png and
            optics_coverage.png, which shows the part of the image that no contact covers.
    """
    from t2twin.core.errors import T2TwinError
    from t2twin.core.files import result_folder
    from t2twin.optics_fit import calibrate as calibrate_optics
    from t2twin.optics_fit import guess_light

    of_fit = {"ball_diameter_mm": ball_diameter_mm, "held_out": fit.held_out, **fit.own_tolerances}
    given = [name.replace("_", "-") for name, value in of_fit.items() if value is not None]
    if presses is None and given:
        raise T2TwinError(f"--{given[0]} is of a fit, which needs --presses")
    if presses is not None and ball_diameter_mm is None:
        raise T2TwinError("--presses needs --ball-diameter-mm")
    background, camera, sensor = fit.background, fit.camera, fit.sensor
    names = ["optics.npz"]
    if presses is not None:
        names += ["optics.json", "optics_strip.png", "optics_coverage.png"]
    frames = [] if presses is None else list(presses.glob("*"))
    with result_folder(out, "calibration", names, frames) as folder:
        if presses is None or ball_diameter_mm is None:
            guess_light(background, camera, print, sensor, fit.order).save(folder / "optics.npz")
            print(f"written to {out}: optics.npz, for press and simdata as --optics. It has your")
            print("background and the mean light of sampled units; a fit needs presses of a ball")
            return
        report = calibrate_optics(
            background, presses, ball_diameter_mm, fit.held_out, camera, print, fit.tolerance,
            sensor, fit.order,
        )  # fmt: skip
        _write(report, folder, sensor)
    print(f"written to {out}: optics.npz, for press and simdata as --optics;")
    print("optics.json, the printed results; optics_strip.png, the held-out presses:")
    print("real above, simulated below; optics_coverage.png, all presses and what they leave bare")


def _write(report: "OpticsReport", out: Path, sensor: str) -> None:
    """Write the files and print the results.

    The strip has the held-out frames above, and the simulated ones with one frame's noise below.
    """
    import numpy as np
    from PIL import Image

    from t2twin.core.tables import Table, text
    from t2twin.sim.calibrate.calibrate import sensor_and_camera, uncertainty_table, write_fit
    from t2twin.sim.calibrate.frames import coverage_sentences

    simulated, noise, rng = report.simulated, report.optics.noise, np.random.default_rng(0)
    if noise is not None:
        noisy = [image + noise.sample(rng, *image.shape[:2]) for image in simulated]
        simulated = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
    strip = np.concatenate([np.concatenate(row, axis=1) for row in (report.real, simulated)])
    Image.fromarray(strip).save(out / "optics_strip.png")
    gel_camera, _ = sensor_and_camera(sensor, None)
    write_fit(out, report, gel_camera.own_gel)
    if report.repeated:
        print(f"excluded duplicates: {', '.join(report.repeated)}")
    print(
        f"fitted to {len(report.trained)} presses, scored on {len(report.held_out)} held-out ones;"
    )
    print("the pose of each is fitted to its own frame; the written optics are fitted to all\n")
    heads = ("press", "x mm", "y mm", "deep mm", "L1", "SSIM", "PSNR dB")
    presses = [[press.name, f"{press.x_mm:.2f}", f"{press.y_mm:.2f}", f"{press.depth_mm:.2f}",
                *_cells(press)] for press in report.held_out]  # fmt: skip
    means = [[name.replace("_", " "), "", "", "", *_cells(score)]
             for name, score in report.scores.items()]  # fmt: skip
    groups = {"": presses, "mean, contact crop of 100 x 100 px:": means}
    print(text(Table(heads, groups)), end="\n\n")
    if report.uncertainty is not None:
        print(text(uncertainty_table(report.uncertainty)), end="\n\n")
    print(*coverage_sentences(report.covered, report.next_mm), sep="\n", end="\n\n")


def _cells(score: "Score") -> list[str]:
    return [f"{score.l1:.2f}", f"{score.ssim:.3f}", f"{score.psnr_db:.2f}"]


def adapt(
    presses: Path,
    ball_diameter_mm: float,
    fit: Annotated[FitOptions, tyro.conf.arg(name="")],
    out: Path = Path("runs/adapted"),
    minutes: float = 20.0,
    model: str = "field",
    init_from: Path | None = None,
    workers: int | None = None,
) -> None:
    """Adapt a translator to your own gel camera, from its background frame and presses of one ball.

    Calibrates the optics, simulates presses with them, and trains on these. Evaluates the trained
    and the initial run on the held-out presses, and keeps the better one. The final optics are
    fitted to these too; no network is trained on real frames. Resumes an interrupted adaptation.

    Args:
        presses: Folder of frames of the ball at different, unknown positions and depths. Known
            values belong in its table forces.csv: file, force_n, depth_mm, ball_diameter_mm.
        ball_diameter_mm: Diameter of the ball, mm.
        out: Folder for the optics, the dataset, the run and the page index.html.
        minutes: Approximate duration on two cores, without the frame check and the evaluation.
        model: Model to train: field, resnet18 or touch2touch.
        init_from: Run whose weights initialize the training; the pretrained run unless given.
        workers: Processes that press at once; one per core unless given.
    """
    from t2twin.adaptation.pipeline import adapt as run_adaptation
    from t2twin.adaptation.real_frame_evaluation import scores_table
    from t2twin.core.tables import text
    from t2twin.sim.calibrate.calibrate import uncertainty_table

    result = run_adaptation(
        fit.background, presses, ball_diameter_mm, out, fit.held_out, minutes,
        fit.camera, model, init_from, workers, tolerance=fit.tolerance, sensor=fit.sensor,
        order=fit.order,
    )  # fmt: skip
    print(text(uncertainty_table(result.uncertainty)), end="\n\n")
    spent = ", ".join(f"{name} {each:.1f}" for name, each in result.minutes.items())
    print(f"minutes: {spent}\n{result.presses} held-out presses:")
    print(text(scores_table(result)))
    print(f"RMSE of zero counts: {result.zero_rmse_percent:.2f} %")
    for name, counts in result.background_counts.items():
        print(f"largest count on the background frame, {name} run: {counts:.0f}")
    print(f"kept: the {result.kept} run")
    print(f"written to {out}: run {model}, optics.npz, index.html")
