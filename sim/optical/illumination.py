"""Light of the LEDs on the deflected gel, where the camera's rays meet it.

This is the geometry of the baked model (t2twin.sim.optical.image_renderer). Camera and gel are
fixed; LEDs are arguments, so that a fit can move them.

G is the optical grid (ny, nx), C its shadow grid, P the image (rows, columns), S the image's
lattice of samples: one in the middle of every 2 x 2 pixels and one more beyond each edge
(rows / 2 + 2, columns / 2 + 2; halves are rounded up). All numbers are float32, which is twice
as fast as mixed types.

Shadows are soft: the visible fraction of each LED's disc is computed at each cell of C. Let D be
the LED's distance. By similar triangles, a blocker at distance s along the ray to the LED's middle,
with clearance c, hides the disc up to c D / s from its middle.

The lobe is light that depends on the direction of the gel's normal, not only on the cosine of
incidence. A semi-specular coating and LEDs that are wider than a disc shift an LED's highlight. The
lobe is a quadratic polynomial of the normal's lateral components times a quadratic polynomial of
the place.
"""

from dataclasses import dataclass
from math import ceil, floor

import numpy as np

from t2twin.core.arrays import Record
from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.optical.camera import Camera, optical_grid
from t2twin.sim.optical.compiled import bilinear, inlined, jit_finite

REACH_MM = 22.0  # distance of an LED at which its color is defined, mm: that of the axis
MIN_DEFLECTION_MM = 2.0e-3  # rendered; less than a grey level (assumed)
REST_STEPS = 12  # largest number of fixed-point steps of a ray to the gel at rest
DEFORMED_STEPS = 3
"""The same for the deformed gel, from the neighboring ray's displacement: each step multiplies the
error by the slopes of surface and ray, at most 0.4."""
COATING_TAPS = np.array([0.0614, 0.2448, 0.3876, 0.2448, 0.0614], dtype=np.float32)
"""Weights of a Gaussian of one cell, 0.1 mm (assumed: the coating's thickness)."""
COSINE_TERMS = 4  # number of powers of the cosine of incidence: m^0 to m^3
GAIN_STRIDE = 2
"""Distance of the rows of S with stored gains; the others are interpolated. The gains of all rows
would exceed the processor's cache. One grey level in a thousand changes, by one."""
RAY_TOLERANCE_MM = np.float32(2e-3)  # tolerance of a ray's height at the gel, mm: 0.02 pixels
LOBE_DEGREE = 2  # degree of the lobe in the place (assumed; others were not compared)
LOBE_PLACES = (LOBE_DEGREE + 1) * (LOBE_DEGREE + 2) // 2
LOBE_TERMS = 5  # number of normal_terms
SHADOW_STRIDE = 2  # cells of the optical grid per cell of the shadow grid, 0.2 mm
MIN_CASTER_MM = 0.02
"""Smallest deflection that casts a shadow, mm (assumed). The gel at rest casts none: the LEDs shine
through its sides."""
SHADOW_BIAS_MM = 0.01  # clearance added to every ray, mm, which avoids self-shadowing (assumed)
MIN_GAP_MM = np.float32(1e-4)  # to an LED along an axis; avoids divisions by zero

_stops = [0.2]
while _stops[-1] < 40.0:
    _stops.append(_stops[-1] + 0.2 + 0.05 * _stops[-1])
RAY_STOPS_MM = np.array(_stops, dtype=np.float32)
"""Distances along a ray, mm, rising, at which heights are compared. They start at the shadow grid's
pitch; the step grows with the distance as the penumbra does."""
PER_STOP = (1.0 / RAY_STOPS_MM).astype(np.float32)
FIRST_STOPS = np.searchsorted(RAY_STOPS_MM, np.arange(100.0))
"""Index of the first of RAY_STOPS_MM at or after each whole millimeter."""

_ZERO, _ONE, _TWO, _SIX = (np.float32(n) for n in (0.0, 1.0, 2.0, 6.0))
_BIAS, _FAR_ABOVE = np.float32(SHADOW_BIAS_MM), np.float32(1e9)

