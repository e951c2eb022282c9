"""The DIGIT's three LEDs: places, sizes, colors."""

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

RADIUS_MM = 22.0  # assumed: next to the gel, and as far again for the light spread by the plate
SIZE_MM = 1.8  # assumed: an LED of 1 to 2 mm behind a diffuser, as seen from RADIUS_MM
BEAM_RAD = (np.radians(4.0), np.radians(26.0))  # assumed: a plain LED's lobe behind its slot

DIGIT_LEDS = (
    Led((1.20, 0.02, 0.06), 30.0, RADIUS_MM, -6.8, SIZE_MM, (-11.0, 0.5, -1.0), BEAM_RAD),  # red
    Led((0.03, 1.10, 0.02), 150.0, RADIUS_MM, -6.8, SIZE_MM, (11.0, 0.5, -1.0), BEAM_RAD),  # green
    Led((0.01, 0.10, 0.85), 270.0, RADIUS_MM, -4.9, SIZE_MM, (0.0, -6.0, -1.0), BEAM_RAD),  # blue
)
"""Angles: TACTO's configuration and the maker's notes. Heights: assumed, 12 to 17 degrees over the
apex, from the lengths of a real unit's shadows. Colors and beams: assumed, so that the background
resembles a real unit's."""

AMBIENT = (0.024, 0.030, 0.032)
"""Linear RGB of undirected light, scattered inside the sensor (assumed from the shadows of a real
unit)."""
