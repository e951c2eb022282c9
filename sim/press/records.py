"""What passes between the parts of the bench: a press, what an elastomer felt, a paired sample.

Frames are those of t2twin.primitives_cad.shape. Every grid is rows x columns: row index rises with
y, column index with x.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class PressCommand:
    """One commanded press: where the shape's origin stands on the sensor, its turn, the force.

    x_mm, y_mm: position in the sensor frame, mm. yaw_rad: turn about the sensor's z.
    force_n: force along the press axis, N.
    """

    shape: str
    x_mm: float
    y_mm: float
    yaw_rad: float
    force_n: float


@dataclass(frozen=True)
class Contact:
    """What one elastomer feels at rest under a press.

    surface_mm: (ny, nx) how far the surface has moved into the sensor, mm (negative: bulged out).
    pressure_kpa: (ny, nx) normal pressure, >= 0.
    x_mm: (nx,), y_mm: (ny,) the grid's axes in the sensor frame, mm, rising, equally spaced.
    contact_area_mm2: area of the shape that the surface touches.
    depth_mm: how far the shape has travelled from its first touch.
    shape_depth_mm: how far the shape's highest point lies below the apex of the untouched
        surface (the same as depth_mm on a flat layer).
    force_n: the force that the pressure really carries.
    settled: whether both force and surface had come to rest.
    bottomed: whether the shape met something other than the pressing surface's features:
        its base plate.
    milliseconds: time the press took.
    """

    surface_mm: np.ndarray
    pressure_kpa: np.ndarray
    x_mm: np.ndarray
    y_mm: np.ndarray
    contact_area_mm2: float
    depth_mm: float
    shape_depth_mm: float
    force_n: float
    settled: bool
    bottomed: bool
    milliseconds: float

    @property
    def pitch_mm(self) -> float:
        return float(self.x_mm[1] - self.x_mm[0])


@dataclass(frozen=True)
class Sample:
    """One pair: the same press seen by the DIGIT and felt by the CySkin.

    image: (320, 240, 3) uint8. counts: (20,) uint16, or as many taxels as the layout has.
    """

    press: PressCommand
    image: np.ndarray
    counts: np.ndarray
    digit: Contact
    cyskin: Contact