Region = tuple[int, int, int, int]  # first row, end row, first column, end column
NOWHERE: Region = (0, 0, 0, 0)
GROWN = np.array([-1, 1, -1, 1])  # change of a region that grows by a cell to each side


@dataclass(frozen=True, eq=False)
class Leds(Record):
    """LEDs for ray casting."""

    places_mm: np.ndarray  # (LEDs, 3) in the sensor frame
    sizes_mm: np.ndarray  # (LEDs,) radii of their discs


NO_LEDS = Leds(np.zeros((0, 3)), np.zeros(0))


class Rays:
    """The rays of one camera on one gel. shadows: whether LEDs cast shadows."""

    def __init__(self, camera: Camera, gel: Elastomer, shadows: bool = True) -> None:
        self.camera = camera
        self._shadows = shadows
        self.x_mm, self.y_mm = optical_grid(gel)
        self.pitch_mm = float(self.x_mm[1] - self.x_mm[0])
        self.rest_mm = camera.rest_mm(gel, *np.meshgrid(self.x_mm, self.y_mm)).astype(np.float32)
        self._highest_mm = max(0.0, float(self.rest_mm.max()))
        self._across = _sample_slopes(camera.columns, camera.middle[1], camera.focal_px)
        self._down = _sample_slopes(camera.rows, camera.middle[0], camera.focal_px)
        self._frame = tuple(
            np.float32(at) for at in (camera.distance_mm, self.x_mm[0], self.y_mm[0], self.pitch_mm)
        )
        self.everywhere: Region = (0, self._down.size, 0, self._across.size)
        seen = camera.is_seen(self.x_mm, self.y_mm, 4 * self.pitch_mm, self._highest_mm)
        # of the grid, that the image can contain, for any height of the gel
        self._window = _bounds(seen[1][:, None] & seen[0])
        self._coarse_shape = (self.y_mm.size // SHADOW_STRIDE, self.x_mm.size // SHADOW_STRIDE)
        flat = np.zeros((self._down.size, self._across.size), dtype=np.float32)
        self._rest_depth_mm = self._intersected(self.rest_mm, self.everywhere, REST_STEPS, flat)
        reach = camera.distance_mm + self._rest_depth_mm
        self.places_mm = self._across[None, :] * reach, self._down[:, None] * reach
        """x and y, (S) each, where the rays meet the gel at rest."""

    def coated(self, surface_mm: np.ndarray) -> np.ndarray:
        """A deflection on optical_grid(), smoothed by the reflective coating, float32."""
        if surface_mm.shape != self.rest_mm.shape:
            raise T2TwinError(
                f"surface_mm has shape {surface_mm.shape}; it must be {self.rest_mm.shape}, "
                "on t2twin.sim.optical.camera.optical_grid()"
            )
        surface = np.ascontiguousarray(surface_mm, dtype=np.float32)
        if not np.isfinite(surface).all():
            raise T2TwinError("surface_mm holds values that are not finite; all must be")
        return smoothed(surface)

    def incidence(
        self, coated_mm: np.ndarray, leds: Leds, samples: Region | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Cosine of incidence m_k and weight V_k m_k (REACH / d_k)^2, (LEDs, S) float32 each, in a
        region of S, default everywhere. coated_mm: from coated."""
        z = self.rest_mm - coated_mm
        sight, shadowed = self._sight(coated_mm, z, leds)
        return self._follow(z, sight, shadowed, leds, samples or self.everywhere)

    def incidence_where_changed(
        self, coated_mm: np.ndarray, leds: Leds
    ) -> tuple[np.ndarray, np.ndarray, Region, Region]:
        """incidence, but only where the image may change, and the regions of samples and of pixels
        of the change."""
        deflected, nothing = _bounds(np.abs(coated_mm) > MIN_DEFLECTION_MM), np.zeros(0, "f4")
        if deflected == NOWHERE:
            return nothing, nothing, NOWHERE, NOWHERE
        z = self.rest_mm - coated_mm
        sight, shadowed = self._sight(coated_mm, z, leds)
        for top, bottom, left, right in shadowed.tolist():
            if top < bottom and left < right:
                deflected = (
                    min(deflected[0], top), max(deflected[1], bottom),
                    min(deflected[2], left), max(deflected[3], right),
                )  # fmt: skip
        grown, seen = np.add(deflected, 2 * GROWN).tolist(), self._window
        region = (
            max(grown[0], seen[0]), min(grown[1], seen[1]),
            max(grown[2], seen[2]), min(grown[3], seen[3]),
        )  # fmt: skip
        if region[1] <= region[0] or region[3] <= region[2]:
            return nothing, nothing, NOWHERE, NOWHERE
        pixels = self._pixels(region, float(z.min()))
        samples = (pixels[0] // 2, (pixels[1] + 1) // 2 + 2, pixels[2] // 2,
                   (pixels[3] + 1) // 2 + 2)  # fmt: skip
        return *self._follow(z, sight, shadowed, leds, samples), samples, pixels

    def normals(self, coated_mm: np.ndarray, samples: Region | None = None) -> np.ndarray:
        """(2, S) float32 x and y of the gel's unit normals towards the camera; see incidence."""
        z, region = self.rest_mm - coated_mm, samples or self.everywhere
        depth = self._intersected(z, region, DEFORMED_STEPS, self._rest_depth_mm.copy())
        normals = np.empty((2, *depth.shape), dtype=np.float32)
        fill_normals(z, depth, self._across, self._down, *self._frame, region, normals)
        return normals

    def _intersected(
        self, z: np.ndarray, samples: Region, steps: int, depth: np.ndarray
    ) -> np.ndarray:
        """depth (S), with the heights where the rays meet a surface filled into a region."""
        self._follow(z, *self._full_sight(NO_LEDS), NO_LEDS, samples, steps, depth)
        return depth

    def _follow(
        self, z: np.ndarray, sight: np.ndarray, shadowed: np.ndarray, leds: Leds, samples: Region,
        steps: int = DEFORMED_STEPS, depth: np.ndarray | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        """Cosine and weight (LEDs, S) in a region; depth is filled as `incidence` fills it."""
        depth = self._rest_depth_mm.copy() if depth is None else depth
        cosine = np.empty((len(leds.places_mm), *depth.shape), dtype=np.float32)
        weight, lines = np.empty_like(cosine), np.zeros((6, depth.shape[1]), np.float32)
        incidence(
            z, sight, SHADOW_STRIDE, shadowed + SHADOW_STRIDE * GROWN,
            leds.places_mm.astype(np.float32), np.float32(REACH_MM), self._across, self._down,
            *self._frame, samples, steps, lines, depth, cosine, weight,
        )  # fmt: skip
        return cosine, weight

    def _full_sight(self, leds: Leds) -> tuple[np.ndarray, np.ndarray]:
        """Visible fractions of LEDs without shadows, as from _sight."""
        count = len(leds.places_mm)
        sight = np.ones((count, *self._coarse_shape), dtype=np.float32)
        return sight, np.zeros((count, 4), dtype=np.int64)

    def _sight(
        self, coated_mm: np.ndarray, z: np.ndarray, leds: Leds
    ) -> tuple[np.ndarray, np.ndarray]:
        """Visible fractions of LEDs (LEDs, C), and the regions (LEDs, 4) of G where below 1."""
        hard, shadowed = self._full_sight(leds)
        casting = _bounds(coated_mm > MIN_CASTER_MM) if self._shadows else NOWHERE
        if casting == NOWHERE:
            return hard, shadowed
        # means over the blocks of the shadow grid
        rows, columns = (SHADOW_STRIDE * count for count in self._coarse_shape)
        sums = np.zeros(self._coarse_shape)  # (np.mean of the parts copies them first)
        for i, j in np.ndindex(SHADOW_STRIDE, SHADOW_STRIDE):
            sums += z[i:rows:SHADOW_STRIDE, j:columns:SHADOW_STRIDE]
        heights = (sums / SHADOW_STRIDE**2).astype(np.float32)
        first = 0.5 * (SHADOW_STRIDE - 1) * self.pitch_mm
        led_visibility(
            heights, np.float32(self.x_mm[0] + first), np.float32(self.y_mm[0] + first),
            np.float32(SHADOW_STRIDE * self.pitch_mm), _coarse(casting, heights.shape),
            _coarse(self._window, heights.shape),
            np.ascontiguousarray(leds.places_mm, dtype=np.float32),
            np.ascontiguousarray(leds.sizes_mm, dtype=np.float64),
            np.empty((3, heights.shape[1]), np.float32), hard, shadowed,
        )  # fmt: skip
        shadowed[shadowed[:, 1] > 0] += GROWN
        sight = hard.copy()
        soften(hard, shadowed, np.empty(heights.shape[1], np.float32), sight)
        return sight, SHADOW_STRIDE * shadowed

    def _pixels(self, region: Region, nearest_mm: float) -> Region:
        """Region of the image that can contain a region of the grid with z >= nearest_mm."""
        camera = self.camera
        per_mm = [
            camera.focal_px / (camera.distance_mm + end)
            for end in (self._highest_mm, min(nearest_mm, 0.0))
        ]
        edges = []
        for axis, first, last, middle, count in (
            (self.y_mm, region[0], region[1] - 1, camera.middle[0], camera.rows),
            (self.x_mm, region[2], region[3] - 1, camera.middle[1], camera.columns),
        ):
            places = [
                float(axis[end]) * scale + middle for end in (first, last) for scale in per_mm
            ]
            edges += [
                min(max(floor(min(places)) - 1, 0), count),
                min(max(ceil(max(places)) + 2, 0), count),
            ]
        return edges[0], edges[1], edges[2], edges[3]


def _sample_slopes(count: int, middle: float, focal_px: float) -> np.ndarray:
    """(-(-count // 2) + 2,) float32 slopes of the rays of the lattice of samples along one axis."""
    places = 2.0 * np.arange(-(-count // 2) + 2) - 1.5 - middle
    return (places / focal_px).astype(np.float32)


def _bounds(mask: np.ndarray) -> Region:
    """The smallest region that contains a mask (rows, columns)."""
    rows = np.flatnonzero(mask.any(axis=1))
    if not rows.size:
        return NOWHERE
    top, bottom = int(rows[0]), int(rows[-1]) + 1
    columns = np.flatnonzero(mask[top:bottom].any(axis=0))
    return top, bottom, int(columns[0]), int(columns[-1]) + 1


def _coarse(region: Region, shape: tuple[int, ...]) -> Region:
    """The smallest region of the shadow grid that contains a region of the grid."""
    stride = SHADOW_STRIDE
    return (
        region[0] // stride, min(-(-region[1] // stride), shape[0]),
        region[2] // stride, min(-(-region[3] // stride), shape[1]),
    )  # fmt: skip


def smoothed(surface: np.ndarray) -> np.ndarray:
    """(G) a surface, smoothed by COATING_TAPS along both axes; edge cells are repeated outwards."""
    across, out = np.zeros(surface.shape, np.float32), np.zeros(surface.shape, np.float32)
    _smooth(surface, np.empty(surface.shape[1] + COATING_TAPS.size - 1, np.float32), across, out)
    return out


@jit_finite
def _smooth(surface, padded, across, out):
    """Write `smoothed` to out; out and across are zero before."""
    ny, nx = surface.shape
    taps, reach = COATING_TAPS.size, COATING_TAPS.size // 2
    for i in range(ny):
        row = surface[i]
        for j in range(padded.size):
            padded[j] = row[min(max(j - reach, 0), nx - 1)]
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


@jit_finite
def incidence(
    z, sight, stride, shadowed, leds, reach_mm, across, down, distance, x0, y0, pitch, region,
    steps, lines, depth, cosine, weight,
):  # fmt: skip
    """Fill a region of depth (S), cosine m_k and weight V_k m_k (REACH / d_k)^2 (LEDs, S) where the
    rays meet the gel.

    z: heights (G). sight: (LEDs, C) visible fractions of the LEDs' discs, 1 outside each LED's
    region of G, shadowed (LEDs, 4). leds: (LEDs, 3). depth: initially z of the gel at rest. across,
    down: slopes of the samples' rays. distance: from the pinhole to the apex; x0, y0: center of G's
    first cell. A ray starts from the displacement in the row above. lines: (6, columns of S) zeros.
    """
    # each row in two passes: the surface, with scattered reads, then the LEDs, vectorized
    per_mm = _ONE / pitch
    per_slope = per_mm / _TWO
    reach2 = reach_mm * reach_mm
    first, end = region[2], region[3]
    across = across[first:end]
    slope_x, slope_y, part, moved = lines[0], lines[1], lines[2], lines[3]
    rows, columns = lines[4], lines[5]
    shift, per_cell = np.float32(0.5 * (stride - 1)), np.float32(1.0 / stride)
    for row in range(region[0], region[1]):
        heights = depth[row, first:end]
        for n in range(across.size):
            height, fi, fj, i, j = _intersection(
                z, across[n], down[row], heights[n] + moved[n], distance, x0, y0, per_mm, steps
            )
            moved[n] = height - heights[n]
            heights[n] = height
            slope_x[n], slope_y[n] = slopes(z, fi, fj, i, j, per_slope)
            rows[n], columns[n] = fi, fj
        for k in range(leds.shape[0]):
            top, bottom = shadowed[k, 0], shadowed[k, 1]
            left, right = shadowed[k, 2], shadowed[k, 3]
            for n in range(across.size):
                part[n] = _ONE
                if top <= rows[n] < bottom and left <= columns[n] < right:
                    part[n] = at_cell(
                        sight[k], (rows[n] - shift) * per_cell, (columns[n] - shift) * per_cell
                    )
            _shine(
                leds[k], part, reach2, across, down[row], distance, heights, slope_x, slope_y,
                cosine[k, row, first:end], weight[k, row, first:end],
            )  # fmt: skip


@inlined
def _intersection(z, across, down, height, distance, x0, y0, per_mm, steps):
    """Intersection of a ray and the surface: z, fractional row and column in G, and their cell."""
    last_i, last_j = z.shape[0] - 3, z.shape[1] - 3
    step = 0
    while True:
        x, y = across * (distance + height), down * (distance + height)
        fi, fj = (y - y0) * per_mm, (x - x0) * per_mm
        i, j = min(max(int(fi), 1), last_i), min(max(int(fj), 1), last_j)
        u, v = fi - np.float32(i), fj - np.float32(j)
        before = height
        height = bilinear(z[i, j], z[i, j + 1], z[i + 1, j], z[i + 1, j + 1], u, v)
        if abs(height - before) < RAY_TOLERANCE_MM or step == steps:
            break
        step += 1
    return height, fi, fj, i, j


@inlined
def slopes(z, fi, fj, i, j, per_slope):
    """dz/dx and dz/dy: central differences at the corners of cell (i, j), interpolated."""
    u, v = fi - np.float32(i), fj - np.float32(j)
    p, q = _ONE - u, _ONE - v
    along_x = per_slope * (
        p * (q * (z[i, j + 1] - z[i, j - 1]) + v * (z[i, j + 2] - z[i, j]))
        + u * q * (z[i + 1, j + 1] - z[i + 1, j - 1])
        + u * v * (z[i + 1, j + 2] - z[i + 1, j])
    )
    along_y = per_slope * (
        q * (p * (z[i + 1, j] - z[i - 1, j]) + u * (z[i + 2, j] - z[i, j]))
        + v * p * (z[i + 1, j + 1] - z[i - 1, j + 1])
        + v * u * (z[i + 2, j + 1] - z[i, j + 1])
    )
    return along_x, along_y


@inlined
def _shine(
    led, parts, reach2, across, down, distance, heights, slope_x, slope_y, cosines, weights
):  # fmt: skip
    """Fill one LED's cosines and weights in a row, from heights and slopes at the rays' ends."""
    led_x, led_y, led_z = led[0], led[1], led[2]
    for n in range(across.size):
        height, sx, sy = heights[n], slope_x[n], slope_y[n]
        reached = distance + height
        dx, dy = led_x - across[n] * reached, led_y - down * reached
        dz = led_z - height
        facing = max(sx * dx + sy * dy - dz, _ZERO)
        nearness = _ONE / (dx * dx + dy * dy + dz * dz)
        m = facing * np.sqrt(nearness / (_ONE + sx * sx + sy * sy))
        cosines[n] = m
        weights[n] = m * max(parts[n], _ZERO) * reach2 * nearness


@jit_finite
def light(cosine, weight, gain, between, blended, total, rest, region, seen):
    """Fill a region of seen (RGB, S) with the LEDs' light minus rest (RGB, S).

    gain: (gain_rows of S, LEDs * RGB * COSINE_TERMS * columns of S), interpolated linearly between
    its rows. between, (LEDs, RGB, COSINE_TERMS, columns of S), which is blended in one line, and
    total, columns of the region, are work arrays.
    """
    first, end = region[2], region[3]
    leds, colors = between.shape[0], between.shape[1]
    for row in range(region[0], region[1]):
        above = row // GAIN_STRIDE
        apart = max(min(GAIN_STRIDE, cosine.shape[1] - 1 - GAIN_STRIDE * above), 1)
        part = np.float32(row % GAIN_STRIDE) / np.float32(apart)
        upper, lower = gain[above], gain[above + 1]
        for n in range(blended.size):
            blended[n] = upper[n] + part * (lower[n] - upper[n])
        for c in range(colors):
            filled, less = seen[c, row, first:end], rest[c, row, first:end]
            for n in range(total.size):
                total[n] = -less[n]
            for k in range(leds):
                cosines, weights = cosine[k, row, first:end], weight[k, row, first:end]
                g0, g1 = between[k, c, 0, first:end], between[k, c, 1, first:end]
                g2, g3 = between[k, c, 2, first:end], between[k, c, 3, first:end]
                for n in range(total.size):
                    m = cosines[n]
                    total[n] += weights[n] * (g0[n] + m * (g1[n] + m * (g2[n] + m * g3[n])))
            for n in range(total.size):
                filled[n] = total[n]


def gain_rows(rows: int) -> np.ndarray:
    """(n,) the rows of S with stored gains, of so many rows, including the last one."""
    return np.minimum(GAIN_STRIDE * np.arange((rows - 1) // GAIN_STRIDE + 2), rows - 1)


def normal_terms(normals: np.ndarray) -> np.ndarray:
    """(..., LOBE_TERMS) n_x, n_y, n_x^2, n_x n_y, n_y^2 of normals (..., 2)."""
    x, y = normals[..., 0], normals[..., 1]
    return np.stack([x, y, x * x, x * y, y * y], axis=-1)


def lobe_columns(normals: np.ndarray, weight: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(..., LOBE_PLACES * LOBE_TERMS): one LED's light per unit of each entry of its lobe. normals:
    (..., 2). weight: (...) of that LED. places: (..., places) polynomials."""
    terms = weight[..., None] * normal_terms(normals)
    columns = places[..., :LOBE_PLACES, None] * terms[..., None, :]
    return columns.reshape(*weight.shape, -1)


@jit_finite
def add_lobe(normals, weight, gain, region, seen):
    """Add the lobes' light to a region of seen (RGB, S). normals: (2, S) x, y. weight: (LEDs, S).
    gain: (LEDs, RGB, LOBE_TERMS, S)."""
    first, end = region[2], region[3]
    for row in range(region[0], region[1]):
        x, y = normals[0, row, first:end], normals[1, row, first:end]
        for c in range(gain.shape[1]):
            filled = seen[c, row, first:end]
            for k in range(gain.shape[0]):
                weights = weight[k, row, first:end]
                g0, g1 = gain[k, c, 0, row, first:end], gain[k, c, 1, row, first:end]
                g2, g3 = gain[k, c, 2, row, first:end], gain[k, c, 3, row, first:end]
                g4 = gain[k, c, 4, row, first:end]
                for n in range(x.size):
                    along = g0[n] + x[n] * g2[n] + y[n] * g3[n]
                    filled[n] += weights[n] * (x[n] * along + y[n] * (g1[n] + y[n] * g4[n]))


@jit_finite
def fill_normals(z, depth, across, down, distance, x0, y0, pitch, region, normals):
    """Fill a region of normals (2, S), x and y towards the camera; arguments as for incidence."""
    per_mm = _ONE / pitch
    per_slope = np.float32(0.5) * per_mm
    last_i, last_j = z.shape[0] - 3, z.shape[1] - 3
    for row in range(region[0], region[1]):
        for n in range(region[2], region[3]):
            reached = distance + depth[row, n]
            fi, fj = (down[row] * reached - y0) * per_mm, (across[n] * reached - x0) * per_mm
            i, j = min(max(int(fi), 1), last_i), min(max(int(fj), 1), last_j)
            sx, sy = slopes(z, fi, fj, i, j, per_slope)
            length = np.sqrt(_ONE + sx * sx + sy * sy)
            normals[0, row, n], normals[1, row, n] = sx / length, sy / length


@jit_finite
def led_visibility(heights, x0, y0, pitch, caster, window, leds, sizes, lines, sight, shadowed):
    """Fill sight (LEDs, C), initially 1, with the visible fraction of each LED's disc at each cell,
    and shadowed (LEDs, 4), initially 0, with the region of C where it is below 1.

    heights: (C); x0, y0: center of its first cell. caster, window: regions of C that may block rays
    and that are computed. leds: (LEDs, 3). lines: (3, columns), is a work array. Every second cell
    is computed first. A cell between is skipped if its computed neighbors see the whole disc, since
    no shadow of a disc is thinner.
    """
    if caster[1] <= caster[0] or caster[3] <= caster[2]:
        return
    nearest = heights[caster[0], caster[2]]
    for i in range(caster[0], caster[1]):
        for j in range(caster[2], caster[3]):
            nearest = min(nearest, heights[i, j])
    nearest = nearest - _BIAS
    fars, begins, ends = lines[0], lines[1], lines[2]
    for k in range(leds.shape[0]):
        led, size, seen = leds[k], np.float32(sizes[k]), sight[k]
        top, bottom, left, right = heights.shape[0], 0, heights.shape[1], 0
        for turn in range(2 * (window[1] - window[0])):
            i, first = _row_and_column(turn, window)
            row = heights[i, window[2] : window[3]]
            dy = led[1] - (y0 + np.float32(i) * pitch)
            if first == window[2]:
                _spans(row, i, first, dy, led, size, x0, pitch, caster, nearest, fars, begins, ends)
            for j in range(first, window[3], 2):
                m = j - window[2]
                begin, end, far, z = begins[m], ends[m], fars[m], row[m]
                if end <= begin or end < RAY_STOPS_MM[0]:
                    continue
                if _neighbors_are_lit(seen, i, j, window):
                    continue
                # grid steps and slope of the ray per mm along the ground
                per_mm = _ONE / far
                gi = dy * per_mm / pitch
                gj = (led[0] - (x0 + np.float32(j) * pitch)) * per_mm / pitch
                least = _min_slope(heights, i, j, gi, gj, z, begin, end)
                cut = (least - (led[2] - z) * per_mm) * far / size
                if cut >= _ONE:
                    continue
                seen[i, j] = _fraction_above_chord(cut)
                top, bottom = min(top, i), max(bottom, i + 1)
                left, right = min(left, j), max(right, j + 1)
        if bottom > top:
            shadowed[k, 0], shadowed[k, 1] = top, bottom
            shadowed[k, 2], shadowed[k, 3] = left, right


@inlined
def _row_and_column(turn, window):
    """The row and first column of a turn: even rows first, in each row even columns first."""
    rows = window[1] - window[0]
    even = (rows + 1) // 2
    place, odd_row = (turn // 2, 0) if turn < 2 * even else (turn // 2 - even, 1)
    return window[0] + 2 * place + odd_row, window[2] + turn % 2


@inlined
def _neighbors_are_lit(seen, i, j, window):
    """Whether the neighbors of a cell that were computed before it see the whole disc."""
    if (i - window[0]) % 2 == 0:
        if (j - window[2]) % 2 == 0 or j + 1 == window[3]:
            return False
        return seen[i, j - 1] + seen[i, j + 1] >= _TWO
    if i + 1 == window[1]:
        return False
    left, right = max(j - 1, 0), min(j + 1, seen.shape[1] - 1)
    above = seen[i - 1, left] + seen[i - 1, j] + seen[i - 1, right]
    below = seen[i + 1, left] + seen[i + 1, j] + seen[i + 1, right]
    return above + below >= _SIX


@inlined
def _spans(row, i, first, dy, led, size, x0, pitch, caster, nearest, fars, begins, ends):
    """Fill each cell's distance to the LED and the interval in which its ray can be blocked, mm."""
    # rays along an axis are rotated slightly, which avoids divisions by zero
    gap_y = dy if abs(dy) > MIN_GAP_MM else MIN_GAP_MM
    per_gap = pitch / gap_y
    near_y, far_y = np.float32(caster[0] - i) * per_gap, np.float32(caster[1] - 1 - i) * per_gap
    near_y, far_y = min(near_y, far_y), max(near_y, far_y)
    for m in range(row.size):
        j = m + first
        dx = led[0] - (x0 + np.float32(j) * pitch)
        gap_x = dx if abs(dx) > MIN_GAP_MM else MIN_GAP_MM
        per_gap = pitch / gap_x
        near_x, far_x = np.float32(caster[2] - j) * per_gap, np.float32(caster[3] - 1 - j) * per_gap
        far = np.sqrt(dx * dx + dy * dy)
        # over the caster, in parts of the distance to the LED
        begin = max(max(near_y, min(near_x, far_x)), _ZERO)
        end = min(min(far_y, max(near_x, far_x)), _ONE)
        # below the caster's point nearest to the camera, for the shallowest ray, to the disc's
        # lower edge
        fall = min(led[2] - row[m] + size, -MIN_GAP_MM)
        end = min(end, (nearest - row[m]) / fall)
        fars[m], begins[m], ends[m] = far, begin * far, end * far


@inlined
def _min_slope(heights, i, j, gi, gj, z, begin, end):
    """Smallest slope from a cell to the surface along its ray between two distances, mm."""
    n = FIRST_STOPS[int(begin)]
    while n < RAY_STOPS_MM.size and RAY_STOPS_MM[n] < begin:
        n += 1
    least = _FAR_ABOVE
    while n < RAY_STOPS_MM.size and RAY_STOPS_MM[n] <= end:
        s = RAY_STOPS_MM[n]
        there = at_cell(heights, np.float32(i) + gi * s, np.float32(j) + gj * s)
        least = min(least, (there - z + _BIAS) * PER_STOP[n])
        n += 1
    return least


@inlined
def at_cell(grid, row, column):
    """A float32 grid, interpolated at a place in cells; beyond the rim it is extrapolated."""
    i = min(max(int(row), 0), grid.shape[0] - 2)
    j = min(max(int(column), 0), grid.shape[1] - 2)
    down, across = row - np.float32(i), column - np.float32(j)
    return bilinear(grid[i, j], grid[i, j + 1], grid[i + 1, j], grid[i + 1, j + 1], down, across)


@inlined
def _fraction_above_chord(cut):
    """Fraction of a disc above a chord at cut < 1 radii from its middle: an odd cubic, to 0.01."""
    if cut <= -_ONE:
        return 0.0
    return 0.5 + cut * (0.6366 - 0.1366 * cut * cut)


@jit_finite
def soften(sight, shadowed, down, softened):
    """Fill the regions shadowed (LEDs, 4) of softened with sight (LEDs, C) blurred by 1, 2, 1 along
    both axes: the effect of the discs' width at edges along the ray, about one cell. down: a row's
    work array."""
    ny, nx = sight.shape[1], sight.shape[2]
    half, quarter = np.float32(0.5), np.float32(0.25)
    for k in range(sight.shape[0]):
        left, right = max(shadowed[k, 2], 1), min(shadowed[k, 3], nx - 1)
        for i in range(max(shadowed[k, 0], 1), min(shadowed[k, 1], ny - 1)):
            above, row, below = sight[k, i - 1], sight[k, i], sight[k, i + 1]
            filled = softened[k, i]
            for j in range(nx):
                down[j] = half * row[j] + quarter * (above[j] + below[j])
            for j in range(left, right):
                filled[j] = half * down[j] + quarter * (down[j - 1] + down[j + 1])
