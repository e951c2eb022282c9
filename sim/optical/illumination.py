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
from t2twin.sim.contact.grid import block_means, extent
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
_STEP, _STEPS, _RIM = np.uint32(1), np.uint32(2), np.int32(1)
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
        self._down, self._across = (  # slopes of the rays of the lattice of samples
            ((2.0 * np.arange(-(-count // 2) + 2) - 1.5 - middle) / camera.focal_px).astype("f4")
            for count, middle in zip((camera.rows, camera.columns), camera.middle, strict=True)
        )
        self._frame = tuple(
            np.float32(at) for at in (camera.distance_mm, self.x_mm[0], self.y_mm[0], self.pitch_mm)
        )
        self.everywhere: Region = (0, self._down.size, 0, self._across.size)
        seen = camera.is_seen(self.x_mm, self.y_mm, 4 * self.pitch_mm, self._highest_mm)
        # of the grid, that the image can contain, for any height of the gel
        self._window = _bounds(seen[1][:, None] & seen[0])
        self._coarse_shape = (self.y_mm.size // SHADOW_STRIDE, self.x_mm.size // SHADOW_STRIDE)
        self._rest_depth_mm = np.zeros((self._down.size, self._across.size), dtype=np.float32)
        alone = self._full_sight(NO_LEDS), NO_LEDS, self.everywhere
        self._follow(self.rest_mm, *alone, REST_STEPS, self._rest_depth_mm)
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
        return self._follow(z, self._sight(coated_mm, z, leds), leds, samples or self.everywhere)

    def incidence_where_changed(
        self, coated_mm: np.ndarray, leds: Leds
    ) -> tuple[np.ndarray, np.ndarray, Region, Region]:
        """incidence, but only where the image may change, and the regions of samples and of pixels
        of the change."""
        deflected, nothing = _bounds(np.abs(coated_mm) > MIN_DEFLECTION_MM), np.zeros(0, "f4")
        if deflected == NOWHERE:
            return nothing, nothing, NOWHERE, NOWHERE
        z = self.rest_mm - coated_mm
        sights = self._sight(coated_mm, z, leds)
        changed = [deflected, *(each for each in sights[1].tolist() if each[0] < each[1])]
        tops, bottoms, lefts, rights = zip(*changed, strict=True)
        seen = self._window
        region = (max(min(tops) - 2, seen[0]), min(max(bottoms) + 2, seen[1]),
                  max(min(lefts) - 2, seen[2]), min(max(rights) + 2, seen[3]))  # fmt: skip
        if region[1] <= region[0] or region[3] <= region[2]:
            return nothing, nothing, NOWHERE, NOWHERE
        pixels = self._pixels(region, float(z.min()))
        samples = (pixels[0] // 2, (pixels[1] + 1) // 2 + 2, pixels[2] // 2,
                   (pixels[3] + 1) // 2 + 2)  # fmt: skip
        return *self._follow(z, sights, leds, samples), samples, pixels

    def normals(self, coated_mm: np.ndarray, samples: Region | None = None) -> np.ndarray:
        """(2, S) float32 x and y of the gel's unit normals towards the camera; see incidence."""
        z, region = self.rest_mm - coated_mm, samples or self.everywhere
        depth = self._rest_depth_mm.copy()
        self._follow(z, self._full_sight(NO_LEDS), NO_LEDS, region, DEFORMED_STEPS, depth)
        normals = np.empty((2, *depth.shape), dtype=np.float32)
        fill_normals(z, depth, self._across, self._down, *self._frame, region, normals)
        return normals

    def _follow(
        self, z: np.ndarray, sights: tuple[np.ndarray, np.ndarray], leds: Leds, samples: Region,
        steps: int = DEFORMED_STEPS, depth: np.ndarray | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        """Cosine and weight (LEDs, S) in a region; depth is filled as `incidence` fills it."""
        depth = self._rest_depth_mm.copy() if depth is None else depth
        cosine = np.empty((len(leds.places_mm), *depth.shape), dtype=np.float32)
        weight, lines = np.empty_like(cosine), np.zeros((8, depth.shape[1]), np.float32)
        incidence(
            z, sights[0], SHADOW_STRIDE, sights[1] + SHADOW_STRIDE * GROWN,
            leds.places_mm.astype(np.float32), np.float32(REACH_MM), self._across, self._down,
            *self._frame, samples, steps, np.empty(depth.shape[1], np.uint32), lines, depth, cosine,
            weight,
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
        rows, columns = (SHADOW_STRIDE * count for count in self._coarse_shape)
        heights = block_means(z[:rows, :columns].astype(float), SHADOW_STRIDE).astype(np.float32)
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
            places = [float(axis[end]) * per + middle for end in (first, last) for per in per_mm]
            low, high = floor(min(places)) - 1, ceil(max(places)) + 2
            edges += [min(max(low, 0), count), min(max(high, 0), count)]
        return edges[0], edges[1], edges[2], edges[3]


def _bounds(mask: np.ndarray) -> Region:
    """The smallest region that contains a mask (rows, columns)."""
    top, bottom, left, right = extent(mask)
    return (top, bottom + 1, left, right + 1) if bottom >= 0 else NOWHERE


def _coarse(region: Region, shape: tuple[int, ...]) -> Region:
    """The smallest region of the shadow grid that contains a region of the grid."""
    stride = SHADOW_STRIDE
    return (
        region[0] // stride, min(-(-region[1] // stride), shape[0]),
        region[2] // stride, min(-(-region[3] // stride), shape[1]),
    )  # fmt: skip


def smoothed(surface: np.ndarray) -> np.ndarray:
    """(G) a surface, smoothed by COATING_TAPS along both axes; edge cells are repeated outwards."""
    across, out = (np.empty(surface.shape, np.float32) for _ in range(2))
    _smooth(surface, np.empty(surface.shape[1] + COATING_TAPS.size - 1, np.float32), across, out)
    return out


@jit_finite
def _smooth(surface, padded, across, out):
    ny, nx = surface.shape
    reach, (t0, t1, t2, t3, t4) = COATING_TAPS.size // 2, COATING_TAPS
    for i in range(ny):
        row, smooth, p = surface[i], across[i], padded
        for j in range(nx):
            p[j + reach] = row[j]
        for j in range(reach):
            p[j], p[reach + nx + j] = row[0], row[nx - 1]
        for j in range(nx):
            smooth[j] = t0 * p[j] + t1 * p[j + 1] + t2 * p[j + 2] + t3 * p[j + 3] + t4 * p[j + 4]
    for i in range(ny):
        smooth, a, b, c = out[i], across[max(i - 2, 0)], across[max(i - 1, 0)], across[i]
        d, e = across[min(i + 1, ny - 1)], across[min(i + 2, ny - 1)]
        for j in range(nx):
            smooth[j] = t0 * a[j] + t1 * b[j] + t2 * c[j] + t3 * d[j] + t4 * e[j]


@jit_finite
def incidence(
    z, sight, stride, shadowed, leds, reach_mm, across, down, distance, x0, y0, pitch, region,
    steps, cells, lines, depth, cosine, weight,
):  # fmt: skip
    """Fill a region of depth (S), cosine m_k and weight V_k m_k (REACH / d_k)^2 (LEDs, S) where the
    rays meet the gel.

    z: heights (G). sight: (LEDs, C) visible fractions of the LEDs' discs, 1 outside each LED's
    region of G, shadowed (LEDs, 4). leds: (LEDs, 3). depth: initially z of the gel at rest. across,
    down: slopes of the samples' rays. distance: from the pinhole to the apex; x0, y0: center of G's
    first cell. A ray starts from the displacement in the row above. cells: (columns of S) uint32;
    lines: (8, columns of S) zeros.
    """
    # each row in passes, which are either vectorized or read at scattered places
    per_mm, reach2 = _ONE / pitch, reach_mm * reach_mm
    per_slope = per_mm / _TWO
    first, end = region[2], region[3]
    across = across[first:end]
    slope_x, slope_y, part, moved = lines[0], lines[1], lines[2], lines[3]
    rows, columns, u, v, found, start = lines[4], lines[5], lines[6], lines[7], slope_x, slope_y
    shift, per_cell = np.float32(0.5 * (stride - 1)), np.float32(1.0 / stride)
    points, width = z.ravel(), np.uint32(z.shape[1])
    last_i, last_j = np.int32(z.shape[0] - 3), np.int32(z.shape[1] - 3)
    for row in range(region[0], region[1]):
        heights = depth[row, first:end]
        for n in range(across.size):
            start[n] = heights[n] + moved[n]
        for _ in range(steps + 1):
            for n in range(across.size):
                reached = distance + start[n]
                rows[n] = (down[row] * reached - y0) * per_mm
                columns[n] = (across[n] * reached - x0) * per_mm
                cells[n], u[n], v[n] = _cell(rows[n], columns[n], last_i, last_j, width)
            missed = 0
            for n in range(across.size):
                found[n] = _between(points, width, cells[n], u[n], v[n])
                missed += not abs(found[n] - start[n]) < RAY_TOLERANCE_MM
            if missed == 0:
                break
            for n in range(across.size):  # places that are found stay
                is_found = abs(found[n] - start[n]) < RAY_TOLERANCE_MM
                start[n] = start[n] if is_found else found[n]
        for n in range(across.size):
            moved[n] = found[n] - heights[n]
            heights[n] = found[n]
        for n in range(across.size):
            slope_x[n], slope_y[n] = slopes(points, width, cells[n], u[n], v[n], per_slope)
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
def _cell(row, column, last_i, last_j, width):
    """The cell of a raveled grid at a place, in cells, but within the rim, last_i and last_j, and
    the place in it. Unsigned indices save checks."""
    i, j = min(max(np.int32(row), _RIM), last_i), min(max(np.int32(column), _RIM), last_j)
    cell = np.uint32(np.uint32(i) * width + np.uint32(j))
    return cell, row - np.float32(i), column - np.float32(j)


@inlined
def _between(points, width, cell, u, v):
    """A grid, raveled, interpolated in a cell."""
    below = cell + width
    return bilinear(points[cell], points[cell + _STEP], points[below], points[below + _STEP], u, v)


@inlined
def slopes(points, width, cell, u, v, per_slope):
    """dz/dx and dz/dy: central differences at the corners of a cell, interpolated."""
    p, q = _ONE - u, _ONE - v
    above, below, last = cell - width, cell + width, cell + width + width
    here, right, under = points[cell], points[cell + _STEP], points[below]
    opposite = points[below + _STEP]
    along_x = per_slope * (
        p * (q * (right - points[cell - _STEP]) + v * (points[cell + _STEPS] - here))
        + u * q * (opposite - points[below - _STEP])
        + u * v * (points[below + _STEPS] - under)
    )
    along_y = per_slope * (
        q * (p * (under - points[above]) + u * (points[last] - here))
        + v * p * (opposite - points[above + _STEP])
        + v * u * (points[last + _STEP] - right)
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
def light(cosine, weight, gain, blended, total, rest, region, seen):
    """Fill a region of seen (RGB, S) with the LEDs' light minus rest (RGB, S).

    gain: (rows of S at GAIN_STRIDE, LEDs * RGB * COSINE_TERMS, columns of S), interpolated linearly
    between its rows. blended, like one of them, and total, columns of the region, are work arrays.
    """
    first, end, colors = region[2], region[3], seen.shape[0]
    for row in range(region[0], region[1]):
        above = row // GAIN_STRIDE
        apart = max(min(GAIN_STRIDE, cosine.shape[1] - 1 - GAIN_STRIDE * above), 1)
        part, gains = np.float32(row % GAIN_STRIDE) / np.float32(apart), gain[above]
        if part > _ZERO:
            upper, lower, gains = gains, gain[above + 1], blended
            for k in range(blended.shape[0]):
                mixed, high, low = blended[k], upper[k], lower[k]
                for n in range(mixed.size):
                    mixed[n] = high[n] + part * (low[n] - high[n])
        for c in range(colors):
            filled, less = seen[c, row, first:end], rest[c, row, first:end]
            for n in range(total.size):
                total[n] = -less[n]
            for k in range(cosine.shape[0]):
                cosines, weights = cosine[k, row, first:end], weight[k, row, first:end]
                at = (k * colors + c) * COSINE_TERMS
                g0, g1 = gains[at, first:end], gains[at + 1, first:end]
                g2, g3 = gains[at + 2, first:end], gains[at + 3, first:end]
                for n in range(total.size):
                    m = cosines[n]
                    total[n] += weights[n] * (g0[n] + m * (g1[n] + m * (g2[n] + m * g3[n])))
            for n in range(total.size):
                filled[n] = total[n]


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
    points, width = z.ravel(), np.uint32(z.shape[1])
    last_i, last_j = np.int32(z.shape[0] - 3), np.int32(z.shape[1] - 3)
    for row in range(region[0], region[1]):
        for n in range(region[2], region[3]):
            reached = distance + depth[row, n]
            fi, fj = (down[row] * reached - y0) * per_mm, (across[n] * reached - x0) * per_mm
            cell, u, v = _cell(fi, fj, last_i, last_j, width)
            sx, sy = slopes(points, width, cell, u, v, per_slope)
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
        even = (window[1] - window[0] + 1) // 2  # rows, which come first; in each its even columns
        for turn in range(2 * (window[1] - window[0])):
            place, odd = (turn // 2, 0) if turn < 2 * even else (turn // 2 - even, 1)
            i, first = window[0] + 2 * place + odd, window[2] + turn % 2
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
                # the part of a disc above a chord: an odd cubic, to 0.01
                share = 0.5 + cut * (0.6366 - 0.1366 * cut * cut)
                seen[i, j] = share if cut > -_ONE else 0.0
                top, bottom = min(top, i), max(bottom, i + 1)
                left, right = min(left, j), max(right, j + 1)
        if bottom > top:
            shadowed[k, 0], shadowed[k, 1] = top, bottom
            shadowed[k, 2], shadowed[k, 3] = left, right


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
