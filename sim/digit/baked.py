"""The baked optical model: the reference picture's light in closed form, in milliseconds.

For a point p of the gel with unit normal n (towards the camera), the light that lamp k leaves
in linear units is

    L_k = V_k m_k (REACH / d_k)^2 sum_ij R_kij P_i(x, y) m_k^j,      m_k = max(n . l_k, 0)

with l_k, d_k the direction and distance to the lamp, P the polynomials of degree four in the
place where the pixel's ray meets the untouched gel, R a fitted table (lambertian paint under an
even lamp would be one constant), and V_k the part of the lamp's disc that the gel leaves in
sight. V_k comes from a ray over the height map to the disc's middle: its least clearance,
projected on to the disc, cuts the disc.

The picture is background + L(deformed) - L(rest), each where the pixel's ray meets that surface,
so that an untouched gel gives the background exactly, and whatever a background holds besides
the lamps' light (scattered light, specks) stays where it is. Light is sampled at every second
pixel, the optical grid's own pitch, and interpolated.

What the camera sees is the gel's reflective coat, which rounds the gel's edges by its own
thickness: both this model and the reference smooth the deflection by a Gaussian of 0.1 mm
(assumed).
"""

from functools import cache

import numpy as np
from scipy.special import ndtri

from primitives_cad.errors import T2TwinError
from sim.digit import kernels
from sim.digit.calibration import Calibration, place_terms
from sim.digit.camera import COLUMNS, ROWS, optical_grid
from sim.digit.lights import REACH_MM
from sim.press.elastomer import DIGIT_GEL, Elastomer

GAMMA = 2.2
"""Exponent between linear light and grey levels (pyrender's; sRGB's nearest power)."""
TOUCHED_MM = 2.0e-3
"""Deflection below which a place counts as untouched, mm: less than a grey level."""
CASTER_LEAST_MM = 0.02
"""Least deflection that casts a shadow, mm, as in the reference."""
ENCODING_STEPS = 4096
"""Entries of the encoding's table, over the square root of the light: 0.06 grey levels apart."""
REST_STEPS = 12
"""Fixed-point steps to where the pixels' rays meet the untouched gel: to rounding."""
TOUCHED_STEPS = 3
"""The same from there to the deformed gel: each shrinks the error by the surface's slope times
the ray's, 0.4 at most, so that 1 mm ends within 0.06 mm of height, half a pixel."""

NO_DRAWS = np.frombuffer(b"", dtype=np.uint16)

Region = tuple[int, int, int, int]


