"""The record of a gel camera: a soft gel, lit from the side, seen by a camera behind it.

The sensor frame has x along the image's columns, y along its rows and z out of the gel, with the
origin at the apex of the gel at rest.
"""

from functools import cache
from typing import Annotated, Any, Literal, get_type_hints

import msgspec
import numpy as np
from msgspec import Meta, Struct, structs

from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.elastomer import LayerTable, MountTable, SensorName
from t2twin.sim.optical.camera import Camera, Distance, Scale
from t2twin.sim.optical.markers import Markers
from t2twin.sim.optical.optics import GAMMAS, MAX_LEDS

KIND = "gel-camera"
NO_OPTICS = "none"  # as light.optics: the LEDs alone light the gel

GOLDEN_ANGLE_RAD = np.pi * (3.0 - np.sqrt(5.0))  # of Vogel's spiral (Vogel 1979)
_type_hints = cache(get_type_hints)

Radiance = Annotated[float, Meta(ge=0.0, le=100.0)]
Coordinate = Annotated[float, Meta(ge=-200.0, le=200.0)]  # assumed
Beam = Annotated[float, Meta(gt=0.0, le=90.0)]
LedDistance = Annotated[float, Meta(ge=1.0, le=200.0)]  # assumed
Gamma = Annotated[float, Meta(ge=GAMMAS[0], le=GAMMAS[1])]
Elevation = Annotated[float, Meta(ge=5.0, le=80.0)]


class CameraTable(Camera, frozen=True, kw_only=True):
    """The camera and its images."""

    frames: Annotated[
        int, Meta(ge=1, le=10_000, description="frames averaged for an image of a press")
    ] = 1
    noise_grey: Annotated[
        float, Meta(ge=0.0, le=64.0, description="standard deviation of one frame, grey levels")
    ] = 0.0


