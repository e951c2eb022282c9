"""Input and output of a press: the command, the pins, the contact.

Frames are those of t2twin.primitives_cad.shape. Every grid is rows x columns: the row index rises
with y, the column index with x.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from t2twin.core import arguments
from t2twin.core.arrays import Result, kept_property
from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad.shape import Shape
from t2twin.primitives_cad.tilt import MAX_TILT_DEG, quaternion_of, tilted
from t2twin.sim.contact.displacements import unfolded
from t2twin.sim.contact.elastomer import Elastomer, Friction
from t2twin.sim.contact.friction import partial_slip
from t2twin.sim.contact.grid import Window, interpolated
from t2twin.sim.contact.layer import DomedLayer, domed_layer

FORCE_RANGE_N = (0.01, 100.0)  # smallest and largest force that can be commanded, N
TILT = ("tilt_x_rad", "tilt_y_rad")  # fields of the tilt in PressCommand
MAX_YAW_DEG = 36_000.0  # largest yaw, 100 turns (assumed: more than a slide turns)
MAX_TILT_RAD = float(np.deg2rad(MAX_TILT_DEG))
# Area of a contact up to which it is not resolved, mm2: one cell of a grid of 0.25 mm. A point of a
# mesh that carries newtons has tens of MPa there, which no elastomer withstands.
SMALLEST_CONTACT_MM2 = 0.0625

# Limits of a contact, in words.
UNSETTLED = "the contact did not settle, so its pressure and depth are approximate"
SMALL = "the contact is smaller than the grid, so its pressure and depth are approximate"


@dataclass(frozen=True)
class PressCommand:
    """One commanded press: the shape's pose on the sensor, and the force.

    x_mm, y_mm: position of the shape's origin in the sensor frame. yaw_rad: rotation about the
    sensor's z. force_n: along the press axis. tilt_x_rad, tilt_y_rad: about the shape's origin,
    before the yaw, up to 30 degrees. Raises T2TwinError for values that are not finite numbers, and
    for a larger tilt or more than 100 turns.
    """

    shape: str
    x_mm: float
    y_mm: float
    yaw_rad: float
    force_n: float
    tilt_x_rad: float = 0.0
    tilt_y_rad: float = 0.0

    def __post_init__(self) -> None:
        arguments.text(self.shape, "shape")
        for name in ("x_mm", "y_mm"):
            arguments.number(getattr(self, name), name)
        most_rad = float(np.deg2rad(MAX_YAW_DEG + 1e-6))  # more by rounding
        arguments.number(self.yaw_rad, "yaw_rad", -most_rad, most_rad)
        for name in TILT:
            arguments.number(getattr(self, name), name, -MAX_TILT_RAD, MAX_TILT_RAD)
        arguments.real(self.force_n, "force_n")  # `solve_contact` checks its range

    @property
    def tilt_rad(self) -> tuple[float, float]:
        """The tilt about x and about y."""
        return self.tilt_x_rad, self.tilt_y_rad

    def tilted(self, shape: Shape) -> Shape:
        """A shape with the tilt of the press; the shape itself without a tilt."""
        return tilted(shape, self.tilt_x_rad, self.tilt_y_rad)


@dataclass(frozen=True, eq=False)
class SurfaceShift(Result):
    """Displacement of a layer's surface by shear, on the contact grid's axes."""

    x_mm: np.ndarray  # (nx,)
    y_mm: np.ndarray  # (ny,)
    values_mm: np.ndarray  # (2 or 3, ny, nx) along x, along y, and perhaps into the sensor

    def on(self, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
        """Values on other axes, (3, y, x) or (2, y, x), linear between the grid's points."""
        # Copies, as read-only arrays would compile the loops once more.
        axes = map(np.array, (self.y_mm, self.x_mm, y_mm, x_mm))
        return interpolated(np.array(self.values_mm, float, order="C"), *axes)


@dataclass(frozen=True, eq=False)
class PinState(Result):
    """The active pins of a solved press, all (n,): the state of MuJoCo's model in mm and N."""

    x_mm: np.ndarray
    y_mm: np.ndarray
    rest_mm: np.ndarray  # heights of their undeformed tops
    gap_mm: np.ndarray  # distances from the shape at first touch
    deflection_mm: np.ndarray
    spring_rest_mm: np.ndarray  # rest deflections of the springs
    stiffness_n_per_mm: np.ndarray  # of the springs
    side_mm: np.ndarray  # sides of the blocks of the pad that they represent


