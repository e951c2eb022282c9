"""Images of a DIGIT from the gel's deflection: the baked model and the camera noise."""

from pathlib import Path
from typing import Literal

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.elastomer import DIGIT_GEL, Elastomer
from t2twin.sim.contact.types import SurfaceShift
from t2twin.sim.digit.baked import BakedModel
from t2twin.sim.digit.calibration import DEFAULT_PATH, Calibration
from t2twin.sim.digit.camera import gaussian_noise
from t2twin.sim.digit.markers import Markers

NOISE_GREY = 2.8
"""Standard deviation of one frame's noise, grey levels. The mean absolute difference of two real
frames away from the contact is 3.2, which is 2.8 for each, sqrt(pi) / 2 of it (measured on real
frames); TACTO uses 7."""

FRAMES = 30
"""DIGIT frames averaged for one image: 0.5 s (Grella et al. 2023) at 60 Hz (digit-interface)."""


Renderer = Literal["baked", "pyrender"]
"""What renders images: the baked model, in milliseconds, or pyrender, in about
t2twin.sim.digit.rendered.FRAME_SECONDS."""


class DigitOptics:
    """Images in the format of the maker's interface, for one calibration and one gel.

    The background of a gel with another dome is computed from the calibration's background and
    LEDs. markers: printed on the gel; None for none.
    """

    def __init__(
        self,
        calibration: Calibration,
        shadows: bool = True,
        gel: Elastomer = DIGIT_GEL,
        markers: Markers | None = None,
    ) -> None:
        self._model = BakedModel(calibration, shadows, gel, markers)
        self._noise = calibration.noise

    @classmethod
    def load(
        cls, calibration: Path | str | None = None, gel: Elastomer = DIGIT_GEL
    ) -> "DigitOptics":
        """From a calibration file, None for the default. Raises T2TwinError for any other file."""
        path = DEFAULT_PATH if calibration is None else calibration
        return cls(Calibration.load(path), gel=gel)

    @property
    def background(self) -> np.ndarray:
        """(320, 240, 3) uint8: the background frame, with markers, without noise."""
        return self._model.background

    def render(
        self,
        surface_mm: np.ndarray,
        rng: np.random.Generator | None = None,
        noise_grey: float = NOISE_GREY,
        shift: SurfaceShift | None = None,
        background: np.ndarray | None = None,
    ) -> np.ndarray:
        """(320, 240, 3) uint8: the image of the gel deflected by surface_mm.

        surface_mm: on t2twin.sim.digit.camera.pinhole.optical_grid(), rows x columns, mm, positive
            into the sensor.
        rng: of the noise; None for none.
        noise_grey: standard deviation of the noise, grey levels, in every pixel and channel. A
            calibration's own noise is scaled by noise_grey / NOISE_GREY instead.
        shift: lateral displacement of the surface, which moves markers; None for none.
        background: (320, 240, 3) uint8, replaces the calibration's, as of an earlier time.
        Raises T2TwinError for another shape, values that are not finite, and invalid noise.
        """
        noise_grey = checked_noise(noise_grey)
        if rng is None or noise_grey == 0:
            return self._model.render(surface_mm, shift=shift, background=background)
        if self._noise is not None:
            factor = noise_grey / NOISE_GREY
            noise = self._noise.sample(rng)
            return self._model.render(
                surface_mm, noise_grey=factor, noise=noise, shift=shift, background=background
            )
        keys = gaussian_noise.keys(rng)
        return self._model.render(surface_mm, keys, noise_grey, shift=shift, background=background)


def checked_noise(noise_grey: float) -> float:
    """noise_grey. Raises T2TwinError if it is negative or above 255."""
    if not 0.0 <= noise_grey <= 255.0:
        raise T2TwinError(f"noise_grey is {noise_grey:g}; it must lie between 0 and 255")
    return noise_grey
