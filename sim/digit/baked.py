"""The baked optical model: the reference picture's light in closed form, in milliseconds.

For a point p of the gel with unit normal n (towards the camera), the light that lamp k leaves
in linear units is

    L_k = V_k m_k (REACH / d_k)^2 sum_ij R_kij P_i(x, y) m_k^j,      m_k = max(n . l_k, 0)

with l_k, d_k the direction and distance to the lamp, P the six polynomials of degree two in the
place, R a fitted table (lambertian paint would be one constant), and V_k the part of the lamp's
disc that the gel leaves in sight. V_k comes from three rays over the disc's width; along each
the height map's least clearance, projected on to the disc, cuts the disc's height.

The picture is background - L(rest) + L(deformed), each looked up where the pixel's ray meets
that surface, so that an untouched gel gives the background exactly, and whatever a background
holds besides the lamps' light (scattered light, specks) stays where it is.
"""

from dataclasses import dataclass

import numba
import numpy as np

from primitives_cad.errors import T2TwinError
from sim.digit.camera import COLUMNS, PARALLAX_STEPS, ROWS, Camera, optical_grid
from sim.digit.lights import REACH_MM
from sim.press.elastomer import DIGIT_GEL, Elastomer

GAMMA = 2.2
"""Exponent between linear light and grey levels (sRGB's nearest power)."""
PLACE_MM = 8.0
"""Length by which x and y are divided in the polynomials, mm: half the picture's height."""
PLACE_TERMS, COSINE_TERMS = 6, 3
"""Size of the response table: 1, x, y, x^2, xy, y^2 times m^0, m^1, m^2."""
TOUCHED_MM = 5.0e-4
"""Deflection below which a place counts as untouched, mm: a slope of less than a grey level."""
SHADOW_STRIDE = 2
"""Cells of the optical grid to a cell of the shadows' grid: 0.2 mm."""
SHADOW_STEP_MM = 0.3
"""Step of a shadow ray, mm; the gel's features are wider."""
SHADOW_BIAS_MM = 0.05
"""Clearance given to every ray, mm, so that a surface does not shade itself."""
STRIP_PLACES = np.array([-0.6, 0.0, 0.6])
"""Places of the rays over a lamp's width, in its radii: three upright strips of the disc."""
STRIP_HALF_HEIGHTS = np.array([0.8, 1.0, 0.8])
"""Half heights of the strips, in radii: sqrt(1 - place^2)."""
STRIP_WEIGHTS = np.array([0.29, 0.42, 0.29])
"""Parts of the disc's area in the strips, cut at 0.33 radii from the middle."""
ENCODING_STEPS = 4096
"""Entries of the encoding's look-up table, over the square root of the light: 0.06 grey apart."""


@dataclass(frozen=True)
class Calibration:
    """All that one unit's optics need, as data.

    background: (ROWS, COLUMNS, 3) grey levels of the untouched gel, float32.
    lamps_mm: (3, 3) places of the lamps. size_mm: radius of their discs.
    response: (3, PLACE_TERMS, COSINE_TERMS) see the module's text. colours: (3 lamps, 3 RGB).
    scale_px_per_mm, distance_mm: the camera.
    """

    background: np.ndarray
    lamps_mm: np.ndarray
    size_mm: float
    response: np.ndarray
    colours: np.ndarray
    scale_px_per_mm: float
    distance_mm: float

    def __post_init__(self) -> None:
        for name, shape in (
            ("background", (ROWS, COLUMNS, 3)),
            ("lamps_mm", (3, 3)),
            ("response", (3, PLACE_TERMS, COSINE_TERMS)),
            ("colours", (3, 3)),
        ):
            if getattr(self, name).shape != shape:
                raise T2TwinError(
                    f"the calibration's {name} has shape {getattr(self, name).shape}; "
                    f"it must be {shape}"
                )

    @property
    def camera(self) -> Camera:
        return Camera(self.scale_px_per_mm, self.distance_mm)


