"""LEDs beside a gel: place, size, color, beam."""

from dataclasses import dataclass

import numpy as np

from t2twin.core.errors import T2TwinError


@dataclass(frozen=True)
class Led:
    """One LED next to the gel, with its diffuser.

    color: (3,) linear RGB radiance of the gel's paint at normal incidence, REACH_MM away.
    angle_deg: place around the gel, counterclockwise in the image, 0 to the right.
    radius_mm: distance from the sensor's axis. z_mm: height, negative on the camera's side of
        the apex. Both are of the LED's image after refraction by the plate.
    size_mm: radius of the luminous disc.
    aim_mm: a point on the beam's axis. beam_rad: half angles between which the beam fades out.
    """

    color: tuple[float, float, float]
    angle_deg: float
    radius_mm: float
    z_mm: float
    size_mm: float
    aim_mm: tuple[float, float, float]
    beam_rad: tuple[float, float]

    def __post_init__(self) -> None:
        if self.radius_mm <= 0 or self.size_mm < 0:
            raise T2TwinError("an LED's radius_mm must be positive and its size_mm not negative")

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
        inner, outer = np.cos(self.beam_rad)
        return np.clip((cosine - outer) / (inner - outer), 0.0, 1.0) ** 2

    def points_mm(self, count: int) -> np.ndarray:
        """(count, 3) points of equal areas of the disc, on Vogel's spiral.

        The disc is vertical and faces the sensor's axis.
        """
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