@dataclass(frozen=True, eq=False)
class Motion(Result):
    """What sliding and turning have done to a contact, on its grid.

    The arrays from `window` on are the response to the contact's pressure and traction in a window
    of the grid, from which the next step starts. They are None before the first step.
    """

    friction: tuple[Friction, ...]  # of each body in the step
    shear_mpa: np.ndarray  # (2, ny, nx) traction on the sensor along x and y
    slip_mm: np.ndarray  # (ny, nx) length of the shape's path over the surface so far
    window: Window | None = None
    middle_mm: float | None = None  # thickness of the layer whose response this is
    spread_mm: np.ndarray | None = None  # (2, rows, columns) displacement by the pressure
    parts_mm: np.ndarray | None = None  # (2, 3, rows, columns) displacement by the traction
    # (2, rows, columns) motion of the shape; None where forces were prescribed.
    travel_mm: np.ndarray | None = None
    # (3, rows, columns) displacement by shear, less that predicted for the step.
    error_mm: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class Contact(Result):
    """The contact of one shape with one elastomer: plain data, which can be copied and pickled.

    shape, command, elastomer: the press.
    pressure_kpa: (ny, nx) normal pressure, >= 0.
    x_mm: (nx,), y_mm: (ny,) the grid's axes in the sensor frame, mm, rising, equally spaced.
    contact_area_mm2: area of the shape in contact.
    depth_mm: travel of the shape from its first touch.
    shape_depth_mm: depth of the shape's highest point below the apex of the undeformed surface
        (equal to depth_mm on a flat layer).
    force_n: integral of the pressure, N.
    settled: whether the solver converged and resolves the contact (`smaller_than_grid`), in a slide
        also in all steps since the press.
    bottomed: whether the shape's base plate is in contact.
    milliseconds: computing time without surface_mm.
    equilibrium: the solver's Equilibrium, from which a contact close to this one is solved.
    shift: of the surface by shear when the shape was pressed; None without shear. surface_mm does
        not contain it.
    motion: the shear of a contact that has moved; None of a press, which has none.
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
    milliseconds: float
    equilibrium: Any = field(repr=False)
    shift: SurfaceShift | None = None
    motion: Motion | None = None

    def __repr__(self) -> str:
        return f"Contact({self.command.shape!r}, {self.elastomer.name}: {self.summary})"

    @property
    def summary(self) -> str:
        """The contact as one clause."""
        shear_n = "" if self.motion is None else f", shear {np.hypot(*self.shear_n):.3g} N"
        return (
            f"force {self.force_n:.3g} N{shear_n}, depth {self.depth_mm:.3g} mm, "
            f"area {self.contact_area_mm2:.3g} mm2, {'' if self.settled else 'not '}settled"
            f"{', smaller than the grid' if self.smaller_than_grid else ''}"
            f"{', bottomed' if self.bottomed else ''}"
        )

    @property
    def shape_pose(self) -> tuple[np.ndarray, np.ndarray]:
        """The shape in the sensor frame: quaternion w, x, y, z, (4,), and its origin, (3,) mm."""
        command = self.command
        rise_mm = command.tilted(self.shape).rise_mm
        quaternion = quaternion_of(command.tilt_x_rad, command.tilt_y_rad, command.yaw_rad)
        return quaternion, np.array([command.x_mm, command.y_mm, rise_mm - self.shape_depth_mm])

    @property
    def smaller_than_grid(self) -> bool:
        """Whether the contact is too small for the grid to resolve its pressure and depth."""
        return self.contact_area_mm2 <= SMALLEST_CONTACT_MM2

    @kept_property
    def surface_mm(self) -> np.ndarray:
        """(ny, nx) float32 deflection into the sensor, mm, computed at its first use."""
        return self.equilibrium.surface_mm().astype(np.float32)

    @kept_property
    def pins(self) -> PinState:
        """The pins that carry the force."""
        return self.equilibrium.pin_state()

    @property
    def moments_kpa_mm(self) -> np.ndarray:
        """(2, ny, nx) mean of pressure times distance from the cell's center, kPa mm."""
        return 1e3 * self.equilibrium.moments_mpa_mm

    @kept_property
    def owner(self) -> np.ndarray:
        """(ny, nx) index of the body that presses most on each cell; 0 where none presses."""
        return self.equilibrium.body_pressures_mpa.argmax(axis=0)

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of the bodies in contact."""
        return self.equilibrium.names

    @property
    def shear_layer(self) -> DomedLayer:
        """The tangential response of the elastomer under the contact, on the contact's grid."""
        return domed_layer(self.elastomer, self.x_mm, self.y_mm, self.pressure_kpa)

    @kept_property
    def sheared_mm(self) -> np.ndarray:
        """(3, ny, nx) displacement along x, y and into the sensor by shear alone, mm."""
        if self.motion is None:
            return np.zeros((3, *self.pressure_kpa.shape))
        return unfolded(self.shear_layer.response_mm(self.motion.shear_mpa), self.pitch_mm)

    @kept_property
    def displacement_mm(self) -> np.ndarray:
        """(3, ny, nx) float32 displacement along x, y and into the sensor by all loads, mm."""
        spread = self.shear_layer.spread_mm(1e-3 * self.pressure_kpa)
        by_pressure = np.stack([*spread, self.surface_mm])
        return (by_pressure + self.sheared_mm).astype(np.float32)

    @property
    def slip_mm(self) -> np.ndarray:
        """(ny, nx) length of the shape's path over the surface since the press, mm."""
        return np.zeros(self.pressure_kpa.shape) if self.motion is None else self.motion.slip_mm

    @property
    def pitch_mm(self) -> float:
        return float(self.x_mm[1] - self.x_mm[0])

    @property
    def shear_kpa(self) -> np.ndarray:
        """(2, ny, nx) tangential traction on the sensor along x and y, kPa."""
        if self.motion is None:
            return np.zeros((2, *self.pressure_kpa.shape))
        return 1e3 * self.motion.shear_mpa

    @property
    def shear_n(self) -> np.ndarray:
        """(2,) tangential force on the sensor along x and y, N."""
        return 1e-3 * self.shear_kpa.sum(axis=(1, 2)) * self.pitch_mm**2

    @property
    def torque_nmm(self) -> float:
        """Torque on the sensor about the shape's origin, clockwise in the image, N mm."""
        x, y = self.x_mm - self.command.x_mm, self.y_mm[:, None] - self.command.y_mm
        along_x, along_y = self.shear_kpa
        return float(1e-3 * (x * along_y - y * along_x).sum() * self.pitch_mm**2)

    @property
    def slip_shares(self) -> np.ndarray:
        """(ny, nx) share of each cell's contact at which the shape slips."""
        if self.motion is None:
            return np.zeros(self.pressure_kpa.shape)
        pressure_mpa = 1e-3 * self.pressure_kpa
        limit = limit_mpa(self.motion.friction, self.owner, pressure_mpa, self.elastomer)
        return partial_slip(self.motion.shear_mpa, limit)[0]

    @property
    def slipping(self) -> np.ndarray:
        """(ny, nx) bool: where the shape slips, the traction being at the limit of friction."""
        return (self.pressure_kpa > 0) & (self.slip_shares == 1.0)

    @property
    def slip_share(self) -> float:
        """Share of the area in contact at which the shape slips."""
        return float(np.average(self.slip_shares, weights=self.equilibrium.cover))


def limit_mpa(
    frictions: Sequence[Friction], owner: np.ndarray, pressure_mpa: np.ndarray, elastomer: Elastomer
) -> np.ndarray:
    """The largest traction on each cell, whose body is the owner, (rows, columns) index."""
    limits = np.stack([friction.limit_mpa(pressure_mpa, elastomer) for friction in frictions])
    return limits[0] if len(limits) == 1 else np.take_along_axis(limits, owner[None], 0)[0]


def check_force(force_n: float) -> None:
    """Raises T2TwinError for a force outside FORCE_RANGE_N."""
    low, high = FORCE_RANGE_N
    force_n = arguments.real(force_n, "force_n")
    if not low <= force_n <= high:
        raise T2TwinError(
            f"a force of {force_n:g} N cannot be pressed; allowed are {low:g} to {high:g} N"
        )