class BakedModel:
    """Renders deflections with one calibration. shadows: whether lamps cast them."""

    def __init__(
        self, calibration: Calibration, shadows: bool = True, gel: Elastomer = DIGIT_GEL
    ) -> None:
        self.calibration = calibration
        self._shadows = shadows
        x, y = optical_grid(gel)
        self._x_mm, self._y_mm = x, y
        self._rest_mm = gel.rest_surface_mm(*np.meshgrid(x, y)).astype(np.float32)
        self._strips_mm = strip_places(calibration.lamps_mm, calibration.size_mm)
        self._response = np.ascontiguousarray(calibration.response, dtype=np.float32)
        self._colours = np.ascontiguousarray(calibration.colours, dtype=np.float32)
        self._across, self._down = (a.astype(np.float32) for a in calibration.camera.rays())
        self._window = _seen_window(calibration.camera, x, y)
        self._encoding = encoding_table()
        self._background = np.ascontiguousarray(calibration.background, dtype=np.float32)
        untouched = np.zeros_like(self._rest_mm)
        light = np.zeros((y.size, x.size, 3), dtype=np.float32)
        open_sky = np.ones((3, y.size // SHADOW_STRIDE, x.size // SHADOW_STRIDE), dtype=np.float32)
        self._shade(untouched, open_sky, self._window, light)
        self._rest_light = light
        self._rest_depth_mm = np.zeros((ROWS, COLUMNS), dtype=np.float32)
        everywhere = (0, ROWS, 0, COLUMNS)
        seen = np.zeros((ROWS, COLUMNS, 3), dtype=np.float32)
        _look(
            self._rest_mm, light, self._across, self._down, calibration.distance_mm,
            x[0], y[0], x[1] - x[0], everywhere, PARALLAX_STEPS, self._rest_depth_mm, seen,
        )  # fmt: skip
        linear = (self._background / 255.0) ** GAMMA
        self._residual = (linear - seen).astype(np.float32)

    @property
    def background(self) -> np.ndarray:
        """(ROWS, COLUMNS, 3) float32 grey levels of the untouched gel."""
        return self._background

    def render(self, surface_mm: np.ndarray) -> np.ndarray:
        """(ROWS, COLUMNS, 3) float32 grey levels, not rounded, 0 to 255.

        surface_mm: on optical_grid(), rows x columns, positive into the sensor.
        Raises T2TwinError for another grid's shape or values that are not finite.
        """
        if surface_mm.shape != self._rest_mm.shape:
            raise T2TwinError(
                f"surface_mm has shape {surface_mm.shape}; it must be {self._rest_mm.shape}, "
                "on sim.digit.camera.optical_grid()"
            )
        surface = np.ascontiguousarray(surface_mm, dtype=np.float32)
        picture = self._background.copy()
        touched = _bounds(surface, TOUCHED_MM)
        if touched[0] < 0:
            raise T2TwinError("surface_mm holds values that are not finite")
        if touched[1] <= touched[0]:
            return picture
        sight = np.ones(
            (3, surface.shape[0] // SHADOW_STRIDE, surface.shape[1] // SHADOW_STRIDE),
            dtype=np.float32,
        )
        changed = touched
        if self._shadows:
            coarse = _coarse(self._rest_mm, surface)
            changed = _sight(
                coarse, self._x_mm[0], self._y_mm[0], self._x_mm[1] - self._x_mm[0],
                touched, self._window, self._strips_mm, self.calibration.size_mm, sight,
            )  # fmt: skip
        region = _clip(changed, self._window)
        if region[1] <= region[0] or region[3] <= region[2]:
            return picture
        light = self._rest_light.copy()
        self._shade(surface, sight, region, light)
        z = self._rest_mm - surface
        pixels = self._pixels(region)
        depth = self._rest_depth_mm.copy()
        seen = np.zeros((ROWS, COLUMNS, 3), dtype=np.float32)
        _look(
            z, light, self._across, self._down, self.calibration.distance_mm,
            self._x_mm[0], self._y_mm[0], self._x_mm[1] - self._x_mm[0],
            pixels, PARALLAX_STEPS, depth, seen,
        )  # fmt: skip
        _encode(seen, self._residual, self._encoding, pixels, picture)
        return picture

    def _shade(
        self,
        surface: np.ndarray,
        sight: np.ndarray,
        region: tuple[int, int, int, int],
        light: np.ndarray,
    ) -> None:
        _shade(
            self._rest_mm - surface, sight, self._x_mm, self._y_mm, self.calibration.lamps_mm,
            self._response, self._colours, region, light,
        )  # fmt: skip

    def _pixels(self, region: tuple[int, int, int, int]) -> tuple[int, int, int, int]:
        """Rows and columns of the picture that can see a region of the grid, with a margin."""
        return (0, ROWS, 0, COLUMNS) if region else (0, 0, 0, 0)


def strip_places(lamps_mm: np.ndarray, size_mm: float) -> np.ndarray:
    """(lamps, strips, 3) middles of the upright strips of each lamp's disc, mm."""
    sideways = np.stack([-lamps_mm[:, 1], lamps_mm[:, 0], np.zeros(len(lamps_mm))], axis=1)
    sideways /= np.linalg.norm(sideways, axis=1, keepdims=True)
    return lamps_mm[:, None] + size_mm * STRIP_PLACES[None, :, None] * sideways[:, None]


def encoding_table() -> np.ndarray:
    """(ENCODING_STEPS,) float32 grey levels over the square root of linear light, 0 to 1."""
    return (255.0 * np.linspace(0.0, 1.0, ENCODING_STEPS) ** (2.0 / GAMMA)).astype(np.float32)
