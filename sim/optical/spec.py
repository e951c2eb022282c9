"""The record of a gel camera: a soft gel, lit from the side, seen by a camera behind it.

The sensor frame has x along the image's columns, y along its rows and z out of the gel, with the
origin at the apex of the gel at rest.
"""

from typing import Annotated, Literal

from msgspec import Meta, Struct

from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.spec import LayerTable, MountTable, SensorName
from t2twin.sim.optical.camera.pinhole import LENGTHS, MAX_MISALIGNMENT, Camera
from t2twin.sim.optical.light.leds import Led, LedDistance, Radiance
from t2twin.sim.optical.markers import Markers
from t2twin.sim.optical.optics import DISTANCES_MM, MAX_LEDS, SCALES_PX_PER_MM

KIND = "gel-camera"

MAX_PIXELS = 1600
"""Limit on the rows and on the columns of an image (assumed: makers' interfaces give less)."""

Pixels = Annotated[int, Meta(ge=16, le=MAX_PIXELS, multiple_of=2)]
Scale = Annotated[float, Meta(ge=SCALES_PX_PER_MM[0], le=SCALES_PX_PER_MM[1])]
Distance = Annotated[float, Meta(ge=DISTANCES_MM[0], le=DISTANCES_MM[1])]
Shift = Annotated[
    float, Meta(ge=-MAX_MISALIGNMENT["shift_x_px"], le=MAX_MISALIGNMENT["shift_x_px"])
]
Tilt = Annotated[float, Meta(ge=-MAX_MISALIGNMENT["tilt_x_deg"], le=MAX_MISALIGNMENT["tilt_x_deg"])]
Elevation = Annotated[float, Meta(ge=5.0, le=80.0)]


class CameraTable(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The camera, a pinhole on the sensor's axis, and its images."""

    rows: Annotated[Pixels, Meta(description="rows of an image, along y")]
    columns: Annotated[Pixels, Meta(description="columns of an image, along x")]
    scale_px_per_mm: Annotated[Scale, Meta(description="image scale at the gel's apex")]
    distance_mm: Annotated[Distance, Meta(description="from the pinhole to the gel's apex")]
    rate_hz: Annotated[float, Meta(gt=0.0, le=1e4, description="frames per second")]
    frames: Annotated[
        int, Meta(ge=1, le=10_000, description="frames averaged for an image of a press")
    ] = 1
    noise_grey: Annotated[
        float, Meta(ge=0.0, le=64.0, description="standard deviation of one frame, grey levels")
    ] = 0.0
    shift_x_px: Annotated[Shift, Meta(description="position of the axis, right of the middle")] = (
        0.0
    )
    shift_y_px: Annotated[Shift, Meta(description="the same, down")] = 0.0
    tilt_x_deg: Annotated[Tilt, Meta(description="rotation of the gel about x")] = 0.0
    tilt_y_deg: Annotated[Tilt, Meta(description="the same about y")] = 0.0

    @property
    def camera(self) -> Camera:
        names = ("rows", "columns", *LENGTHS, *MAX_MISALIGNMENT)
        return Camera(**{name: getattr(self, name) for name in names})


class LightTable(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The light of one unit: an optics file, LEDs, or both, which then describe the same light."""

    leds: Annotated[
        tuple[Led, ...], Meta(max_length=MAX_LEDS, description="LEDs, one table each")
    ] = ()
    ambient: Annotated[
        tuple[Radiance, Radiance, Radiance],
        Meta(description="linear red, green and blue of undirected light"),
    ] = (0.0, 0.0, 0.0)
    gamma: Annotated[
        float, Meta(ge=0.5, le=4.0, description="exponent between light and grey levels")
    ] = 2.2
    optics: Annotated[
        str | None, Meta(description="optics file of `t2twin calibrate`, beside the sensor's file")
    ] = None

    def __post_init__(self) -> None:
        if not self.leds and self.optics is None:
            raise T2TwinError("expected at least one of leds and optics")


class UnitsTable(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """Ranges, low and high, in which units of this sensor differ, for recipes that sample them."""

    scale_px_per_mm: Annotated[tuple[Scale, Scale], Meta(description="image scale")]
    distance_mm: Annotated[tuple[Distance, Distance], Meta(description="camera's distance")]
    led_distance_mm: Annotated[
        tuple[LedDistance, LedDistance], Meta(description="distance of the LEDs from the axis")
    ]
    led_elevation_deg: Annotated[
        tuple[Elevation, Elevation], Meta(description="elevation of the LEDs over the gel's apex")
    ]

    def __post_init__(self) -> None:
        for name in self.__struct_fields__:
            low, high = getattr(self, name)
            if low > high:
                raise T2TwinError(f"{name} is [{low:g}, {high:g}]; expected low first")


class MarkersTable(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """Markers that may be printed on the gel, a grid of round dots."""

    pitch_mm: Annotated[float, Meta(ge=0.5, le=8.0, description="distance of neighbors")]
    diameter_mm: Annotated[float, Meta(ge=0.05, le=8.0, description="diameter")]
    columns: Annotated[
        int | None, Meta(description="dots along x; all that the image shows, without it")
    ] = None
    rows: Annotated[int | None, Meta(description="the same along y")] = None

    def __post_init__(self) -> None:
        self.markers()

    def markers(self) -> Markers:
        grid = None if self.columns is None or self.rows is None else (self.columns, self.rows)
        if grid is None and (self.columns, self.rows) != (None, None):
            raise T2TwinError("columns and rows of markers: expected both or none")
        return Markers(self.pitch_mm, self.diameter_mm, grid=grid)


class GelCameraSpec(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """A gel camera's file."""

    kind: Annotated[Literal["gel-camera"], Meta(description="kind of the sensor")]
    name: SensorName
    gel: Annotated[LayerTable, Meta(description="the gel")]
    camera: Annotated[CameraTable, Meta(description="the camera")]
    light: Annotated[LightTable, Meta(description="the light")]
    mount: Annotated[MountTable, Meta(description="the sensor as a body")]
    units: Annotated[UnitsTable | None, Meta(description="how units differ")] = None
    markers: Annotated[MarkersTable | None, Meta(description="markers, if there may be any")] = None
    about: Annotated[str | None, Meta(description="remark, which is not read")] = None

    def __post_init__(self) -> None:
        camera = self.camera
        scales = [("the camera", "camera", camera.scale_px_per_mm)]
        if self.units is not None:
            scales.append(("a unit's camera", "units", self.units.scale_px_per_mm[0]))
        for which, table, scale in scales:
            for pixels, side, axis in (
                (camera.columns, self.gel.width_mm, "width"),
                (camera.rows, self.gel.length_mm, "length"),
            ):
                if pixels / scale > side:
                    raise T2TwinError(
                        f"{which} sees {pixels / scale:.1f} mm of the gel's {axis}, which is "
                        f"{side:g} mm; expected a larger {table}.scale_px_per_mm, a smaller image "
                        "or a larger gel"
                    )
        for name in ("scale_px_per_mm", "distance_mm") if self.units else ():
            (low, high), own = getattr(self.units, name), getattr(camera, name)
            if not low <= own <= high:
                raise T2TwinError(
                    f"units.{name} is [{low:g}, {high:g}]; expected a range that contains "
                    f"camera.{name}, {own:g}"
                )
