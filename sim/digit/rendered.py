"""Images of a DIGIT by pyrender, instead of by the baked model.

As in the baked model, the image is background + L(deformed) - L(rest), but pyrender renders L
(t2twin.sim.digit.pyrender_renderer) with several points per LED, each with a shadow map. So a gel
at rest gives the background exactly. Gamma and noise are the same.

pyrender gets a sampled unit's LEDs with their places, sizes and colors in the image's middle
(t2twin.sim.digit.randomization.lighting). Each LED's light varies over the image and with the
cosine of incidence as a default LED's does on a Lambertian surface. Negative leaks are omitted.

A process has one renderer, which is created at the first image, so that RenderedOptics can be
pickled. OpenGL belongs to one thread, which renders all images.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.elastomer import DIGIT_GEL, Elastomer
from t2twin.sim.contact.types import SurfaceShift
from t2twin.sim.digit.calibration import Calibration
from t2twin.sim.digit.camera import response
from t2twin.sim.digit.camera.gaussian_noise import standard_normal
from t2twin.sim.digit.camera.pinhole import Camera, optical_grid
from t2twin.sim.digit.light.coating import coated
from t2twin.sim.digit.light.leds import AMBIENT, Led
from t2twin.sim.digit.light.ray_casting import rest_surface_mm
from t2twin.sim.digit.markers import MarkerImage, Markers
from t2twin.sim.digit.optics import NOISE_GREY, DigitOptics, checked_noise
from t2twin.sim.digit.pyrender_renderer import ReferenceRenderer

FRAME_SECONDS = 1.1
"""Time of an image with software OpenGL on two idle cores, s (benchmark `digit_render`). It uses
all cores, so more processes are hardly faster."""
FIRST_SECONDS = 6.0
"""Time of the first image of a process, including the start of OpenGL, s (measured)."""
LED_POINTS = 8
"""Points per LED, each a render pass: the default of ReferenceRenderer."""


class RenderedOptics:
    """As DigitOptics, but pyrender renders each image, in about FRAME_SECONDS.

    leds: in the order of the calibration's. calibration: for camera, background and gamma. markers:
    printed on the gel; None for none. Raises T2TwinError at the first image if there is no OpenGL.
    """

    def __init__(
        self,
        calibration: Calibration,
        leds: tuple[Led, ...],
        gel: Elastomer = DIGIT_GEL,
        markers: Markers | None = None,
    ) -> None:
        self.calibration = calibration
        self.leds, self.gel = leds, gel
        self._unmarked = self.background = DigitOptics(calibration, gel=gel).background
        """(320, 240, 3) uint8: the background frame, with markers, without noise."""
        self._marker_image = None
        if markers is not None:
            camera, gamma = calibration.camera, calibration.gamma
            rest_mm = rest_surface_mm(camera, gel)
            self._marker_image = MarkerImage(markers, camera, gel, rest_mm, gamma)
            self.background = self.render(np.zeros_like(rest_mm))

    def render(
        self,
        surface_mm: np.ndarray,
        rng: np.random.Generator | None = None,
        noise_grey: float = NOISE_GREY,
        shift: SurfaceShift | None = None,
        background: np.ndarray | None = None,
    ) -> np.ndarray:
        """(320, 240, 3) uint8: see DigitOptics.render."""
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
        under = self._unmarked
        if background is not None:
            earlier = replace(self.calibration, background=background)
            under = DigitOptics(earlier, gel=self.gel).background
        grey = self._grey(surface_mm, under)
        if self._marker_image is not None:
            coated_mm = coated(np.ascontiguousarray(surface_mm, dtype=np.float32))
            grey *= self._marker_image.shade(coated_mm, shift)[..., None]
        if rng is not None and noise_grey > 0:
            grey += noise_grey * standard_normal(rng, grey.shape)
        return (np.clip(grey, 0.0, 255.0) + 0.5).astype(np.uint8)

    def _grey(self, surface_mm: np.ndarray, background: np.ndarray) -> np.ndarray:
        """(320, 240, 3) float64 grey levels on a background frame, without markers and noise."""
        if not surface_mm.any():
            return background.astype(float)
        thread = _thread(os.getpid())
        change = thread.submit(_change, self.leds, self.calibration.camera, self.gel, surface_mm)
        gamma, albedo = self.calibration.gamma, self.calibration.albedo
        reflected = change.result() if albedo is None else change.result() * albedo[..., None]
        light = response.linear(background, gamma) + reflected
        return 255.0 * np.clip(light, 0.0, 1.0) ** (1.0 / gamma)


@cache
def _thread(process: int) -> ThreadPoolExecutor:
    """The thread of a process for OpenGL; the argument distinguishes forks."""
    return ThreadPoolExecutor(max_workers=1, thread_name_prefix=f"pyrender-{process}")


def _change(
    leds: tuple[Led, ...], camera: Camera, gel: Elastomer, surface_mm: np.ndarray
) -> np.ndarray:
    """(ROWS, COLUMNS, RGB) change of the light by a deflection."""
    renderer, rest_light = _cache(os.getpid()).renderer(leds, camera, gel)
    return renderer.render_linear(surface_mm) - rest_light


class _RendererCache:
    """The last renderer, and its light of the gel at rest."""

    def __init__(self) -> None:
        self._parameters: tuple = ()
        self._renderer: ReferenceRenderer | None = None
        self._rest_light = np.zeros(0)

    def renderer(
        self, leds: tuple[Led, ...], camera: Camera, gel: Elastomer
    ) -> tuple[ReferenceRenderer, np.ndarray]:
        if self._renderer is not None and self._parameters != (leds, camera, gel):
            self._renderer.close()
            self._renderer = None
        if self._renderer is None:
            self._renderer = ReferenceRenderer(
                leds, AMBIENT, led_points=LED_POINTS, camera=camera, gel=gel
            )
            x, y = optical_grid(gel)
            self._rest_light = self._renderer.render_linear(np.zeros((y.size, x.size)))
            self._parameters = (leds, camera, gel)
        return self._renderer, self._rest_light


@cache
def _cache(process: int) -> _RendererCache:
    """The cache of a process; the argument distinguishes forks."""
    return _RendererCache()
