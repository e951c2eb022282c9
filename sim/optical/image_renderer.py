"""Images of a gel camera by the baked model: the image's light in closed form, in milliseconds.

For a point p of the gel with unit normal n (towards the camera), the light of LED k in color c is

    L_kc = V_k m_k (REACH / d_k)^2 sum_i P_i(x, y) (sum_j R_kcij m_k^j + sum_q S_kciq N_q(n)),
    m_k = max(n . l_k, 0)

with l_k, d_k the direction and distance to the LED. P are the polynomials of degree four in the
place where the pixel's ray meets the gel at rest. R is the fitted response, a constant for a
Lambertian surface and a uniform LED. S is the fitted lobe, of degree two in the place; the default
optics have none. N are n_x, n_y, n_x^2, n_x n_y and n_y^2.
V_k is the visible fraction of the LED's disc. It is computed from a ray over the height map to the
disc's middle: the ray's smallest clearance, projected on to the disc, cuts the disc.

The image is background + L(deformed) - L(rest), each where the pixel's ray meets that surface. So a
gel at rest gives the background exactly, and features of the background besides the LEDs' light
(scattered light, specks) stay in place. Light is sampled at every second pixel, the optical grid's
pitch, and interpolated. grey = 255 light^(1 / gamma), with the optics file's gamma.

The camera sees the gel's reflective coating, whose thickness rounds edges: this model and the
reference smooth the deflection by a Gaussian of 0.1 mm (assumed).
"""

from dataclasses import replace
from functools import cached_property
from typing import Literal

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.types import SurfaceShift
from t2twin.sim.optical import illumination, response
from t2twin.sim.optical.camera import Camera
from t2twin.sim.optical.illumination import COSINE_TERMS, Leds, Rays, Region
from t2twin.sim.optical.markers import NO_SHADE, MarkerImage, Markers
from t2twin.sim.optical.optics import PLACE_TERMS, Optics, place_degrees, place_terms
from t2twin.sim.optical.response import Keys, keys, quantiles
from t2twin.sim.optical.spec import Led

Renderer = Literal["baked", "pyrender"]
"""What renders images: the baked model, in milliseconds, or pyrender, in about
t2twin.sim.optical.pyrender_renderer.FRAME_SECONDS."""

LED_PLACES = 48
"""Places along each axis of the image to which the beams of LEDs are fitted (assumed: beams are
smooth)."""

Color = tuple[float, float, float]

Noise = tuple[Keys, np.float32, np.ndarray]
"""Arguments of response.encode: keys and standard deviation of white noise, and no frame; or the
factor of the noise of a frame, and the frame."""

NO_FRAME = np.zeros((0, 0, 0), dtype=np.float32)
NO_NOISE: Noise = (np.uint32(0), np.uint32(0)), np.float32(0.0), NO_FRAME