class Led(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """One LED beside the gel, with its diffuser, after refraction by the plate.

    color: linear radiance of the gel's paint, REACH_MM away. size_mm: of a disc that is vertical
    and faces the sensor's axis.
    """

    color: Annotated[
        tuple[Radiance, Radiance, Radiance],
        Meta(description="linear red, green and blue at normal incidence, 22 mm away"),
    ]
    angle_deg: Annotated[
        float,
        Meta(ge=-360.0, le=360.0, description="around the gel, counterclockwise, 0 to the right"),
    ]
    radius_mm: Annotated[LedDistance, Meta(description="distance from the sensor's axis")]
    z_mm: Annotated[Coordinate, Meta(description="height, negative on the camera's side")]
    size_mm: Annotated[float, Meta(ge=0.0, le=50.0, description="radius of the luminous disc")]
    aim_mm: Annotated[
        tuple[Coordinate, Coordinate, Coordinate], Meta(description="a point on the beam's axis")
    ] = (0.0, 0.0, 0.0)
    beam_deg: Annotated[
        tuple[Beam, Beam], Meta(description="half angles between which the beam fades out")
    ] = (80.0, 90.0)

    def __post_init__(self) -> None:
        inner, outer = self.beam_deg
        if inner >= outer:
            raise T2TwinError(f"beam_deg is [{inner:g}, {outer:g}]; expected the smaller first")
        if np.allclose(self.position_mm, self.aim_mm):
            raise T2TwinError("aim_mm is the LED's own place; expected a point away from it")

    @property
    def position_mm(self) -> np.ndarray:
        """(3,) in the sensor frame (y points down in the image)."""
        angle = np.radians(self.angle_deg)
        return np.array(
            [self.radius_mm * np.cos(angle), -self.radius_mm * np.sin(angle), self.z_mm]
        )

    def in_beam(self, points_mm: np.ndarray) -> np.ndarray:
        """(...,) share of the LED's light that its beam leaves at points (..., 3), mm.

        glTF's spot light, as in pyrender.
        """
        axis = np.array(self.aim_mm) - self.position_mm
        ahead = points_mm - self.position_mm
        cosine = ahead @ axis / (np.linalg.norm(axis) * np.linalg.norm(ahead, axis=-1))
        inner, outer = np.cos(np.radians(self.beam_deg))
        return np.clip((cosine - outer) / (inner - outer), 0.0, 1.0) ** 2

    def points_mm(self, count: int) -> np.ndarray:
        """(count, 3) points of equal areas of the disc, on Vogel's spiral."""
        if count == 1:
            return self.position_mm[None]
        index = np.arange(count)
        radius = self.size_mm * np.sqrt((index + 0.5) / count)
        turn, angle = index * GOLDEN_ANGLE_RAD, np.radians(self.angle_deg)
        sideways = np.array([np.sin(angle), np.cos(angle), 0.0])
        upwards = np.array([0.0, 0.0, 1.0])
        disc = np.cos(turn)[:, None] * sideways + np.sin(turn)[:, None] * upwards
        return self.position_mm + radius[:, None] * disc


class LightTable(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The light: the optics file of a unit, or LEDs, which a bundled sensor's optics may render."""

    leds: Annotated[
        tuple[Led, ...], Meta(max_length=MAX_LEDS, description="LEDs, one table each")
    ] = ()
    ambient: Annotated[
        tuple[Radiance, Radiance, Radiance],
        Meta(description="linear red, green and blue of undirected light"),
    ] = (0.0, 0.0, 0.0)
    gamma: Annotated[Gamma, Meta(description="exponent between light and grey levels")] = 2.2
    optics: Annotated[
        str | None,
        Meta(description="optics file of `t2twin calibrate`, or name of a sensor of equal LEDs"),
    ] = None

    def __post_init__(self) -> None:
        if self.optics == NO_OPTICS:
            structs.force_setattr(self, "optics", None)
        if not self.leds and self.optics is None:
            raise T2TwinError("expected at least one of leds and optics")


class Ranges(Struct, frozen=True, forbid_unknown_fields=True):
    """Ranges, low and high, of what is sampled; also shares. Raises T2TwinError for a range that is
    reversed or out of bounds."""

    def __post_init__(self) -> None:
        for name, kind in _type_hints(type(self), include_extras=True).items():
            value = getattr(self, name)
            try:
                msgspec.convert(value, kind)
            except msgspec.ValidationError as error:
                raise T2TwinError(f"{name}: {error}") from None
            if isinstance(value, tuple) and value[0] > value[1]:
                low, high = value
                raise T2TwinError(f"{name} is [{low:g}, {high:g}]; expected low first")


class UnitsTable(Ranges, frozen=True, omit_defaults=True):
    """Ranges in which units of this sensor differ, for recipes that sample them."""

    scale_px_per_mm: Annotated[tuple[Scale, Scale], Meta(description="image scale")]
    distance_mm: Annotated[tuple[Distance, Distance], Meta(description="camera's distance")]
    led_distance_mm: Annotated[
        tuple[LedDistance, LedDistance], Meta(description="distance of the LEDs from the axis")
    ]
    led_elevation_deg: Annotated[
        tuple[Elevation, Elevation], Meta(description="elevation of the LEDs over the gel's apex")
    ]


class GelCameraSpec(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """A gel camera's file."""

    kind: Annotated[Literal["gel-camera"], Meta(description="kind of the sensor")]
    name: SensorName
    gel: Annotated[LayerTable, Meta(description="the gel")]
    camera: Annotated[CameraTable, Meta(description="the camera")]
    light: Annotated[LightTable, Meta(description="the light")]
    mount: Annotated[MountTable, Meta(description="the sensor as a body")]
    units: Annotated[UnitsTable | None, Meta(description="how units differ")] = None
    markers: Annotated[Markers | None, Meta(description="markers, if there may be any")] = None
    about: Annotated[str | None, Meta(description="remark, which is not read")] = None

    def __post_init__(self) -> None:
        camera = self.camera
        self._check_view("the camera", camera.scale_px_per_mm, camera.distance_mm)
        if self.units is not None:
            self.ranges(self.units)
        for name in ("scale_px_per_mm", "distance_mm") if self.units else ():
            (low, high), own = getattr(self.units, name), getattr(camera, name)
            if not low <= own <= high:
                raise T2TwinError(
                    f"units.{name} is [{low:g}, {high:g}]; expected a range that contains "
                    f"camera.{name}, {own:g}"
                )

    def ranges(self, own: Any) -> Any:
        """Ranges of units, those of [units] for each None. Raises as _check_view."""
        of_file = structs.asdict(self.units) if self.units is not None else {}
        missing = {name: value for name, value in of_file.items() if getattr(own, name) is None}
        found = structs.replace(own, **missing)
        self._check_view("a unit's camera", found.scale_px_per_mm[0], found.distance_mm[0])
        return found

    def _check_view(self, which: str, scale_px_per_mm: float, distance_mm: float) -> None:
        """Raises T2TwinError for a camera that is inside the gel, or sees beyond it."""
        camera, gel = self.camera, self.gel
        if distance_mm <= gel.thickness_mm:
            found = f"{which} is {distance_mm:g} mm from the apex, inside the gel"
            raise T2TwinError(f"{found}; expected distance_mm above {gel.thickness_mm:g}")
        sides = (camera.columns, gel.width_mm, "width"), (camera.rows, gel.length_mm, "length")
        for pixels, side_mm, axis in sides:
            if (seen_mm := pixels / scale_px_per_mm) > side_mm:
                raise T2TwinError(
                    f"{which} sees {seen_mm:.1f} mm of the gel's {axis}, which is {side_mm:g} mm; "
                    "expected a larger scale_px_per_mm, a smaller image or a larger gel"
                )
