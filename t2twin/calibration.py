"""`calibrate` and `guess_light`, which warn of a background frame that shows a contact."""

import inspect
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from t2twin.core.errors import warn
from t2twin.sim.calibrate import calibrate as fits
from t2twin.sim.calibrate.frames import read_frame, upright_frame
from t2twin.translate.inference.load import contact_warnings

P = ParamSpec("P")
Result = TypeVar("Result")


def _warning(fit: Callable[P, Result]) -> Callable[P, Result]:
    """The function, which first warns of a contact in its background frame."""

    @wraps(fit)
    def warned(*values: P.args, **options: P.kwargs) -> Result:
        bound = inspect.signature(fit).bind(*values, **options)
        bound.apply_defaults()
        given = bound.arguments
        sensor, camera = fits.sensor_and_camera(given["sensor"], given["camera"])
        background = given["background"]
        frame = upright_frame(read_frame(background, given["order"]), camera)
        warn(*contact_warnings(frame, str(background), sensor.name))
        return fit(*values, **options)

    return warned


calibrate, guess_light = _warning(fits.calibrate), _warning(fits.guess_light)
