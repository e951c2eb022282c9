"""LEDs beside a gel: place, size, color, beam."""

from typing import Annotated

import numpy as np
from msgspec import Meta, Struct

from t2twin.core.errors import T2TwinError

FARTHEST_MM, LARGEST_LED_MM = 200.0, 50.0
"""Largest distance of an LED from the sensor's axis, and largest radius of one, mm (assumed)."""

Radiance = Annotated[float, Meta(ge=0.0, le=100.0)]
Coordinate = Annotated[float, Meta(ge=-FARTHEST_MM, le=FARTHEST_MM)]
Beam = Annotated[float, Meta(gt=0.0, le=90.0)]
LedDistance = Annotated[float, Meta(ge=1.0, le=FARTHEST_MM)]


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
    size_mm: Annotated[
        float, Meta(ge=0.0, le=LARGEST_LED_MM, description="radius of the luminous disc")
    ]
    aim_mm: Annotated[
        tuple[Coordinate, Coordinate, Coordinate],
        Meta(description="a point on the beam's axis"),
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
        turn = index * GOLDEN_ANGLE_RAD
        angle = np.radians(self.angle_deg)
        sideways = np.array([np.sin(angle), np.cos(angle), 0.0])
        upwards = np.array([0.0, 0.0, 1.0])
        offsets = radius[:, None] * (
            np.cos(turn)[:, None] * sideways + np.sin(turn)[:, None] * upwards
        )
        return self.position_mm + offsets


GOLDEN_ANGLE_RAD = np.pi * (3.0 - np.sqrt(5.0))
"""Angle between consecutive points of the spiral, rad (Vogel 1979)."""
REACH_MM = 22.0
"""Distance of an LED at which its color is defined, mm: that of the axis."""
