"""`calibrate` and `guess_light`, which warn of a background frame that is unsuitable."""

import inspect
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import ParamSpec, TypeVar

from t2twin.core import arguments
from t2twin.core.errors import warn
from t2twin.core.frame_order import FrameOrder
from t2twin.sim.calibrate import calibrate as optics
from t2twin.sim.calibrate.frames import read_frame, sized_frame
from t2twin.sim.optical.camera import Camera
from t2twin.translate.inference.load import load_run
from t2twin.translate.runs.config import load_config, pretrained_runs, resolve_run

P = ParamSpec("P")
Result = TypeVar("Result")


def background_warning(path: Path, order: FrameOrder, camera: Camera, sensor: str) -> str | None:
    """What pretrained runs of the sensor find wrong with a background frame: order or contact."""
    frame = read_frame(path, order)
    for name in pretrained_runs():
        config = load_config(resolve_run(name))
        if config.data.camera.name != sensor or not config.has_uncertainty:
            continue
        run = load_run(name)
        stored = run._order_warning((), frame, (), order)
        sized = sized_frame(frame, camera, stored)
        if stored:
            return f"{path}: {stored}"
        if run.shows_contact(sized)[0]:
            return f"{path} shows a contact, by {name}; expected a frame without"
    return None


def _warning(fit: Callable[P, Result]) -> Callable[P, Result]:
    """The function, which first warns of an unsuitable background frame."""

    @wraps(fit)
    def warned(*values: P.args, **options: P.kwargs) -> Result:
        bound = inspect.signature(fit).bind(*values, **options)
        bound.apply_defaults()
        given = bound.arguments
        sensor, camera = optics.sensor_and_camera(given["sensor"], given["camera"])
        path = arguments.path(given["background"], "background")
        warn(background_warning(path, given["order"], camera, sensor.name))
        return fit(*values, **options)

    return warned


calibrate, guess_light = _warning(optics.calibrate), _warning(optics.guess_light)