class ImageRenderer:
    """Images in the format of the maker's interface, for one set of optics and one gel.

    gel: that the optics are of. noise_grey: standard deviation of one frame's noise, grey levels.
    other_gel: the gel in the images; None for the same. The background of a gel with another dome
    is computed from the optics' background and LEDs. shadows: whether LEDs cast shadows. markers:
    printed on the gel; None for none.
    """

    def __init__(
        self,
        optics: Optics,
        gel: Elastomer,
        noise_grey: float,
        other_gel: Elastomer | None = None,
        markers: Markers | None = None,
        shadows: bool = True,
    ) -> None:
        self.optics, self.noise_grey = optics, noise_grey
        self._own_gel, self._gel = gel, other_gel or gel
        self._leds = Leds(optics.leds_mm, optics.sizes_mm)
        self._table = response.encoding_table(optics.gamma)
        self._light = response.light_of_greys(optics.gamma)
        self._shadows, self._markers = shadows, markers
        rows, columns, _ = optics.background.shape
        self._all_pixels: Region = 0, rows, 0, columns

    def render(
        self,
        surface_mm: np.ndarray,
        rng: np.random.Generator | None = None,
        noise_grey: float | None = None,
        shift: SurfaceShift | None = None,
        background: np.ndarray | None = None,
    ) -> np.ndarray:
        """(rows, columns, 3) uint8: the image of the gel deflected by surface_mm.

        surface_mm: on t2twin.sim.optical.camera.optical_grid(gel), rows x columns, mm,
            positive into the sensor.
        rng: of the noise; None for none.
        noise_grey: standard deviation of the noise, grey levels, in every pixel and channel; None
            for that of one frame. Measured noise of the optics is scaled in the same ratio.
        shift: lateral displacement of the surface, which moves markers; None for none.
        background: (rows, columns, 3) uint8, replaces the optics file's, as of an earlier time.
        Raises T2TwinError for another shape, values that are not finite, and invalid noise.
        """
        noise_grey = self.noise_grey if noise_grey is None else noise_grey
        if not 0.0 <= noise_grey <= 255.0:
            raise T2TwinError(f"noise_grey is {noise_grey:g}; it must lie between 0 and 255")
        coated_mm = self._rays.coated(surface_mm)
        under = self._unmarked if background is None else self._on_gel(background)
        image = self._marker_image
        shade = NO_SHADE if image is None else image.shade(coated_mm, shift)
        return self._image(
            surface_mm, coated_mm, under, shade, None if noise_grey == 0 else rng, noise_grey
        )

    @cached_property
    def background(self) -> np.ndarray:
        """(rows, columns, 3) uint8: the background frame of this gel, without noise."""
        if self._markers is None:
            return self._unmarked
        return self.render(np.zeros_like(self._rays.rest_mm))

    def background_in(self, ambient: Color) -> np.ndarray:
        """(rows, columns, 3) uint8: the gel at rest in the LEDs' light and undirected light, added
        to the optics' background."""
        light = self._rest_light + np.array(ambient, np.float32)[:, None, None]
        return self._encoded(self.optics.background, light, self._all_pixels)

    def _image(
        self,
        surface_mm: np.ndarray,
        coated_mm: np.ndarray,
        background: np.ndarray,
        shade: np.ndarray,
        rng: np.random.Generator | None,
        noise_grey: float,
    ) -> np.ndarray:
        """The image of a deflection and its coating on a background, shaded; rng: of the noise."""
        noise = NO_NOISE
        if rng is not None and self.optics.noise is None:
            noise = keys(rng), np.float32(noise_grey), NO_FRAME
        elif rng is not None and self.optics.noise is not None:
            frame = self.optics.noise.sample(rng, *self.optics.background.shape[:2])
            noise = NO_NOISE[0], np.float32(noise_grey / self.noise_grey), frame
        change, pixels = self._change(coated_mm)
        return self._encoded(background, change, pixels, shade, noise)

    # Computed at the first image: many presses need none, and compiling the loops takes long.

    @cached_property
    def _rays(self) -> Rays:
        return Rays(self.optics.camera, self._gel, self._shadows)

    @cached_property
    def _gain(self) -> np.ndarray:
        return _gains(self._rays, self.optics.response)

    @cached_property
    def _lobe_gain(self) -> np.ndarray | None:
        if self.optics.lobe is None:
            return None
        places = place_terms(*self._rays.places_mm, illumination.LOBE_DEGREE)
        return illumination.lobe_gain(self.optics.lobe, places)

    @cached_property
    def _rest_light(self) -> np.ndarray:
        return self._light_at_rest(self._rays)

    @cached_property
    def _marker_image(self) -> MarkerImage | None:
        if self._markers is None:
            return None
        camera, gamma = self.optics.camera, self.optics.gamma
        return MarkerImage(self._markers, camera, self._gel, self._rays.rest_mm, gamma)

    @cached_property
    def _unmarked(self) -> np.ndarray:
        """(rows, columns, 3) uint8: the background frame without markers."""
        return self._on_gel(self.optics.background)

    def _on_gel(self, background: np.ndarray) -> np.ndarray:
        """(rows, columns, 3) uint8: a background frame of the optics' gel, on this gel."""
        of_own_gel = np.ascontiguousarray(background)
        if self._gel == self._own_gel:
            return of_own_gel
        own_rays = Rays(self.optics.camera, self._own_gel, self._shadows)
        if np.array_equal(self._rays.rest_mm, own_rays.rest_mm):
            return of_own_gel
        # add the change of the LEDs' light to the background of the optics' gel
        own = self._light_at_rest(own_rays)
        return self._encoded(of_own_gel, self._reflected(self._rest_light - own), self._all_pixels)

    def _light_at_rest(self, rays: Rays) -> np.ndarray:
        """(RGB, S) light of the LEDs."""
        flat = np.zeros((rays.y_mm.size, rays.x_mm.size), dtype=np.float32)
        cosine, weight = rays.incidence(flat, self._leds)
        none = np.zeros((3, *cosine.shape[1:]), dtype=np.float32)
        return self._shone(rays, flat, cosine, weight, rays.everywhere, none)

    def _change(self, coated_mm: np.ndarray) -> tuple[np.ndarray, Region]:
        """Change of the light (RGB, S) by a deflection, and its region of pixels."""
        cosine, weight, samples, pixels = self._rays.incidence_where_changed(coated_mm, self._leds)
        if pixels[1] <= pixels[0]:
            return self._rest_light, pixels
        seen = self._shone(self._rays, coated_mm, cosine, weight, samples, self._rest_light)
        return self._reflected(seen), pixels

    def _shone(
        self,
        rays: Rays,
        coated_mm: np.ndarray,
        cosine: np.ndarray,
        weight: np.ndarray,
        samples: Region,
        rest: np.ndarray,
    ) -> np.ndarray:
        """(RGB, S) light of the LEDs in a region of samples, minus that at rest."""
        seen = np.zeros_like(rest)
        illumination.light(cosine, weight, self._gain, rest, samples, seen)
        if self._lobe_gain is not None:
            normals = rays.normals(coated_mm, samples)
            illumination.add_lobe(normals, weight, self._lobe_gain, samples, seen)
        return seen

    def _encoded(
        self,
        background: np.ndarray,
        change: np.ndarray,
        pixels: Region,
        shade: np.ndarray = NO_SHADE,
        noise: Noise = NO_NOISE,
    ) -> np.ndarray:
        """Grey levels of a background and a change of its light (RGB, S) in a region, shaded."""
        out = np.empty(self.optics.background.shape, dtype=np.uint8)
        own_keys, sigma, frame = noise
        response.encode(
            change, background, self._light, self._table, pixels, shade, own_keys, quantiles(),
            sigma, frame, out,
        )  # fmt: skip
        return out

    @cached_property
    def _albedo(self) -> np.ndarray | None:
        """(S) of the optics file's coating; None for an even one."""
        albedo = self.optics.albedo
        if albedo is None:
            return None
        rows, columns = albedo.shape
        samples = albedo.reshape(rows // 2, 2, columns // 2, 2).mean(axis=(1, 3))
        return np.pad(samples, 1, mode="edge").astype(np.float32)

    def _reflected(self, change: np.ndarray) -> np.ndarray:
        """A change of the light (RGB, S), reflected by the optics file's coating."""
        return change if self._albedo is None else change * self._albedo


def _gains(rays: Rays, response: np.ndarray) -> np.ndarray:
    """(gain_rows of S, LEDs, RGB, COSINE_TERMS, columns of S) float32, for illumination.light."""
    used = np.flatnonzero(np.any(response != 0, axis=(0, 1, 3)))
    # high powers are slow to compute, and many responses have none
    degree = int(place_degrees()[used[-1]]) if used.size else 0
    rows_of_gain = illumination.gain_rows(rays.places_mm[0].shape[0])
    x_mm, y_mm = (places[rows_of_gain] for places in rays.places_mm)
    terms = np.moveaxis(place_terms(x_mm, y_mm, degree), -1, 1)
    rows, count, columns = terms.shape
    entries = np.moveaxis(response[:, :, :count], 2, -1)
    gain = entries.reshape(-1, count) @ terms.astype(float)
    return gain.astype(np.float32).reshape(rows, *entries.shape[:-1], columns)


def optics_of_leds(
    leds: tuple[Led, ...], ambient: Color, gamma: float, camera: Camera, gel: Elastomer
) -> Optics:
    """The optics of a unit with these LEDs, beside a Lambertian coating.

    ambient: undirected light, which adds to the background. Raises T2TwinError where the gel at
    rest would be overexposed everywhere, or dark.
    """
    response = np.zeros((len(leds), 3, PLACE_TERMS, COSINE_TERMS))
    for led, own in zip(leds, response, strict=True):
        own[:, :, 0] = np.outer(led.color, _beam_terms(led, camera, gel))
    blank = Optics(
        background=np.zeros((camera.rows, camera.columns, 3), np.uint8),
        leds_mm=np.array([led.position_mm for led in leds]),
        sizes_mm=np.array([max(led.size_mm, 1e-3) for led in leds]),
        response=response,
        gamma=gamma,
        **camera.placement,
    )
    background = ImageRenderer(blank, gel, 0.0).background_in(ambient)
    for level, what in ((0, "black"), (255, "white")):
        if (background == level).all():
            raise T2TwinError(
                f"the LEDs leave the background {what} in every pixel and color; change their "
                "color or the ambient light"
            )
    return replace(blank, background=background)


def _beam_terms(led: Led, camera: Camera, gel: Elastomer) -> np.ndarray:
    """(PLACE_TERMS,) polynomial of an LED's beam over the part of the gel that the camera sees."""
    sizes = camera.columns, camera.rows
    columns, rows = (np.linspace(0, count - 1, LED_PLACES) for count in sizes)
    points = np.stack(camera.gel_points(gel, columns, rows), axis=-1).reshape(-1, 3)
    terms, inside = place_terms(points[:, 0], points[:, 1]), led.in_beam(points)
    if np.ptp(inside) < 1e-6:
        return inside[0] * np.eye(PLACE_TERMS)[0]
    return np.linalg.lstsq(terms, inside, rcond=None)[0]
