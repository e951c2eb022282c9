"""Pictures by pyrender itself, frame by frame, instead of by the baked model.

The picture is background + L(deformed) - L(rest), as the baked model's, but L is what pyrender
renders (t2twin.sim.digit.pyrender_renderer): every LED several points, each with its own shadow
map. So an untouched gel gives the background exactly. Light and grey levels are linked by the
calibration's gamma, the noise is the same.

A drawn unit's LEDs are given to pyrender by their places, sizes and colors in the picture's
middle (t2twin.sim.digit.randomization.lighting). What it cannot be given: how each LED's light
differs over the picture and with the cosine of incidence from a shipped LED's lobe on lambertian
paint, and leaks that take light away.

The renderer is made where and when it is first used and kept for the next picture, one in a
process, so that what is described here can be pickled. Its OpenGL belongs to one thread, which all
pictures go through.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.elastomer import DIGIT_GEL, Elastomer
from t2twin.sim.digit.calibration import Calibration
from t2twin.sim.digit.camera import response
from t2twin.sim.digit.camera.gaussian_noise import standard_normal
from t2twin.sim.digit.camera.pinhole import Camera, optical_grid
from t2twin.sim.digit.light.leds import AMBIENT, Led
from t2twin.sim.digit.optics import NOISE_GREY, DigitOptics, checked_noise
from t2twin.sim.digit.pyrender_renderer import ReferenceRenderer

FRAME_SECONDS = 1.1
"""What a picture takes with software OpenGL on two idle cores, s (benchmarks/digit_render.py). Each
uses all cores, so that more processes make hardly more of them."""
FIRST_SECONDS = 6.0
"""What the first picture of a process takes, with the start of OpenGL and the untouched gel, s
(measured)."""
LED_POINTS = 8
"""Points an LED, each a pass: as many as ReferenceRenderer takes unless told."""


class RenderedOptics:
    """As DigitOptics, but pyrender makes each picture: about FRAME_SECONDS.

    leds: in the order and colors of the calibration's light. The calibration gives the camera, the
    background and the gamma. Raises T2TwinError, at the first picture, where there is no OpenGL.
    """

    def __init__(
        self, calibration: Calibration, leds: tuple[Led, ...], gel: Elastomer = DIGIT_GEL
    ) -> None:
        self.calibration = calibration
        self.leds, self.gel = leds, gel
        self.background = DigitOptics(calibration, gel=gel).background
        """(320, 240, 3) uint8: the untouched gel, without noise."""

    def render(
        self,
        surface_mm: np.ndarray,
        rng: np.random.Generator | None = None,
        noise_grey: float = NOISE_GREY,
    ) -> np.ndarray:
        """(320, 240, 3) uint8 picture of the deflected gel: see DigitOptics.render."""
        noise_grey = checked_noise(noise_grey)
        surface_mm = np.asarray(surface_mm)
        x, y = optical_grid(self.gel)
        if surface_mm.shape != (y.size, x.size):
            raise T2TwinError(
                f"surface_mm has shape {surface_mm.shape}; it must be {(y.size, x.size)}, "
                "on t2twin.sim.digit.camera.pinhole.optical_grid()"
            )
        if not np.isfinite(surface_mm).all():
            raise T2TwinError("surface_mm holds values that are not finite; all must be")
        grey = self._grey(surface_mm)
        if rng is not None and noise_grey > 0:
            grey += noise_grey * standard_normal(rng, grey.shape)
        return (np.clip(grey, 0.0, 255.0) + 0.5).astype(np.uint8)

    def _grey(self, surface_mm: np.ndarray) -> np.ndarray:
        """(320, 240, 3) float64 grey levels, without noise."""
        if not surface_mm.any():
            return self.background.astype(float)
        thread = _thread(os.getpid())
        change = thread.submit(_change, self.leds, self.calibration.camera, self.gel, surface_mm)
        gamma = self.calibration.gamma
        light = response.linear(self.background, gamma) + change.result()
        return 255.0 * np.clip(light, 0.0, 1.0) ** (1.0 / gamma)


@cache
def _thread(process: int) -> ThreadPoolExecutor:
    """The thread of this process that OpenGL belongs to; a fork has its own."""
    return ThreadPoolExecutor(max_workers=1, thread_name_prefix=f"pyrender-{process}")


def _change(
    leds: tuple[Led, ...], camera: Camera, gel: Elastomer, surface_mm: np.ndarray
) -> np.ndarray:
    """(ROWS, COLUMNS, RGB) change of the light by a deflection."""
    renderer, untouched = _kept(os.getpid()).renderer(leds, camera, gel)
    return renderer.render_linear(surface_mm) - untouched


class _Kept:
    """The last renderer, and its light of the untouched gel."""

    def __init__(self) -> None:
        self._of: tuple = ()
        self._renderer: ReferenceRenderer | None = None
        self._untouched = np.zeros(0)

    def renderer(
        self, leds: tuple[Led, ...], camera: Camera, gel: Elastomer
    ) -> tuple[ReferenceRenderer, np.ndarray]:
        if self._renderer is not None and self._of != (leds, camera, gel):
            # before the next one is made: freeing it ends the display of both
            self._renderer.close()
            self._renderer = None
        if self._renderer is None:
            self._renderer = ReferenceRenderer(
                leds, AMBIENT, led_points=LED_POINTS, camera=camera, gel=gel
            )
            x, y = optical_grid(gel)
            self._untouched = self._renderer.render_linear(np.zeros((y.size, x.size)))
            self._of = (leds, camera, gel)
        return self._renderer, self._untouched


@cache
def _kept(process: int) -> _Kept:
    """What this process keeps; a fork has its own."""
    return _Kept()
