"""Casts the camera's rays on to the gel, and computes the LEDs' incidence there.

This is the geometry of the baked model (t2twin.sim.optical.image_renderer). Camera and gel are
fixed; LEDs are arguments, so that a fit can move them. G is the optical grid (ny, nx). S is the
lattice of samples of the image: one in the middle of every 2 x 2 pixels and one more beyond each
edge.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.optical.camera.compiled import jit_finite
from t2twin.sim.optical.camera.pinhole import Camera, optical_grid
from t2twin.sim.optical.light import illumination
from t2twin.sim.optical.light.leds import REACH_MM
from t2twin.sim.optical.light.shadows import (
    MIN_CASTER_MM,
    SHADOW_STRIDE,
    coarse_heights,
    led_visibility,
    soften,
)

MIN_DEFLECTION_MM = 2.0e-3
"""Smallest deflection that is rendered, mm: less than a grey level (assumed)."""
REST_STEPS = 12
"""Largest number of fixed-point steps to the intersection of a ray and the gel at rest."""
DEFORMED_STEPS = 3
"""The same for the deformed gel, from the neighboring ray's displacement: each step multiplies the
error by the slopes of surface and ray, at most 0.4."""

COATING_TAPS = np.array([0.0614, 0.2448, 0.3876, 0.2448, 0.0614], dtype=np.float32)
"""Weights of a Gaussian of one cell, 0.1 mm (assumed: the coating's thickness)."""

Region = tuple[int, int, int, int]
"""First row, end row, first column, end column."""
NOWHERE: Region = (0, 0, 0, 0)
GROWN = np.array([-1, 1, -1, 1])
"""Change of a region that grows by a cell to each side."""


@dataclass(frozen=True)
class Leds:
    """LEDs for ray casting.

    places_mm: (LEDs, 3) in the sensor frame. sizes_mm: (LEDs,) radii of their discs.
    """

    places_mm: np.ndarray
    sizes_mm: np.ndarray


class Rays:
    """The rays of one camera on one gel. shadows: whether LEDs cast shadows."""

    def __init__(self, camera: Camera, gel: Elastomer, shadows: bool = True) -> None:
        self.camera = camera
        self._shadows = shadows
        self.x_mm, self.y_mm = optical_grid(gel)
        self.pitch_mm = float(self.x_mm[1] - self.x_mm[0])
        self.rest_mm = rest_surface_mm(camera, gel)
        self._highest_mm = max(0.0, float(self.rest_mm.max()))
        self._across = _sample_slopes(camera.columns, camera.middle[1], camera.focal_px)
        self._down = _sample_slopes(camera.rows, camera.middle[0], camera.focal_px)
        self.everywhere: Region = (0, self._down.size, 0, self._across.size)
        self._window = self._visible_window()
        self._coarse_shape = (self.y_mm.size // SHADOW_STRIDE, self.x_mm.size // SHADOW_STRIDE)
        self._rest_depth_mm = np.zeros((self._down.size, self._across.size), dtype=np.float32)
        self._intersect(self.rest_mm, self.everywhere, REST_STEPS, self._rest_depth_mm)
        reach = camera.distance_mm + self._rest_depth_mm
        self.places_mm = self._across[None, :] * reach, self._down[:, None] * reach
        """x and y, (S) each, where the rays meet the gel at rest."""

    def coated(self, surface_mm: np.ndarray) -> np.ndarray:
        """A deflection on optical_grid(), smoothed by the reflective coating, float32.

        Raises T2TwinError for another shape or values that are not finite.
        """
        if surface_mm.shape != self.rest_mm.shape:
            raise T2TwinError(
                f"surface_mm has shape {surface_mm.shape}; it must be {self.rest_mm.shape}, "
                "on t2twin.sim.optical.camera.pinhole.optical_grid()"
            )
        surface = np.ascontiguousarray(surface_mm, dtype=np.float32)
        if not np.isfinite(surface).all():
            raise T2TwinError("surface_mm holds values that are not finite; all must be")
        return smoothed(surface)

    def incidence(
        self, coated_mm: np.ndarray, leds: Leds, samples: Region | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Cosine of incidence m_k and weight V_k m_k (REACH / d_k)^2, (S, LEDs) float32 each.

        coated_mm: from coated. samples: the region of S to compute, default everywhere; other
        values are undefined.
        """
        z = self.rest_mm - coated_mm
        _, casting = _regions(coated_mm)
        sight, shadowed = self._sight(casting, z, leds)
        cosine, weight = self._follow(
            z, sight, shadowed, leds, samples or self.everywhere, DEFORMED_STEPS,
            self._rest_depth_mm.copy(),
        )  # fmt: skip
        return np.moveaxis(cosine, 0, -1), np.moveaxis(weight, 0, -1)

    def normals(self, coated_mm: np.ndarray, samples: Region | None = None) -> np.ndarray:
        """(2, S) float32 x and y of the gel's unit normals towards the camera; see incidence."""
        z, region = self.rest_mm - coated_mm, samples or self.everywhere
        depth = self._rest_depth_mm.copy()
        self._intersect(z, region, DEFORMED_STEPS, depth)
        normals, single = np.empty((2, *depth.shape), dtype=np.float32), np.float32
        illumination.fill_normals(
            z, depth, self._across, self._down, single(self.camera.distance_mm),
            single(self.x_mm[0]), single(self.y_mm[0]), single(self.pitch_mm), region, normals,
        )  # fmt: skip
        return normals

    def _intersect(self, z: np.ndarray, samples: Region, steps: int, depth: np.ndarray) -> None:
        """Fill a region of depth (S), the heights where the rays meet a surface."""
        nothing = Leds(np.zeros((0, 3)), np.zeros(0))
        shadowed = np.zeros((0, 4), dtype=np.int64)
        self._follow(z, self._full_sight(0), shadowed, nothing, samples, steps, depth)

    def incidence_where_changed(
        self, coated_mm: np.ndarray, leds: Leds
    ) -> tuple[np.ndarray, np.ndarray, Region, Region]:
        """incidence, but (LEDs, S) and only where the image may change, and the regions of samples
        and of pixels of the change."""
        deflected, casting = _regions(coated_mm)
        nothing = np.zeros(0, dtype=np.float32)
        if deflected[1] <= deflected[0]:
            return nothing, nothing, NOWHERE, NOWHERE
        z = self.rest_mm - coated_mm
        sight, shadowed = self._sight(casting, z, leds)
        for each in shadowed:
            deflected = _union(deflected, _region(each))
        region = _intersection(_region(np.add(deflected, 2 * GROWN)), self._window)
        if region[1] <= region[0] or region[3] <= region[2]:
            return nothing, nothing, NOWHERE, NOWHERE
        pixels = self._pixels(region, float(z.min()))
        samples = (pixels[0] // 2, (pixels[1] + 1) // 2 + 2, pixels[2] // 2,
                   (pixels[3] + 1) // 2 + 2)  # fmt: skip
        depth = self._rest_depth_mm.copy()
        lit = self._follow(z, sight, shadowed, leds, samples, DEFORMED_STEPS, depth)
        return *lit, samples, pixels

    def _follow(
        self,
        z: np.ndarray,
        sight: np.ndarray,
        shadowed: np.ndarray,
        leds: Leds,
        samples: Region,
        steps: int,
        depth: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Fill a region of depth (S); its cosine and weight (LEDs, S): see illumination.incidence.

        depth: initially the heights at rest.
        """
        cosine = np.empty((len(leds.places_mm), *depth.shape), dtype=np.float32)
        weight, single = np.empty_like(cosine), np.float32
        illumination.incidence(
            z, sight, SHADOW_STRIDE, shadowed + SHADOW_STRIDE * GROWN,
            leds.places_mm.astype(np.float32), single(REACH_MM), self._across, self._down,
            single(self.camera.distance_mm), single(self.x_mm[0]), single(self.y_mm[0]),
            single(self.pitch_mm), samples, steps, depth, cosine, weight,
        )  # fmt: skip
        return cosine, weight

    def _full_sight(self, leds: int) -> np.ndarray:
        """(LEDs, C) ones: all cells of the shadow grid see all of each LED."""
        return np.ones((leds, *self._coarse_shape), dtype=np.float32)

    def _sight(self, casting: Region, z: np.ndarray, leds: Leds) -> tuple[np.ndarray, np.ndarray]:
        """Visible fractions of the LEDs (LEDs, C), and the regions (LEDs, 4) of the grid where they
        are below 1. casting: the region of the grid that may cast shadows."""
        count = len(leds.places_mm)
        hard, shadowed = self._full_sight(count), np.zeros((count, 4), dtype=np.int64)
        if not self._shadows or casting[1] <= casting[0]:
            return hard, shadowed
        heights = coarse_heights(z)
        first = 0.5 * (SHADOW_STRIDE - 1) * self.pitch_mm
        led_visibility(
            heights, np.float32(self.x_mm[0] + first), np.float32(self.y_mm[0] + first),
            np.float32(SHADOW_STRIDE * self.pitch_mm), _coarse(casting, heights.shape),
            _coarse(self._window, heights.shape),
            np.ascontiguousarray(leds.places_mm, dtype=np.float32),
            np.ascontiguousarray(leds.sizes_mm, dtype=np.float64), hard, shadowed,
        )  # fmt: skip
        shadowed[shadowed[:, 1] > 0] += GROWN
        sight = hard.copy()
        soften(hard, shadowed, sight)
        return sight, SHADOW_STRIDE * shadowed

    def _visible_window(self) -> Region:
        """Region of the grid that the image can contain, for any height of the gel."""
        seen = self.camera.is_seen(self.x_mm, self.y_mm, 4 * self.pitch_mm, self._highest_mm)
        columns, rows = (np.flatnonzero(of) for of in seen)
        return int(rows[0]), int(rows[-1]) + 1, int(columns[0]), int(columns[-1]) + 1

    def _pixels(self, region: Region, nearest_mm: float) -> Region:
        """Region of the image that can contain a region of the grid with z >= nearest_mm."""
        camera = self.camera
        ends = np.array([self._highest_mm, min(nearest_mm, 0.0)])
        per_mm = camera.focal_px / (camera.distance_mm + ends)
        edges = []
        for axis, first, last, middle, count in (
            (self.y_mm, region[0], region[1] - 1, camera.middle[0], camera.rows),
            (self.x_mm, region[2], region[3] - 1, camera.middle[1], camera.columns),
        ):
            places = np.outer([axis[first], axis[last]], per_mm) + middle
            edges += [
                int(np.clip(np.floor(places.min()) - 1, 0, count)),
                int(np.clip(np.ceil(places.max()) + 2, 0, count)),
            ]
        return edges[0], edges[1], edges[2], edges[3]


@lru_cache(maxsize=8)
def _level_mm(gel: Elastomer) -> np.ndarray:
    """(G) z of a gel at rest without tilt, mm."""
    return gel.rest_surface_mm(*np.meshgrid(*optical_grid(gel)))


def rest_surface_mm(camera: Camera, gel: Elastomer) -> np.ndarray:
    """(G) float32 z of the gel at rest, mm."""
    level = _level_mm(gel)
    if camera.is_level:
        return level.astype(np.float32)
    x, y = optical_grid(gel)
    return (level + camera.tilt_mm(x[None, :], y[:, None])).astype(np.float32)


def _sample_slopes(count: int, middle: float, focal_px: float) -> np.ndarray:
    """(count / 2 + 2,) float32 slopes of the rays of the lattice of samples along one axis."""
    places = 2.0 * np.arange(count // 2 + 2) - 1.5 - middle
    return (places / focal_px).astype(np.float32)


def _regions(coated_mm: np.ndarray) -> tuple[Region, Region]:
    """Regions of a deflection that are rendered, and that are deep enough to cast a shadow."""
    deflected, deep = _bounds(coated_mm, MIN_DEFLECTION_MM, MIN_CASTER_MM)
    return _region(deflected), _region(deep)


def _region(edges: np.ndarray) -> Region:
    top, bottom, left, right = (int(edge) for edge in edges)
    return top, bottom, left, right


def _union(a: Region, b: Region) -> Region:
    if b[1] <= b[0] or b[3] <= b[2]:
        return a
    return min(a[0], b[0]), max(a[1], b[1]), min(a[2], b[2]), max(a[3], b[3])


def _intersection(a: Region, b: Region) -> Region:
    return max(a[0], b[0]), min(a[1], b[1]), max(a[2], b[2]), min(a[3], b[3])


def _coarse(region: Region, shape: tuple[int, ...]) -> Region:
    """The smallest region of the shadow grid that contains a region of the grid."""
    stride = SHADOW_STRIDE
    return (
        region[0] // stride,
        min(-(-region[1] // stride), shape[0]),
        region[2] // stride,
        min(-(-region[3] // stride), shape[1]),
    )


@jit_finite
def _bounds(coated, deflected_mm, deep_mm):
    """Regions of the cells deflected by more than deflected_mm in either direction, and by more
    than deep_mm, which is not less, into the sensor (empty: end <= first)."""
    ny, nx = coated.shape
    limit, high = np.float32(deflected_mm), np.float32(deep_mm)
    region, deep = np.array([ny, 0, nx, 0]), np.array([ny, 0, nx, 0])
    for i in range(ny):
        row = coated[i]
        # counts instead of branches, so that the loop is vectorized
        deflected, deeper = 0, 0
        for j in range(nx):
            deflected += abs(row[j]) > limit
            deeper += row[j] > high
        if deflected == 0:
            continue
        region[0], region[1] = min(region[0], i), i + 1
        j = 0
        while j < region[2] and not abs(row[j]) > limit:
            j += 1
        region[2] = min(region[2], j)
        j = nx
        while j > region[3] and not abs(row[j - 1]) > limit:
            j -= 1
        region[3] = max(region[3], j)
        if deeper == 0:
            continue
        deep[0], deep[1] = min(deep[0], i), i + 1
        j = 0
        while j < deep[2] and not row[j] > high:
            j += 1
        deep[2] = min(deep[2], j)
        j = nx
        while j > deep[3] and not row[j - 1] > high:
            j -= 1
        deep[3] = max(deep[3], j)
    return region, deep


@jit_finite
def smoothed(surface):
    """(G) a surface, smoothed by COATING_TAPS along both axes; edge cells are repeated outwards."""
    ny, nx = surface.shape
    taps, reach = COATING_TAPS.size, COATING_TAPS.size // 2
    padded = np.empty(nx + 2 * reach, dtype=np.float32)
    across = np.zeros_like(surface)
    out = np.zeros_like(surface)
    for i in range(ny):
        padded[:reach] = surface[i, 0]
        row = surface[i]
        for j in range(nx):  # an assignment of arrays would compile its error messages
            padded[reach + j] = row[j]
        padded[reach + nx :] = surface[i, nx - 1]
        row = across[i]
        for k in range(taps):
            tap, shifted = COATING_TAPS[k], padded[k : k + nx]
            for j in range(nx):
                row[j] += tap * shifted[j]
    for i in range(ny):
        row = out[i]
        for k in range(taps):
            tap, shifted = COATING_TAPS[k], across[min(max(i + k - reach, 0), ny - 1)]
            for j in range(nx):
                row[j] += tap * shifted[j]
    return out