class BakedModel:
    """Renders deflections with one calibration. shadows: whether lamps cast them."""

    def __init__(
        self, calibration: Calibration, shadows: bool = True, gel: Elastomer = DIGIT_GEL
    ) -> None:
        self.calibration = calibration
        self._shadows = shadows
        self._x_mm, self._y_mm = optical_grid(gel)
        self._pitch_mm = float(self._x_mm[1] - self._x_mm[0])
        self._rest_mm = gel.rest_surface_mm(*np.meshgrid(self._x_mm, self._y_mm)).astype(np.float32)
        self._lamps_mm = np.ascontiguousarray(calibration.lamps_mm, dtype=np.float64)
        self._lamps32_mm = self._lamps_mm.astype(np.float32)
        self._colours = np.ascontiguousarray(calibration.colours, dtype=np.float32)
        focal_px = calibration.camera.focal_px
        self._across, self._down = _sample_slopes(COLUMNS, focal_px), _sample_slopes(ROWS, focal_px)
        self._window = self._seen_window()
        self._table = encoding_table()
        self._background = np.ascontiguousarray(calibration.background)
        self._linear_background = ((self._background / 255.0) ** GAMMA).astype(np.float32)
        stride = kernels.SHADOW_STRIDE
        self._sunlit = np.ones(
            (3, self._y_mm.size // stride, self._x_mm.size // stride), dtype=np.float32
        )
        self._all = (0, self._down.size, 0, self._across.size)
        samples = (self._down.size, self._across.size)
        self._rest_depth_mm = np.zeros(samples, dtype=np.float32)
        self._rest_light = np.zeros((*samples, 3), dtype=np.float32)
        no_gain = np.zeros((*samples, 3, kernels.COSINE_TERMS), dtype=np.float32)
        self._light(
            self._rest_mm, self._sunlit, no_gain, self._colours, self._all, REST_STEPS,
            self._rest_depth_mm, self._rest_light,
        )  # fmt: skip
        self._gain = self._gain_of(calibration.response)
        self._light(
            self._rest_mm, self._sunlit, self._gain, self._colours, self._all, TOUCHED_STEPS,
            self._rest_depth_mm, self._rest_light,
        )  # fmt: skip

    def render(
        self,
        surface_mm: np.ndarray,
        draws: np.ndarray = NO_DRAWS,
        noise_grey: float = 0.0,
    ) -> np.ndarray:
        """(ROWS, COLUMNS, 3) uint8 picture.

        surface_mm: on optical_grid(), rows x columns, positive into the sensor.
        draws: (ROWS * COLUMNS * 3,) uint16, evenly distributed, each turned into normal noise of
            standard deviation noise_grey; or none.
        Raises T2TwinError for another grid's shape or values that are not finite.
        """
        surface = self._coated(surface_mm)
        change, pixels = self._change(surface)
        out = np.empty((ROWS, COLUMNS, 3), dtype=np.uint8)
        kernels.picture(
            change, self._background, self._linear_background, self._table, pixels, draws,
            normal_quantiles(), np.float32(noise_grey), out,
        )  # fmt: skip
        return out

    def _change(self, surface: np.ndarray) -> tuple[np.ndarray, Region]:
        """Change of the light (S, RGB) by a deflection, and the region of pixels that show it."""
        nothing = (0, 0, 0, 0)
        touched = kernels.bounds(surface, TOUCHED_MM)[:4]
        if touched[1] <= touched[0]:
            return self._rest_light, nothing
        z = self._rest_mm - surface
        sight, shadowed = self._sight(surface, z)
        region = _intersection(_grown(_union(touched, shadowed), 2), self._window)
        if region[1] <= region[0] or region[3] <= region[2]:
            return self._rest_light, nothing
        pixels = self._pixels(region, float(z.min()))
        samples = (pixels[0] // 2, (pixels[1] + 1) // 2 + 2, pixels[2] // 2,
                   (pixels[3] + 1) // 2 + 2)  # fmt: skip
        depth, seen = self._rest_depth_mm.copy(), self._rest_light.copy()
        self._light(z, sight, self._gain, self._colours, samples, TOUCHED_STEPS, depth, seen)
        seen -= self._rest_light
        return seen, pixels

    def lamp_light(self, surface_mm: np.ndarray, response: np.ndarray) -> np.ndarray:
        """Each lamp's light under another response table: what a fit is made of.

        response: (3, PLACE_TERMS, COSINE_TERMS). Returns the linear light of lamps 0 to 2 in the
        middles of the picture's blocks of 2 x 2 pixels, (ROWS / 2, COLUMNS / 2, 3).
        """
        surface = self._coated(surface_mm)
        z = self._rest_mm - surface
        sight, _ = self._sight(surface, z)
        depth, seen = self._rest_depth_mm.copy(), np.zeros_like(self._rest_light)
        gain = self._gain_of(response)
        self._light(z, sight, gain, np.eye(3, dtype=np.float32), self._all, REST_STEPS, depth, seen)
        return seen[1:-1, 1:-1]

    def places_mm(self) -> tuple[np.ndarray, np.ndarray]:
        """x and y, (ROWS / 2, COLUMNS / 2) each, where lamp_light's rays meet the untouched gel."""
        x, y = self._rest_places_mm()
        return x[1:-1, 1:-1], y[1:-1, 1:-1]

    def _rest_places_mm(self) -> tuple[np.ndarray, np.ndarray]:
        reach = self.calibration.distance_mm + self._rest_depth_mm
        return self._across[None, :] * reach, self._down[:, None] * reach

    def _gain_of(self, response: np.ndarray) -> np.ndarray:
        """(S, lamps, COSINE_TERMS) float32: the response table at the samples' places."""
        terms = place_terms(*self._rest_places_mm())
        return np.ascontiguousarray(np.einsum("rci,kij->rckj", terms, response), dtype=np.float32)

    def _coated(self, surface_mm: np.ndarray) -> np.ndarray:
        if surface_mm.shape != self._rest_mm.shape:
            raise T2TwinError(
                f"surface_mm has shape {surface_mm.shape}; it must be {self._rest_mm.shape}, "
                "on sim.digit.camera.optical_grid()"
            )
        surface = np.ascontiguousarray(surface_mm, dtype=np.float32)
        if not kernels.bounds(surface, TOUCHED_MM)[4]:
            raise T2TwinError("surface_mm holds values that are not finite; all must be")
        return kernels.coated(surface)

    def _sight(self, surface: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, Region]:
        """Sight of the lamps (lamps, C), and the region of the grid where it is not whole."""
        casting = kernels.bounds(np.maximum(surface, 0.0), CASTER_LEAST_MM)[:4]
        if not self._shadows or casting[1] <= casting[0]:
            return self._sunlit, (0, 0, 0, 0)
        stride = kernels.SHADOW_STRIDE
        heights = kernels.coarse_heights(z)
        hard = self._sunlit.copy()
        first = 0.5 * (stride - 1) * self._pitch_mm
        shadowed = kernels.sight_of_lamps(
            heights, self._x_mm[0] + first, self._y_mm[0] + first, stride * self._pitch_mm,
            _coarse(casting, heights.shape), _coarse(self._window, heights.shape),
            self._lamps_mm, self.calibration.size_mm, hard,
        )  # fmt: skip
        shadowed = _grown(shadowed, 1)
        sight = hard.copy()
        kernels.soften(hard, shadowed, sight)
        top, bottom, left, right = (stride * edge for edge in shadowed)
        return sight, (top, bottom, left, right)

    def _light(
        self,
        z: np.ndarray,
        sight: np.ndarray,
        gain: np.ndarray,
        colours: np.ndarray,
        samples: Region,
        steps: int,
        depth: np.ndarray,
        seen: np.ndarray,
    ) -> None:
        single = np.float32
        kernels.light(
            z, sight, gain, self._lamps32_mm, colours, single(REACH_MM), self._across, self._down,
            single(self.calibration.distance_mm), single(self._x_mm[0]), single(self._y_mm[0]),
            single(self._pitch_mm), samples, steps, depth, seen,
        )  # fmt: skip

    def _seen_window(self) -> Region:
        """Region of the grid that any pixel can show, the gel being at or below its apex."""
        half_width, half_height = self.calibration.camera.seen_half_extent_mm()
        rows = np.flatnonzero(np.abs(self._y_mm) < half_height + 4 * self._pitch_mm)
        columns = np.flatnonzero(np.abs(self._x_mm) < half_width + 4 * self._pitch_mm)
        return int(rows[0]), int(rows[-1]) + 1, int(columns[0]), int(columns[-1]) + 1

    def _pixels(self, region: Region, nearest_mm: float) -> Region:
        """Region of the picture that can show a region of the grid, from z nearest_mm to 0."""
        camera = self.calibration.camera
        per_mm = camera.focal_px / (camera.distance_mm + np.array([0.0, min(nearest_mm, 0.0)]))
        edges = []
        for axis, first, last, count in (
            (self._y_mm, region[0], region[1] - 1, ROWS),
            (self._x_mm, region[2], region[3] - 1, COLUMNS),
        ):
            places = np.outer([axis[first], axis[last]], per_mm) + (count - 1) / 2
            edges += [
                int(np.clip(np.floor(places.min()) - 1, 0, count)),
                int(np.clip(np.ceil(places.max()) + 2, 0, count)),
            ]
        return edges[0], edges[1], edges[2], edges[3]


@cache
def normal_quantiles() -> np.ndarray:
    """(65536,) float32 standard normal quantiles of 16-bit uniform draws, at mid-steps.

    Inverse-transform sampling: several times as fast as drawing normals, and as good once the
    result is rounded to grey levels.
    """
    return ndtri((np.arange(65536) + 0.5) / 65536).astype(np.float32)


def encoding_table() -> np.ndarray:
    """(ENCODING_STEPS,) float32 grey levels over the square root of linear light, 0 to 1."""
    return (255.0 * np.linspace(0.0, 1.0, ENCODING_STEPS) ** (2.0 / GAMMA)).astype(np.float32)


def _sample_slopes(count: int, focal_px: float) -> np.ndarray:
    """(count / 2 + 2,) float32 slopes of the rays of the lattice of samples along one axis."""
    places = 2.0 * np.arange(count // 2 + 2) - 1.5 - (count - 1) / 2
    return (places / focal_px).astype(np.float32)


def _union(a: Region, b: Region) -> Region:
    if b[1] <= b[0] or b[3] <= b[2]:
        return a
    return min(a[0], b[0]), max(a[1], b[1]), min(a[2], b[2]), max(a[3], b[3])


def _intersection(a: Region, b: Region) -> Region:
    return max(a[0], b[0]), min(a[1], b[1]), max(a[2], b[2]), min(a[3], b[3])


def _grown(a: Region, cells: int) -> Region:
    return a[0] - cells, a[1] + cells, a[2] - cells, a[3] + cells


def _coarse(region: Region, shape: tuple[int, ...]) -> Region:
    """A region of the grid as one of the shadow grid, not smaller."""
    stride = kernels.SHADOW_STRIDE
    return (
        region[0] // stride,
        min(-(-region[1] // stride), shape[0]),
        region[2] // stride,
        min(-(-region[3] // stride), shape[1]),
    )
