"""What goes into a press and what comes out: the command, the pins, the contact.

Frames are those of t2twin.primitives_cad.shape. Every grid is rows x columns: row index rises with
y, column index with x.

Forces that may be commanded.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad.shape import Shape
from t2twin.sim.contact.elastomer import Elastomer


@dataclass(frozen=True)
class PressCommand:
    """One commanded press: where the shape's origin stands on the sensor, its turn, the force.

    x_mm, y_mm: position in the sensor frame, mm. yaw_rad: turn about the sensor's z.
    force_n: force along the press axis, N.
    Raises T2TwinError for values that are not numbers, and a place or turn that is not finite.
    """

    shape: str
    x_mm: float
    y_mm: float
    yaw_rad: float
    force_n: float

    def __post_init__(self) -> None:
        arguments.text(self.shape, "shape")
        for name in ("x_mm", "y_mm", "yaw_rad"):
            arguments.number(getattr(self, name), name)
        arguments.real(self.force_n, "force_n")  # its range is checked by the press


@dataclass(frozen=True)
class PinState:
    """The pins in use when a press has settled, all (n,): what `t2twin.sim.scene` draws.

    x_mm, y_mm, rest_mm: where the pins stand, and their tops untouched. deflection_mm: how far
    they are pressed. gap_mm: how far each was from the shape at first touch. spring_rest_mm,
    stiffness_n_per_mm: their springs. side_mm: of the blocks of the pad that they stand for.
    """

    x_mm: np.ndarray
    y_mm: np.ndarray
    rest_mm: np.ndarray
    gap_mm: np.ndarray
    deflection_mm: np.ndarray
    spring_rest_mm: np.ndarray
    stiffness_n_per_mm: np.ndarray
    side_mm: np.ndarray


@dataclass(frozen=True)
class Contact:
    """What one elastomer feels when a press has settled.

    shape, command, elastomer: what was pressed, how, and into what.
    pressure_kpa: (ny, nx) normal pressure, >= 0.
    x_mm: (nx,), y_mm: (ny,) the grid's axes in the sensor frame, mm, rising, equally spaced.
    contact_area_mm2: area of the shape that the surface touches.
    depth_mm: how far the shape has travelled from its first touch.
    shape_depth_mm: how far the shape's highest point lies below the apex of the untouched
        surface (the same as depth_mm on a flat layer).
    force_n: the force that the pressure really carries.
    settled: whether force and surface had stopped changing.
    bottomed: whether the shape met something other than the pressing surface's features:
        its base plate.
    pins: the bed of pins that carried the press.
    milliseconds: time the press took, without its surface.
    find_surface: works out surface_mm, which is done when it is first asked for: a CySkin feels
        the pressure alone.
    """

    shape: Shape
    command: PressCommand
    elastomer: Elastomer
    pressure_kpa: np.ndarray
    x_mm: np.ndarray
    y_mm: np.ndarray
    contact_area_mm2: float
    depth_mm: float
    shape_depth_mm: float
    force_n: float
    settled: bool
    bottomed: bool
    pins: PinState
    milliseconds: float
    find_surface: Callable[[], np.ndarray] = field(repr=False, compare=False)

    @cached_property
    def surface_mm(self) -> np.ndarray:
        """(ny, nx) float32: how far the surface has moved into the sensor, mm (negative: bulged
        out)."""
        return self.find_surface()

    @property
    def pitch_mm(self) -> float:
        return float(self.x_mm[1] - self.x_mm[0])


FORCE_RANGE_N = (0.01, 100.0)
"""Forces that may be commanded, N."""


def check_force(force_n: float) -> None:
    """Raises T2TwinError for a force that cannot be pressed."""
    low, high = FORCE_RANGE_N
    force_n = arguments.real(force_n, "force_n")
    if not low <= force_n <= high:
        raise T2TwinError(
            f"a force of {force_n:g} N cannot be pressed; allowed are {low:g} to {high:g} N"
        )
