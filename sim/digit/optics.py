"""The DIGIT's picture of a deflected gel: the baked model and the camera's noise."""

from pathlib import Path
from typing import Literal

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.elastomer import DIGIT_GEL, Elastomer
from t2twin.sim.digit.baked import BakedModel
from t2twin.sim.digit.calibration import DEFAULT_PATH, Calibration
from t2twin.sim.digit.camera import gaussian_noise

NOISE_GREY = 2.8
"""Standard deviation of one frame's noise, grey levels. Two real frames differ by 3.2 (mean
absolute) away from the contact, which is 2.8 each, sqrt(pi) / 2 of it (measured on real frames);
TACTO takes 7."""

FRAMES = 30
"""DIGIT frames averaged into a sample: 0.5 s (Grella et al. 2023) at 60 Hz (digit-interface)."""


Renderer = Literal["baked", "pyrender"]
"""What renders images: the baked model, in milliseconds, or pyrender, in about
t2twin.sim.digit.rendered.FRAME_SECONDS."""


class DigitOptics:
    """Pictures as the maker's interface gives them, from one calibration and one gel.

    A gel of another dome than the DIGIT's own stands in the same LEDs' light; its background
    follows from the calibration's.
    """

    def __init__(
        self, calibration: Calibration, shadows: bool = True, gel: Elastomer = DIGIT_GEL
    ) -> None:
        self._model = BakedModel(calibration, shadows, gel)
        self._noise = calibration.noise

    @classmethod
    def load(
        cls, calibration: Path | str | None = None, gel: Elastomer = DIGIT_GEL
    ) -> "DigitOptics":
        """From a calibration file, or the shipped one. Raises T2TwinError if it is not one."""
        path = DEFAULT_PATH if calibration is None else calibration
        return cls(Calibration.load(path), gel=gel)

    @property
    def background(self) -> np.ndarray:
        """(320, 240, 3) uint8: the untouched gel, without noise."""
        return self._model.background

    def render(
        self,
        surface_mm: np.ndarray,
        rng: np.random.Generator | None = None,
        noise_grey: float = NOISE_GREY,
    ) -> np.ndarray:
        """(320, 240, 3) uint8 picture of the gel deflected by surface_mm.

        surface_mm: on t2twin.sim.digit.camera.pinhole.optical_grid(), rows x columns, mm, positive
        into the
            sensor.
        rng: where the noise is drawn from; None gives none.
        noise_grey: its standard deviation, grey levels, the same in every pixel and channel; where
            the calibration has its own noise, that one is taken noise_grey / NOISE_GREY times.
        Raises T2TwinError for another grid's shape, values that are not finite, negative noise.
        """
        noise_grey = checked_noise(noise_grey)
        if rng is None or noise_grey == 0:
            return self._model.render(surface_mm)
        if self._noise is not None:
            times = noise_grey / NOISE_GREY
            return self._model.render(surface_mm, noise_grey=times, noise=self._noise.sample(rng))
        return self._model.render(surface_mm, gaussian_noise.keys(rng), noise_grey)


def checked_noise(noise_grey: float) -> float:
    """The same. Raises T2TwinError for a negative one or one above 255."""
    if not 0.0 <= noise_grey <= 255.0:
        raise T2TwinError(f"noise_grey is {noise_grey:g}; it must lie between 0 and 255")
    return noise_grey
