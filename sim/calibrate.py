"""Calibration of a gel camera: its optics from frames of a user's unit."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import cast

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.sim.optical.calibrate.calibrate import (
    UNIT_COUNT,
    OpticsReport,
    evaluate,
    fit_all,
    mean_light,
    read_inputs,
    sample_lights,
)
from t2twin.sim.optical.calibrate.frames import read_frame, upright_frame
from t2twin.sim.optical.calibrate.measurements import Tolerance, fit_presses
from t2twin.sim.optical.camera.pinhole import Camera
from t2twin.sim.optical.gel_camera import GelCamera
from t2twin.sim.optical.optics import Optics
from t2twin.sim.optical.spec import KIND
from t2twin.sim.sensors.defaults import SOURCE
from t2twin.sim.sensors.files import load_sensor

DEFAULT_TOLERANCE = Tolerance()


def calibrate(
    background: str | Path,
    presses: str | Path,
    ball_diameter_mm: float,
    held_out: int | None = None,
    camera: Camera | None = None,
    report: Callable[[str], object] = lambda line: None,
    tolerance: Tolerance | None = DEFAULT_TOLERANCE,
    sensor: str | Path | GelCamera = SOURCE,
) -> OpticsReport:
    """Fit the presses, score on the last held_out of them by name, then fit all of them.

    background: a background frame. presses: folder of frames of a ball, in the size of the sensor's
    images, PNG or JPEG, and optionally `forces.csv` (see measurements). camera: its scale and
    distance; None for those of the sensor; measured displacements replace the scale. report: called
    with progress messages. tolerance: of the inputs; None skips the uncertainty, which takes most
    of the time, and the gel's modulus. sensor: a gel camera, by name or file; its record has the
    images' size, the gel, the camera, and the LEDs from which the fit starts.
    Frames that equal an earlier one are excluded.
    Raises T2TwinError for invalid frames or numbers, and for a fit no better than the background.
    """
    own, camera = sensor_and_camera(sensor, camera)
    if held_out is not None:
        arguments.whole_number(held_out, "held_out")
    if tolerance is not None:
        arguments.instance(tolerance, "tolerance", Tolerance)
    arguments.function(report, "report")
    inputs = read_inputs(
        arguments.path(background, "background"), arguments.path(presses, "presses"),
        ball_diameter_mm, held_out, own, camera, tolerance,
    )  # fmt: skip
    report(f"fitting to {len(inputs.train)} presses")
    training = inputs.presses(inputs.train)
    fit = fit_presses(training, camera)
    evaluated = evaluate(inputs, training, fit)
    optics, uncertainty = fit_all(inputs, fit, tolerance, report)
    return replace(evaluated, optics=optics, uncertainty=uncertainty)


def guess_light(
    background: str | Path,
    camera: Camera | None = None,
    report: Callable[[str], object] = lambda line: None,
    sensor: str | Path | GelCamera = SOURCE,
) -> Optics:
    """An optics file with the user's background and the mean light of sampled units.

    background: a background frame, in the size of the sensor's images, PNG or JPEG, whose noise is
    kept. camera: scale and distance, which a frame does not determine; None for those of the
    sensor. report: called with progress messages. sensor: as for `calibrate`.
    Raises T2TwinError for an invalid frame, and for a sensor whose units cannot be sampled.
    """
    own, camera = sensor_and_camera(sensor, camera)
    arguments.function(report, "report")
    frame = upright_frame(read_frame(arguments.path(background, "background")), camera)
    if not own.spec.light.leds or own.spec.units is None:
        raise T2TwinError(
            f"the file of {own.name} has no {'table [units]' if own.spec.light.leds else 'LEDs'}, "
            "from which light is sampled for a background alone; give presses of a ball"
        )
    report(f"sampling {UNIT_COUNT} units of {own.name}, some seconds")
    return mean_light(sample_lights(frame, own, camera))


def sensor_and_camera(
    sensor: str | Path | GelCamera, camera: Camera | None
) -> tuple[GelCamera, Camera]:
    """The gel camera of a name or file, and the camera in place of its own; None for its own.

    Raises T2TwinError for a sensor of another kind and for a camera of another image size.
    """
    loaded = load_sensor(sensor)
    if loaded.spec.kind != KIND:
        raise T2TwinError(
            f"{loaded.name} is a {loaded.spec.kind.replace('-', ' ')}; expected a gel camera, "
            "whose optics are fitted to frames"
        )
    gel_camera = cast(GelCamera, loaded)
    own = gel_camera.camera
    if camera is None:
        return gel_camera, own
    arguments.instance(camera, "camera", Camera)
    if (camera.rows, camera.columns) != (own.rows, own.columns):
        raise T2TwinError(
            f"the camera has {camera.rows} rows and {camera.columns} columns; expected {own.rows} "
            f"and {own.columns}, those of {loaded.name}"
        )
    return gel_camera, camera
