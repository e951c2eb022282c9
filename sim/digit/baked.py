"""The baked optical model: the reference picture's light in closed form, in milliseconds.

For a point p of the gel with unit normal n (towards the camera), the light that lamp k leaves
in linear units is

    L_k = V_k m_k (REACH / d_k)^2 sum_ij R_kij P_i(x, y) m_k^j,      m_k = max(n . l_k, 0)

with l_k, d_k the direction and distance to the lamp, P the six polynomials of degree two in the
place, R a fitted table (lambertian paint under an even lamp would be one constant), and V_k the
part of the lamp's disc that the gel leaves in sight. V_k comes from three rays over the disc's
width; along each the height map's least clearance, projected on to the disc, cuts its height.

The picture is background - L(rest) + L(deformed), each looked up where the pixel's ray meets
that surface, so that an untouched gel gives the background exactly, and whatever a background
holds besides the lamps' light (scattered light, specks) stays where it is.
"""

import numpy as np

from primitives_cad.errors import T2TwinError
from sim.digit import kernels
from sim.digit.calibration import PLACE_MM, Calibration
from sim.digit.camera import COLUMNS, ROWS, optical_grid
from sim.digit.lights import REACH_MM
from sim.press.elastomer import DIGIT_GEL, Elastomer

GAMMA = 2.2
"""Exponent between linear light and grey levels (pyrender's; sRGB's nearest power)."""
TOUCHED_MM = 2.0e-3
"""Deflection below which a place counts as untouched, mm: less than a grey level."""
ENCODING_STEPS = 4096
"""Entries of the encoding's table, over the square root of the light: 0.06 grey levels apart."""
REST_STEPS = 12
"""Fixed-point steps to where the pixels' rays meet the untouched gel: to rounding."""
TOUCHED_STEPS = 4
"""The same from there to the deformed gel: each shrinks the error by the surface's slope times
the ray's, 0.4 at most, so that 1 mm ends within 0.03 mm."""
HIGHEST_MM = 4.0
"""Most that the gel can come towards the camera, mm: its thickness, for bounding what it shows."""

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
        self._strips_mm = strip_places(calibration.lamps_mm, calibration.size_mm)
        self._response = np.ascontiguousarray(calibration.response, dtype=np.float64)
        self._colours = np.ascontiguousarray(calibration.colours, dtype=np.float64)
        self._across, self._down = calibration.camera.rays()
        self._window = self._seen_window()
        self._table = encoding_table()
        self._background = np.ascontiguousarray(calibration.background, dtype=np.float32)

        stride = kernels.SHADOW_STRIDE
        self._shadow_shape = (3, self._y_mm.size // stride, self._x_mm.size // stride)
        self._rest_light = np.zeros((*self._rest_mm.shape, 3), dtype=np.float32)
        self._shade(
            self._rest_mm, np.ones(self._shadow_shape, np.float32), self._window, self._rest_light
        )
        everywhere = (0, ROWS, 0, COLUMNS)
        self._rest_depth_mm = np.zeros((ROWS, COLUMNS), dtype=np.float32)
        self._meet(self._rest_mm, everywhere, REST_STEPS, self._rest_depth_mm)
        seen = np.zeros((ROWS, COLUMNS, 3), dtype=np.float32)
        self._look_up(self._rest_light, self._rest_depth_mm, everywhere, seen)
        self._residual = ((self._background / 255.0) ** GAMMA - seen).astype(np.float32)

    @property
    def background(self) -> np.ndarray:
        """(ROWS, COLUMNS, 3) float32 grey levels of the untouched gel."""
        return self._background

    def render(self, surface_mm: np.ndarray) -> np.ndarray:
        """(ROWS, COLUMNS, 3) float32 grey levels, not rounded, 0 to 255.

        surface_mm: on optical_grid(), rows x columns, positive into the sensor.
        Raises T2TwinError for another grid's shape or values that are not finite.
        """
        surface = self._checked(surface_mm)
        picture = self._background.copy()
        *touched, finite = kernels.bounds(surface, TOUCHED_MM)
        if not finite:
            raise T2TwinError("surface_mm holds values that are not finite; it must not")
        region = (touched[0], touched[1], touched[2], touched[3])
        if region[1] <= region[0]:
            return picture
        sight = np.ones(self._shadow_shape, dtype=np.float32)
        if self._shadows:
            region = _union(region, self._cast(surface, region, sight))
        region = _intersection(_grown(region, 2), self._window)
        if region[1] <= region[0] or region[3] <= region[2]:
            return picture
        z = self._rest_mm - surface
        light = self._rest_light.copy()
        self._shade(z, sight, region, light)
        pixels = self._pixels(region)
        depth = self._rest_depth_mm.copy()
        self._meet(z, pixels, TOUCHED_STEPS, depth)
        seen = np.empty((ROWS, COLUMNS, 3), dtype=np.float32)
        self._look_up(light, depth, pixels, seen)
        kernels.encode(seen, self._residual, self._table, pixels, picture)
        return picture

    def lamp_light(
        self, surface_mm: np.ndarray, response: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Each lamp's light under another response table: what a fit is made of.

        response: (3, PLACE_TERMS, COSINE_TERMS). Returns the linear light of lamps 0 to 2 as a
        (ROWS, COLUMNS, 3) picture, and x_mm and y_mm, (ROWS, COLUMNS), where its rays end.
        """
        surface = self._checked(surface_mm)
        z = self._rest_mm - surface
        top, bottom, left, right, _ = kernels.bounds(surface, TOUCHED_MM)
        sight = np.ones(self._shadow_shape, dtype=np.float32)
        if self._shadows and bottom > top:
            self._cast(surface, (top, bottom, left, right), sight)
        light = np.zeros((*z.shape, 3), dtype=np.float32)
        kernels.shade(
            z, sight, self._x_mm, self._y_mm, self._lamps_mm, response.astype(np.float64),
            np.eye(3), PLACE_MM, REACH_MM, self._window, light,
        )  # fmt: skip
        everywhere = (0, ROWS, 0, COLUMNS)
        depth = self._rest_depth_mm.copy()
        self._meet(z, everywhere, REST_STEPS, depth)
        seen = np.zeros((ROWS, COLUMNS, 3), dtype=np.float32)
        self._look_up(light, depth, everywhere, seen)
        reach = self.calibration.distance_mm + depth
        return seen, self._across[None, :] * reach, self._down[:, None] * reach

    def _checked(self, surface_mm: np.ndarray) -> np.ndarray:
        if surface_mm.shape != self._rest_mm.shape:
            raise T2TwinError(
                f"surface_mm has shape {surface_mm.shape}; it must be {self._rest_mm.shape}, "
                "on sim.digit.camera.optical_grid()"
            )
        return np.ascontiguousarray(surface_mm, dtype=np.float32)

    def _cast(self, surface: np.ndarray, touched: Region, sight: np.ndarray) -> Region:
        """Fill sight with the shadows of a touched region; returns the region they fall on."""
        stride = kernels.SHADOW_STRIDE
        heights = kernels.coarse_heights(self._rest_mm, surface)
        first = 0.5 * (stride - 1) * self._pitch_mm
        shadowed = kernels.sight_of_lamps(
            heights, self._x_mm[0] + first, self._y_mm[0] + first, stride * self._pitch_mm,
            _coarse(touched, heights.shape), _coarse(self._window, heights.shape),
            self._strips_mm, self.calibration.size_mm, sight,
        )  # fmt: skip
        return tuple(stride * edge for edge in shadowed)  # type: ignore[return-value]

    def _shade(
        self, z: np.ndarray, sight: np.ndarray, region: Region, light: np.ndarray
    ) -> None:
        kernels.shade(
            z, sight, self._x_mm, self._y_mm, self._lamps_mm, self._response, self._colours,
            PLACE_MM, REACH_MM, region, light,
        )  # fmt: skip

    def _meet(self, z: np.ndarray, region: Region, steps: int, depth: np.ndarray) -> None:
        kernels.meet(
            z, self._across, self._down, self.calibration.distance_mm, self._x_mm[0],
            self._y_mm[0], self._pitch_mm, region, steps, depth,
        )  # fmt: skip

    def _look_up(
        self, light: np.ndarray, depth: np.ndarray, region: Region, seen: np.ndarray
    ) -> None:
        kernels.look_up(
            light, depth, self._across, self._down, self.calibration.distance_mm, self._x_mm[0],
            self._y_mm[0], self._pitch_mm, region, seen,
        )  # fmt: skip

    def _seen_window(self) -> Region:
        """Region of the grid that any pixel can show, the gel being at or below its apex."""
        half_width, half_height = self.calibration.camera.seen_half_extent_mm()
        rows = np.flatnonzero(np.abs(self._y_mm) < half_height + 4 * self._pitch_mm)
        columns = np.flatnonzero(np.abs(self._x_mm) < half_width + 4 * self._pitch_mm)
        return int(rows[0]), int(rows[-1]) + 1, int(columns[0]), int(columns[-1]) + 1

    def _pixels(self, region: Region) -> Region:
        """Region of the picture that can show a region of the grid, whatever its height."""
        camera = self.calibration.camera
        edges = []
        for axis, first, last, count in (
            (self._y_mm, region[0], region[1] - 1, ROWS),
            (self._x_mm, region[2], region[3] - 1, COLUMNS),
        ):
            ends = np.array([axis[first], axis[last]])
            corners = np.outer(ends, camera.focal_px / (camera.distance_mm + np.array(
                [0.0, -HIGHEST_MM]
            ))) + (count - 1) / 2
            edges += [
                int(np.clip(np.floor(corners.min()) - 1, 0, count)),
                int(np.clip(np.ceil(corners.max()) + 2, 0, count)),
            ]
        return edges[0], edges[1], edges[2], edges[3]


def strip_places(lamps_mm: np.ndarray, size_mm: float) -> np.ndarray:
    """(lamps, strips, 3) middles of the upright strips of each lamp's disc, mm."""
    sideways = np.stack([-lamps_mm[:, 1], lamps_mm[:, 0], np.zeros(len(lamps_mm))], axis=1)
    sideways /= np.linalg.norm(sideways, axis=1, keepdims=True)
    offsets = size_mm * kernels.STRIP_PLACES[None, :, None] * sideways[:, None]
    return np.ascontiguousarray(lamps_mm[:, None] + offsets)


def encoding_table() -> np.ndarray:
    """(ENCODING_STEPS,) float32 grey levels over the square root of linear light, 0 to 1."""
    return (255.0 * np.linspace(0.0, 1.0, ENCODING_STEPS) ** (2.0 / GAMMA)).astype(np.float32)


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
