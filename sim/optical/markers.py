"""Markers printed on the gel's coating: dark dots that move with the surface.

A point at X on the surface at rest moves to X + u(X), where u is the lateral displacement by
pressure and shear. A marker's center and four points of its outline move so. The camera sees these
points on the deflected surface, and the marker as the ellipse through the four.

In linear light, a pixel's value is multiplied by 1 - c (1 - INK_REFLECTANCE), where c is the part
of the pixel that markers cover. So the grey level is multiplied by that to the power of 1 / gamma.
"""

from math import floor
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct, structs

from t2twin.core import arguments
from t2twin.core.arrays import kept_property
from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.types import Contact, SurfaceShift
from t2twin.sim.optical.camera import Camera, optical_grid
from t2twin.sim.optical.compiled import at_places, jit

PITCH_MM = 1.4
"""Default distance of neighboring markers, mm: 27 px at 19.58 px/mm, the DIGIT with markers of FOTS
(Zhao et al., IEEE RA-L 2024)."""
DIAMETER_MM = 0.5  # default diameter of a marker, mm (assumed: about a third of the pitch)
INK_REFLECTANCE = 0.05  # of black ink, relative to the coating without ink (assumed)
PRINTED_MARGIN_MM = 2.0  # outside the image: shear or a camera's shift moves these in (assumed)
MAX_ALONG = 700
"""Limit on the markers along a side: those of the largest image at the smallest scale and pitch."""
LINES = 3
"""Lines per row of pixels on which the covered length is computed (assumed). The sum over a row is
exact."""
SHADES = 1025  # factors over the clear part of a pixel, less than a grey level apart
OUTLINE = np.array([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
"""Center and four points of the outline of a marker of radius 1."""
NO_SHADE = np.ones((0, 0), dtype=np.float32)  # the shade of a gel without markers


class Markers(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True, dict=True):
    """A grid of round markers on the part of the gel that the image shows, and around it.

    pitch_mm: distance of neighboring markers along x and along y, 0.5 to 8. diameter_mm: 0.05 to
    the pitch. jitter_mm: largest offset of a marker from the grid along x and along y, uniformly
    distributed, 0 to half of the distance between two markers' outlines. seed: of the jitter.
    columns, rows: markers along x and y; None for as many as cover the image of a sensor.
    Raises T2TwinError for values out of range.
    """

    pitch_mm: Annotated[float, Meta(ge=0.5, le=8.0, description="distance of neighbors")] = PITCH_MM
    diameter_mm: Annotated[float, Meta(ge=0.05, le=8.0, description="diameter")] = DIAMETER_MM
    jitter_mm: Annotated[float, Meta(ge=0.0, le=4.0, description="offset from the grid")] = 0.0
    seed: Annotated[int, Meta(ge=0, description="seed of the offsets")] = 0
    columns: Annotated[
        int | None, Meta(description="dots along x; all that the image shows, without it")
    ] = None
    rows: Annotated[int | None, Meta(description="the same along y")] = None

    def __post_init__(self) -> None:
        pitch = arguments.number(self.pitch_mm, "the markers' pitch_mm", 0.5, 8.0)
        diameter = arguments.number(self.diameter_mm, "the markers' diameter_mm", 0.05, pitch)
        most = round((pitch - diameter) / 2, 9)
        jitter = arguments.number(self.jitter_mm, "the markers' jitter_mm", 0.0, most)
        arguments.check_seed(self.seed)
        if self.seed and not jitter:
            raise T2TwinError("the markers' seed has no effect without jitter_mm; give both")
        if (self.columns is None) != (self.rows is None):
            raise T2TwinError("columns and rows of markers: expected both or none")
        for count in () if self.columns is None else (self.columns, self.rows):
            arguments.whole_number(count, "the markers' columns and rows", 1, MAX_ALONG)
        values = {"pitch_mm": pitch, "diameter_mm": diameter, "jitter_mm": jitter}
        for name, value in (values | {"seed": int(self.seed)}).items():
            structs.force_setattr(self, name, value)  # plain numbers, for JSON

    def printed(self, camera: Camera) -> "Markers":
        """These markers on what a camera sees and PRINTED_MARGIN_MM around it."""
        if self.columns is not None:
            return self
        columns, rows = (
            2 * floor((half + PRINTED_MARGIN_MM) / self.pitch_mm) + 1
            for half in camera.seen_half_extent_mm()
        )
        return structs.replace(self, columns=columns, rows=rows)

    @kept_property
    def rest_mm(self) -> np.ndarray:
        """(n, 2) x and y of the centers on the gel at rest, row by row.

        Raises T2TwinError for markers without columns and rows that are on no sensor.
        """
        if self.columns is None or self.rows is None:
            raise T2TwinError(
                "the markers are on no sensor; expected those of a touch, touch.markers"
            )
        counts = self.columns, self.rows
        x, y = (self.pitch_mm * (np.arange(count) - (count - 1) / 2) for count in counts)
        centers = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        rng = np.random.default_rng(self.seed)
        return centers + rng.uniform(-self.jitter_mm, self.jitter_mm, centers.shape)

    def shade(
        self, camera: Camera, gel: Elastomer, rest_mm: np.ndarray, gamma: float, coated_mm:
        np.ndarray, shift: SurfaceShift | None,
    ) -> np.ndarray:  # fmt: skip
        """(rows, columns) float32 factors of the grey levels of the image without markers. rest_mm,
        coated_mm: (G) z of the gel at rest, and float32 deflection of the coating."""
        outlines = self.rest_mm[:, None] + self.diameter_mm / 2 * OUTLINE
        points = moved(outlines.reshape(-1, 2), shift)
        z_mm = _between((rest_mm - coated_mm)[None], *optical_grid(gel), points)[:, 0]
        seen = np.stack(camera.project(points[:, 0], points[:, 1], z_mm), axis=-1)
        center, right, left, below, above = np.moveaxis(seen.reshape(-1, len(OUTLINE), 2), 1, 0)
        factors = np.linspace(INK_REFLECTANCE, 1.0, SHADES) ** (1.0 / gamma)
        out = np.empty((camera.rows, camera.columns), dtype=np.float32)
        one, other = (right - left) / 2, (below - above) / 2
        _rasterize(center.copy(), one, other, factors.astype(np.float32), out)
        return out

    def seen_px(self, camera: Camera, contact: Contact) -> tuple[np.ndarray, np.ndarray]:
        """Where a camera sees the centers at rest and under a contact: (n, 2) rows and columns."""
        displacement = _displacement(self.rest_mm, surface_shift(contact))
        x, y = self.rest_mm.T
        z = camera.rest_mm(contact.elastomer, x, y)
        along_x, along_y, into = displacement.T
        rest, now = camera.project(x, y, z), camera.project(x + along_x, y + along_y, z - into)
        return np.stack(rest, axis=-1), np.stack(now, axis=-1)


def surface_shift(contact: Contact) -> SurfaceShift:
    """The displacement of a contact's surface by pressure and shear."""
    return SurfaceShift(contact.x_mm, contact.y_mm, contact.displacement_mm)


def moved(points_mm: np.ndarray, shift: SurfaceShift | None) -> np.ndarray:
    """(n, 2) points of a surface, (n, 2), where a shift has moved them; None for none."""
    return points_mm if shift is None else points_mm + _displacement(points_mm, shift)[:, :2]


def _displacement(points_mm: np.ndarray, shift: SurfaceShift) -> np.ndarray:
    """(n, 2 or 3) displacement of points of a surface, (n, 2)."""
    values = np.array(shift.values_mm, np.float32)
    return _between(values, shift.x_mm, shift.y_mm, points_mm)


def _between(
    grids: np.ndarray, x_mm: np.ndarray, y_mm: np.ndarray, points_mm: np.ndarray
) -> np.ndarray:
    """(n, k) values of grids (k, y, x) at points (n, 2), beyond the rim those at the rim."""
    per_x, per_y = 1.0 / (x_mm[1] - x_mm[0]), 1.0 / (y_mm[1] - y_mm[0])
    columns, rows = (points_mm[:, 0] - x_mm[0]) * per_x, (points_mm[:, 1] - y_mm[0]) * per_y
    return at_places(grids, rows, columns)


@jit
def _rasterize(center, one, other, factors, out):
    """Fill out (P) with the factors, of parts from 0 to 1, of the part of each pixel that is clear.
    center: (n, 2) px. one, other: (n, 2) conjugate half diameters of the markers' ellipses."""
    rows, columns = out.shape
    out[:] = np.float32(1.0)
    marked = np.zeros(rows, dtype=np.bool_)
    for n in range(center.shape[0]):
        height = np.hypot(one[n, 0], other[n, 0])
        if not height > 0.0:
            continue
        skew = (one[n, 0] * one[n, 1] + other[n, 0] * other[n, 1]) / height
        width = abs(one[n, 0] * other[n, 1] - one[n, 1] * other[n, 0]) / height
        # a pixel extends from its index to the next integer in these coordinates
        middle, across = center[n, 0] + 0.5, center[n, 1] + 0.5
        first = max(int(np.floor(middle - height)), 0)
        last = min(int(np.ceil(middle + height)), rows)
        top = min(max((first - middle) / height, -1.0), 1.0)
        area_above = np.arcsin(top) + top * np.sqrt(1.0 - top * top)
        for i in range(first, last):
            bottom = min(max((i + 1.0 - middle) / height, -1.0), 1.0)
            area = np.arcsin(bottom) + bottom * np.sqrt(1.0 - bottom * bottom)
            step, chords = (bottom - top) / LINES, 1e-12
            for k in range(LINES):
                chords += np.sqrt(1.0 - (top + (k + 0.5) * step) ** 2)
            part = np.float32(0.5 * height * (area - area_above) / chords)
            marked[i], row = True, out[i]
            for k in range(LINES):
                at = top + (k + 0.5) * step
                half = width * np.sqrt(1.0 - at * at)
                left = max(across + skew * at - half, 0.0)
                right = min(across + skew * at + half, float(columns))
                if left < right:
                    start, end = int(left), min(int(right), columns - 1)
                    row[start] += part * np.float32(left - start)
                    row[end] += part * np.float32(end + 1.0 - right)
                    for j in range(start, end + 1):
                        row[j] -= part
            top, area_above = bottom, area
    last_factor = np.float32(factors.size - 1)
    for i in np.flatnonzero(marked):
        for j in range(columns):
            clear = min(max(out[i, j], np.float32(0.0)), np.float32(1.0))
            out[i, j] = factors[int(clear * last_factor + np.float32(0.5))]
