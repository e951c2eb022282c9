"""A sensor's camera, a pinhole behind the gel, and the grid of the gel's deflection.

Frame: the sensor frame of t2twin.primitives_cad.shape, with z = 0 at the apex of the gel at rest.
The camera is at z = -distance_mm on the axis and points along +z. The center of pixel (row, column)
is at these integer coordinates. A shift moves the whole image by pixels. A tilt rotates the gel
about its apex: it adds a plane to the surface at rest, while the camera and the LEDs stay.
"""

from functools import lru_cache
from typing import Annotated, get_type_hints

import numpy as np
from msgspec import Meta, Struct

from t2twin.core import arguments
from t2twin.sim.contact.elastomer import Elastomer

GRID_PITCH_MM = 0.1
"""Pitch of the optical grid, mm: two pixels at 20 px/mm (assumed; half of it changes its image
little)."""
PARALLAX_STEPS = 6
"""Fixed-point steps of the intersection of ray and gel. Each multiplies the error by the slopes of
surface and ray (at most 0.4); the remaining error is below 0.01 mm."""
MAX_PIXELS = 1600  # rows and columns of an image (assumed: makers' interfaces give less)

Pixels = Annotated[int, Meta(ge=16, le=MAX_PIXELS)]
Scale = Annotated[float, Meta(ge=5.0, le=100.0)]  # assumed: public files have 17.2 to 19.6 px/mm
Distance = Annotated[float, Meta(ge=5.0, le=100.0)]  # assumed: these have 20.8 to 22 mm
Shift = Annotated[float, Meta(ge=-100.0, le=100.0)]  # assumed: 5 mm of a DIGIT
Tilt = Annotated[float, Meta(ge=-5.0, le=5.0)]  # assumed: clearly visible


class Camera(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """A pinhole on the sensor's axis. Raises T2TwinError for values out of range.

    Positive tilts move the gel's lower and right part away from the camera.
    """

    rows: Annotated[Pixels, Meta(description="rows of an image, along y")]
    columns: Annotated[Pixels, Meta(description="columns of an image, along x")]
    scale_px_per_mm: Annotated[Scale, Meta(description="image scale at the gel's apex")]
    distance_mm: Annotated[Distance, Meta(description="from the pinhole to the gel's apex")]
    shift_x_px: Annotated[Shift, Meta(description="position of the axis, right of the middle")] = (
        0.0
    )
    shift_y_px: Annotated[Shift, Meta(description="the same, down")] = 0.0
    tilt_x_deg: Annotated[Tilt, Meta(description="rotation of the gel about x")] = 0.0
    tilt_y_deg: Annotated[Tilt, Meta(description="the same about y")] = 0.0

    def __post_init__(self) -> None:
        for name, (low, high) in LIMITS.items():
            arguments.number(getattr(self, name), name, low, high)
        for name in ("rows", "columns"):
            arguments.whole_number(getattr(self, name), name, 2)

    @property
    def focal_px(self) -> float:
        """Focal length, px."""
        return self.scale_px_per_mm * self.distance_mm

    @property
    def middle(self) -> tuple[float, float]:
        """Row and column of the sensor's axis in the image, px."""
        return (self.rows - 1) / 2 + self.shift_y_px, (self.columns - 1) / 2 + self.shift_x_px

    def tilt_mm(self, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
        """The tilt's contribution to the gel's z, mm; x_mm and y_mm are broadcast."""
        along_x, along_y = np.tan(np.radians([self.tilt_y_deg, self.tilt_x_deg]))
        return along_x * x_mm + along_y * y_mm

    def rest_mm(self, gel: Elastomer, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
        """z of a gel at rest, with the tilt, mm."""
        return gel.rest_surface_mm(x_mm, y_mm) + self.tilt_mm(x_mm, y_mm)

    def project(
        self, x_mm: np.ndarray, y_mm: np.ndarray, z_mm: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """(rows, columns), px, of points in the sensor frame, mm, of any shape."""
        per_mm = self.focal_px / (self.distance_mm + z_mm)
        row, column = self.middle
        return row + per_mm * y_mm, column + per_mm * x_mm

    def seen_half_extent_mm(self) -> tuple[float, float]:
        """(half width, half height), mm, of the image at the height of the apex, without shift."""
        return self.columns / 2 / self.scale_px_per_mm, self.rows / 2 / self.scale_px_per_mm

    def is_seen(
        self, x_mm: np.ndarray, y_mm: np.ndarray, margin_mm: float, highest_mm: float = 0.0
    ) -> tuple[np.ndarray, np.ndarray]:
        """Whether the image can contain places along x and along y, bool arrays. margin_mm:
        added at the edges. highest_mm: z of the point farthest from the camera."""
        widened = 1.0 + max(highest_mm, 0.0) / self.distance_mm
        half_width, half_height = (half * widened for half in self.seen_half_extent_mm())
        across, down = (
            shift / self.scale_px_per_mm * widened for shift in (self.shift_x_px, self.shift_y_px)
        )
        return (
            np.abs(x_mm + across) < half_width + margin_mm,
            np.abs(y_mm + down) < half_height + margin_mm,
        )

    def gel_points(
        self, gel: Elastomer, columns: np.ndarray, rows: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Where rays meet a gel at rest: x, y, z in mm, (rows, columns) each; columns, rows: pixel
        coordinates, which may be fractional and outside the image."""
        across, down = np.meshgrid(
            (columns - self.middle[1]) / self.focal_px, (rows - self.middle[0]) / self.focal_px
        )
        z = np.zeros_like(across)
        for _ in range(PARALLAX_STEPS):
            x, y = across * (self.distance_mm + z), down * (self.distance_mm + z)
            z = self.rest_mm(gel, x, y)
        return across * (self.distance_mm + z), down * (self.distance_mm + z), z


LIMITS: dict[str, tuple[float, float]] = {
    name: (kind.__metadata__[0].ge, kind.__metadata__[0].le)
    for name, kind in get_type_hints(Camera, include_extras=True).items()
    if name not in ("rows", "columns")
}
"""Lowest and highest value of each field but the size of the image."""


@lru_cache(maxsize=8)
def optical_grid(gel: Elastomer) -> tuple[np.ndarray, np.ndarray]:
    """Axes of the optics' grid of the gel's deflection: x_mm (nx,) and y_mm (ny,), cell centers,
    rising, GRID_PITCH_MM apart, symmetric about 0 and covering the gel."""
    counts = (round(side_mm / GRID_PITCH_MM) for side_mm in (gel.width_mm, gel.length_mm))
    x, y = ((np.arange(count) - (count - 1) / 2) * GRID_PITCH_MM for count in counts)
    x.flags.writeable = y.flags.writeable = False
    return x, y
