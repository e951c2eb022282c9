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
from typing import Any, Literal

import numpy as np

from t2twin.core.arrays import kept, kept_property
from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.types import SurfaceShift
from t2twin.sim.optical import illumination, response
from t2twin.sim.optical.camera import Camera
from t2twin.sim.optical.illumination import COSINE_TERMS, GAIN_STRIDE, Leds, Rays, Region
from t2twin.sim.optical.markers import NO_SHADE, Markers
from t2twin.sim.optical.optics import PLACE_TERMS, Optics, place_degrees, place_terms
from t2twin.sim.optical.response import keys, quantiles
from t2twin.sim.optical.spec import Led

Renderer = Literal["baked", "pyrender"]
"""What renders images: the baked model, in milliseconds, or pyrender, in about
t2twin.sim.optical.pyrender_renderer.FRAME_SECONDS."""

MAX_CLIPPED = 0.5  # largest part of a background frame that is black or overexposed (assumed)
LED_PLACES = 48  # places along each axis where beams are fitted (assumed: they are smooth)

Color = tuple[float, float, float]

NO_FRAME = np.zeros((0, 0), dtype=np.float32)  # measured noise, where there is none


class ImageRenderer:
    """Images in the format of the maker's interface, for one set of optics and one gel.

    gel: that the optics are of. noise_grey: standard deviation of one frame's noise, grey levels.
    other_gel: the gel in the images; None for the same. The background of a gel with another dome
    is computed from the optics' background and LEDs. markers: printed on the gel; None for none.
    """

    def __init__(
        self, optics: Optics, gel: Elastomer, noise_grey: float, other_gel: Elastomer | None = None,
        markers: Markers | None = None,
    ) -> None:  # fmt: skip
        self.optics, self.noise_grey = optics, noise_grey
        self._own_gel, self._gel, self._markers = gel, other_gel or gel, markers
        self._leds = Leds(optics.leds_mm, optics.sizes_mm)
        self._light = response.linear(np.arange(256), optics.gamma).astype(np.float32)
        steps = np.linspace(0.0, 1.0, response.ENCODING_STEPS)
        self._table = (255.0 * steps ** (2.0 / optics.gamma)).astype(np.float32)
        self._all_pixels: Region = 0, optics.camera.rows, 0, optics.camera.columns

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Background frames are read-only in copies too."""
        frames = {name: kept(state[name]) for name in ("background", "_unmarked") if name in state}
        vars(self).update(state | frames)

    def render(
        self, surface_mm: np.ndarray, rng: np.random.Generator | None = None, noise_grey: float |
        None = None, shift: SurfaceShift | None = None, background: np.ndarray | None = None,
    ) -> np.ndarray:  # fmt: skip
        """(rows, columns, 3) uint8: the image of the gel deflected by surface_mm, positive into the
        sensor, on t2twin.sim.optical.camera.optical_grid(gel).

        rng: of the noise; None for none. noise_grey: its standard deviation in every pixel and
        channel; None for that of one frame. Measured noise of the optics is scaled in the same
        ratio. shift: lateral displacement of the surface, which moves markers; None for none.
        background: (rows, columns, 3) uint8, replaces the optics file's, as of an earlier time.
        Raises T2TwinError for another shape, values that are not finite, and invalid noise.
        """
        noise_grey = self.noise_grey if noise_grey is None else noise_grey
        if not 0.0 <= noise_grey <= 255.0:
            raise T2TwinError(f"noise_grey is {noise_grey:g}; it must lie between 0 and 255")
        coated_mm = self._rays.coated(surface_mm)
        under = self._unmarked if background is None else self._on_gel(background)
        markers, optics = self._markers, self.optics
        shade = NO_SHADE
        if markers is not None:
            at_rest = optics.camera, self._gel, self._rays.rest_mm, optics.gamma
            shade = markers.shade(*at_rest, coated_mm, shift)
        rng = None if noise_grey == 0 else rng
        return self._image(surface_mm, coated_mm, under, shade, rng, noise_grey)

    @kept_property
    def background(self) -> np.ndarray:
        """(rows, columns, 3) uint8: the background frame of this gel, without noise."""
        if self._markers is None:
            return self._unmarked
        return self.render(np.zeros_like(self._rays.rest_mm))

    def _image(
        self, surface_mm: np.ndarray, coated_mm: np.ndarray, background: np.ndarray, shade:
        np.ndarray, rng: np.random.Generator | None, noise_grey: float,
    ) -> np.ndarray:  # fmt: skip
        """The image of a deflection and its coating on a background, shaded; rng: of the noise."""
        cosine, weight, samples, pixels = self._rays.incidence_where_changed(coated_mm, self._leds)
        change = self._rest_light
        if pixels[1] > pixels[0]:
            change = self._shone(self._rays, coated_mm, cosine, weight, samples, self._rest_light)
            if self.optics.albedo is not None:
                change *= self._albedo
        return self._encoded(background, change, pixels, shade, rng, noise_grey)

    # Computed at the first image: many presses need none, and compiling the loops takes long.

    @cached_property
    def _rays(self) -> Rays:
        return Rays(self.optics.camera, self._gel)

    @cached_property
    def _gain(self) -> np.ndarray:
        """The response at the samples' places, float32, as illumination.light takes it."""
        table, places_mm = self.optics.response, self._rays.places_mm
        used = np.flatnonzero(np.any(table != 0, axis=(0, 1, 3)))
        # high powers are slow to compute, and many responses have none
        degree = int(place_degrees()[used[-1]]) if used.size else 0
        last = len(places_mm[0]) - 1  # stored in any case
        rows_of_gain = np.minimum(GAIN_STRIDE * np.arange(last // GAIN_STRIDE + 2), last)
        x_mm, y_mm = (places[rows_of_gain] for places in places_mm)
        terms = np.moveaxis(place_terms(x_mm, y_mm, degree), -1, 1)
        rows, count, columns = terms.shape
        entries = np.moveaxis(table[:, :, :count], 2, -1)
        gain = entries.reshape(-1, count) @ terms.astype(float)
        return gain.astype(np.float32).reshape(rows, -1, columns)

    @cached_property
    def _lobe_gain(self) -> np.ndarray | None:
        """(LEDs, RGB, LOBE_TERMS, S) float32: the lobe at each place, for illumination.add_lobe."""
        if self.optics.lobe is None:
            return None
        places = place_terms(*self._rays.places_mm, illumination.LOBE_DEGREE)
        gain = np.einsum("kcij,rsi->kcjrs", self.optics.lobe, places, optimize=True)
        return np.ascontiguousarray(gain, dtype=np.float32)

    @cached_property
    def _albedo(self) -> np.ndarray | np.float32:
        """(S) of the optics file's coating, or 1."""
        if self.optics.albedo is None:
            return np.float32(1.0)
        odd = [(0, count % 2) for count in self.optics.albedo.shape]
        even = np.pad(self.optics.albedo, odd, mode="edge")
        samples = even.reshape(len(even) // 2, 2, -1, 2).mean(axis=(1, 3))
        return np.pad(samples, 1, mode="edge").astype(np.float32)

    @cached_property
    def _rest_light(self) -> np.ndarray:
        return self._light_at_rest(self._rays)

    @kept_property
    def _unmarked(self) -> np.ndarray:
        """(rows, columns, 3) uint8: the background frame without markers."""
        return self._on_gel(self.optics.background)

    @cached_property
    def _unmarked_light(self) -> np.ndarray:
        """The linear light of the background frame without markers."""
        return self._light.take(self._unmarked)

    def _on_gel(self, background: np.ndarray) -> np.ndarray:
        """(rows, columns, 3) uint8: a background frame of the optics' gel, on this gel."""
        of_own_gel = np.ascontiguousarray(background)
        if self._gel == self._own_gel:
            return of_own_gel
        own_rays = Rays(self.optics.camera, self._own_gel)
        if np.array_equal(self._rays.rest_mm, own_rays.rest_mm):
            return of_own_gel
        # add the change of the LEDs' light to the background of the optics' gel
        own = self._light_at_rest(own_rays)
        return self._encoded(of_own_gel, (self._rest_light - own) * self._albedo, self._all_pixels)

    def _light_at_rest(self, rays: Rays) -> np.ndarray:
        """(RGB, S) light of the LEDs."""
        flat = np.zeros((rays.y_mm.size, rays.x_mm.size), dtype=np.float32)
        cosine, weight = rays.incidence(flat, self._leds)
        none = np.zeros((3, *cosine.shape[1:]), dtype=np.float32)
        return self._shone(rays, flat, cosine, weight, rays.everywhere, none)

    def _shone(
        self, rays: Rays, coated_mm: np.ndarray, cosine: np.ndarray, weight: np.ndarray, samples:
        Region, rest: np.ndarray,
    ) -> np.ndarray:  # fmt: skip
        """(RGB, S) light of the LEDs in a region of samples, minus that at rest."""
        seen, gain = np.zeros_like(rest), self._gain
        total = np.empty(samples[3] - samples[2], np.float32)
        work = np.empty(gain.shape[1:], np.float32), total
        illumination.light(cosine, weight, gain, *work, rest, samples, seen)
        if self._lobe_gain is not None:
            normals = rays.normals(coated_mm, samples)
            illumination.add_lobe(normals, weight, self._lobe_gain, samples, seen)
        return seen

    def _encoded(
        self, background: np.ndarray, change: np.ndarray, pixels: Region, shade: np.ndarray =
        NO_SHADE, rng: np.random.Generator | None = None, noise_grey: float = 0.0,
    ) -> np.ndarray:  # fmt: skip
        """Grey levels of a background and a change of its light (RGB, S) in a region, shaded, with
        noise."""
        out = np.empty(background.shape, dtype=np.uint8)
        own_keys, sigma, frame = (np.uint32(0), np.uint32(0)), np.float32(0.0), NO_FRAME
        if rng is not None and self.optics.noise is None:
            own_keys, sigma = keys(rng), np.float32(noise_grey)
        elif rng is not None and self.optics.noise is not None:
            rows, columns = background.shape[:2]
            frame = self.optics.noise.sample(rng, rows, columns).reshape(rows, -1)
            sigma = np.float32(noise_grey / self.noise_grey)
        is_own = background is vars(self).get("_unmarked")
        light = self._unmarked_light if is_own else self._light.take(background)
        rows, width = background.shape[:2]
        pairs = 2, 3 * (width + width % 2)
        lines = np.empty((3, change.shape[2]), np.float32), np.empty(pairs, np.float32)
        response.encode(
            change, background.reshape(rows, -1), light.reshape(rows, -1), self._table, pixels,
            shade, own_keys, quantiles() if sigma else NO_FRAME.ravel(), sigma, frame, *lines,
            np.empty(pairs, np.uint32), out.reshape(rows, -1),
        )  # fmt: skip
        return out


def optics_of_leds(
    leds: tuple[Led, ...], ambient: Color, gamma: float, camera: Camera, gel: Elastomer
) -> Optics:
    """The optics of a unit with these LEDs, beside a Lambertian coating.

    ambient: undirected light, which adds to the background.
    """
    response = np.zeros((len(leds), 3, PLACE_TERMS, COSINE_TERMS))
    # each beam is a polynomial, fitted over the part of the gel that the camera sees
    counts = camera.columns, camera.rows
    columns, rows = (np.linspace(0, count - 1, LED_PLACES) for count in counts)
    points = np.stack(camera.gel_points(gel, columns, rows), axis=-1).reshape(-1, 3)
    terms = place_terms(points[:, 0], points[:, 1])
    for led, own in zip(leds, response, strict=True):
        inside = led.in_beam(points)
        beam = inside[0] * np.eye(PLACE_TERMS)[0]
        if np.ptp(inside) >= 1e-6:
            beam = np.linalg.lstsq(terms, inside, rcond=None)[0]
        own[:, :, 0] = np.outer(led.color, beam)
    blank = Optics(
        background=np.zeros((camera.rows, camera.columns, 3), np.uint8),
        leds_mm=np.array([led.position_mm for led in leds]),
        sizes_mm=np.array([max(led.size_mm, 1e-3) for led in leds]),
        response=response,
        gamma=gamma,
        camera=camera,
    )
    renderer = ImageRenderer(blank, gel, 0.0)
    light = renderer._rest_light + np.array(ambient, np.float32)[:, None, None]
    background = renderer._encoded(blank.background, light, renderer._all_pixels)
    return replace(blank, background=background)


def check_exposure(background: np.ndarray) -> None:
    """Raises T2TwinError for a background frame that is mostly black or overexposed."""
    black = (background == 0).all(axis=2).mean()
    white = (background == 255).mean(axis=(0, 1)).max()  # of the brightest color
    for part, what in ((black, "black"), (white, "overexposed in a color")):
        if part > MAX_CLIPPED:
            raise T2TwinError(
                f"{100 * part:.0f} % of the background frame are {what}; expected at most "
                f"{100 * MAX_CLIPPED:g} %, so change the colors and places of the LEDs, or the "
                "ambient light"
            )
