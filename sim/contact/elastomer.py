"""The sensors' soft layers and their tables in a sensor's file; the neo-Hookean law."""

from dataclasses import asdict, dataclass, fields
from typing import Annotated, Any, Literal, get_args

import numpy as np
from msgspec import Meta, Struct

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.jit import compiled
from t2twin.core.records import convert

Law = Literal["linear", "stiffening"]

# Least thickness of a domed layer, at its corners, mm (assumed; the CAD's corners are rounded).
THINNEST_MM = 0.5

# Properties of a layer with their limits (assumed: beyond any sensor's).
Side = Annotated[float, Meta(ge=1.0, le=1000.0)]
Thickness = Annotated[float, Meta(ge=0.1, le=200.0, description="thickness at the thickest place")]
Young = Annotated[float, Meta(ge=0.001, le=100.0, description="Young's modulus at small strain")]
Poisson = Annotated[float, Meta(ge=0.0, le=0.499, description="Poisson's ratio")]
Radius = Annotated[float, Meta(ge=1.0)]
DOME = ("dome_width_radius_mm", "dome_length_radius_mm", "dome_flat_mm")
SensorName = Annotated[
    str, Meta(min_length=1, max_length=40, pattern="^[a-z0-9][a-z0-9_-]*$", description="name")
]
ColorValue = Annotated[float, Meta(ge=0.0, le=1.0)]
FlatPart = Annotated[
    float, Meta(ge=0.0, le=1000.0, description="the surface is flat so far either side along y")
]
MAX_FRICTION = 5.0  # largest allowed coefficient (assumed: above any rubber's on a dry solid)
MIN_CELLS = 4  # cells of the contact's grid along a side, which splines between them need
MAX_CELLS = 500  # the same (assumed: presses stay below a second)
DEEPEST_MM = 200.0  # largest depth of a sensor's housing, mm (assumed)
# Pressure, over Young's modulus, above which neither the friction of a stiffening layer nor its
# displacement along the surface increases (assumed: it is compressed to a third there). Friction is
# proportional to the area of real contact, which pressure does not increase beyond full contact
# (Trejo, Fretigny and Chateauminois, arXiv 1701.08013). A linear response would displace the
# surface around a tip by several cells, and under an edge that is pressed almost through by several
# thicknesses.
FULL_PRESSURE = 4.0
NEWTON_STEPS = 2  # that bring the stretch from its initial guess to within 1e-9
# Coefficient of the rational initial guess of a stretch. The guess has the exact value and slope
# for small strain and the right limit for large; this value also makes it exact at l^3 + l^2 = 1.
GUESS = 0.36


@dataclass(frozen=True)
class Elastomer:
    """A soft layer bonded to a rigid base.

    width_mm, length_mm: extent along x and y, centered on the origin.
    dome_width_radius_mm, dome_length_radius_mm: radii of the outer surface along x and y; inf means
    flat.
    law: "linear", or "stiffening" for a neo-Hookean solid, whose deflection stays below its
    thickness (see `neo_hookean_mm`).
    Raises T2TwinError for values of another type or out of range.
    """

    name: str
    thickness_mm: Thickness
    young_mpa: Young
    poisson: Poisson
    width_mm: Side
    length_mm: Side
    dome_width_radius_mm: Radius = np.inf
    dome_length_radius_mm: Radius = np.inf
    dome_flat_mm: FlatPart = 0.0
    law: Law = "stiffening"

    def __post_init__(self) -> None:
        arguments.text(self.name, "name")
        for each in fields(self)[1:-1]:
            value, (limits,) = getattr(self, each.name), get_args(each.type)[1:]
            if limits.le is not None or not isinstance(value, float) or value != np.inf:
                arguments.number(value, each.name, limits.ge, limits.le or np.inf)
        reach_mm = np.array([self.width_mm / 2, self.length_mm / 2 - self.dome_flat_mm])
        radii_mm = np.array([self.dome_width_radius_mm, self.dome_length_radius_mm])
        if self.dome_flat_mm and (reach_mm[1] <= 0.0 or not np.isfinite(radii_mm[1])):
            raise T2TwinError(
                f"dome_flat_mm is {self.dome_flat_mm:g} and dome_length_radius_mm {radii_mm[1]:g}, "
                "one of which has no effect; expected a finite radius beside a flat part of less "
                f"than half of length_mm, {self.length_mm / 2:g}"
            )
        falls_mm = [float(_sag(*each)) for each in zip(reach_mm, radii_mm, strict=True)]
        if (reach_mm > radii_mm).any() or sum(falls_mm) > max(self.thickness_mm - THINNEST_MM, 0.0):
            raise T2TwinError(
                f"the dome of {self.name} falls by {falls_mm[0]:.3g} mm along x and "
                f"{falls_mm[1]:.3g} along y, which leaves less than {THINNEST_MM:g} mm of its "
                f"{self.thickness_mm:g} mm; expected larger radii or a larger thickness_mm"
            )
        arguments.choice(self.law, "law", get_args(Law))

    @property
    def is_flat(self) -> bool:
        """Whether the surface has no dome."""
        return not np.isfinite([self.dome_width_radius_mm, self.dome_length_radius_mm]).any()

    @property
    def full_mpa(self) -> float:
        """Pressure above which friction does not increase, see FULL_PRESSURE."""
        return np.inf if self.law == "linear" else FULL_PRESSURE * self.young_mpa

    def cells(self, pitch_mm: float) -> tuple[int, int]:
        """Cells of the contact's grid along x and y. Raises T2TwinError for too few or too many."""
        # Both even, so that a quarter turn about the center maps cells onto cells.
        sides = self.width_mm, self.length_mm
        columns, rows = (2 * int(side / pitch_mm / 2 + 1e-9) for side in sides)
        if min(columns, rows) < MIN_CELLS or max(columns, rows) > MAX_CELLS:
            raise T2TwinError(
                f"grid_mm is {pitch_mm:g}, which gives {self.name} {columns} x {rows} cells of its "
                f"contact's grid; expected {MIN_CELLS} to {MAX_CELLS} along each side"
            )
        return columns, rows

    def rest_surface_mm(self, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
        """Height of the undeformed surface above its apex, mm (<= 0), at points of equal shape."""
        beyond = np.maximum(np.abs(y_mm) - self.dome_flat_mm, 0.0)
        sag = _sag(np.abs(x_mm), self.dome_width_radius_mm)
        sag = sag + _sag(beyond, self.dome_length_radius_mm)
        return -np.minimum(sag, max(self.thickness_mm - THINNEST_MM, 0.0))  # beyond the corners

    def thickness_at_mm(self, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
        """Local thickness, mm, at points of equal shape."""
        return self.thickness_mm + self.rest_surface_mm(x_mm, y_mm)


@dataclass(frozen=True)
class Friction:
    """Coulomb's friction up to full contact. Raises T2TwinError for a coefficient out of range."""

    coefficient: float

    def __post_init__(self) -> None:
        arguments.number(self.coefficient, "friction", 0.0, MAX_FRICTION)

    def limit_mpa(self, pressure_mpa: np.ndarray, elastomer: Elastomer) -> np.ndarray:
        """The largest traction along the surface under a pressure."""
        return self.coefficient * np.minimum(pressure_mpa, elastomer.full_mpa)

    def limit_n(self, force_n: Any) -> Any:
        """The largest tangential force under a normal one that presses nowhere fully."""
        return self.coefficient * force_n


class LayerTable(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The soft layer, a gel or a cover, bonded to a rigid base around the sensor's axis."""

    width_mm: Annotated[Side, Meta(description="extent along x")]
    length_mm: Annotated[Side, Meta(description="extent along y")]
    thickness_mm: Thickness
    young_mpa: Young
    poisson: Poisson
    friction: Annotated[
        float, Meta(ge=0.01, le=MAX_FRICTION, description="coefficient of friction of the surface")
    ]
    grid_mm: Annotated[float, Meta(ge=0.05, le=5.0, description="pitch of the contact's grid")]
    dome_width_radius_mm: Annotated[
        Radius, Meta(description="radius of the surface along x; inf is flat")
    ] = np.inf
    dome_length_radius_mm: Annotated[
        Radius, Meta(description="radius of the surface along y; inf is flat")
    ] = np.inf
    dome_flat_mm: FlatPart = 0.0
    law: Annotated[
        Law, Meta(description="elastic law: stiffening is neo-Hookean, linear is Hooke's")
    ] = "stiffening"

    def __post_init__(self) -> None:
        self.elastomer("the layer").cells(self.grid_mm)

    @property
    def law_of_friction(self) -> Friction:
        """The friction of the surface."""
        return Friction(self.friction)

    def elastomer(self, name: str) -> Elastomer:
        """The layer as it is pressed."""
        own = [each.name for each in fields(Elastomer)[1:]]
        return Elastomer(name=name, **{key: getattr(self, key) for key in own})


class MountTable(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The sensor as a body of a MuJoCo model."""

    mass_kg: Annotated[float, Meta(gt=0.0, le=100.0, description="mass of the whole sensor")]
    depth_mm: Annotated[
        float,
        Meta(ge=0.0, le=DEEPEST_MM, description="depth of the collision geom behind the base"),
    ]
    color: Annotated[
        tuple[ColorValue, ColorValue, ColorValue, ColorValue],
        Meta(description="red, green, blue and opacity"),
    ] = (0.6, 0.6, 0.6, 1.0)


def _sag(distance_mm: np.ndarray, radius_mm: float) -> np.ndarray:
    if not np.isfinite(radius_mm):
        return np.zeros_like(distance_mm)
    inside = np.minimum(distance_mm, 0.999 * radius_mm)
    return radius_mm - np.sqrt(radius_mm**2 - inside**2)


def elastomer_json(elastomer: Elastomer) -> dict[str, Any]:
    """All properties by name, for JSON: an infinite radius is None."""
    return {key: None if value == np.inf else value for key, value in asdict(elastomer).items()}


def elastomer_of(content: dict[str, Any], source: object) -> Elastomer:
    """The elastomer of what elastomer_json returns; raises T2TwinError with its source."""
    given = {key: value for key, value in content.items() if value is not None}
    return convert(given, Elastomer, source)


@compiled(inline="always")
def stiffened(u, h):
    """Deflection at one place, and its first and second derivative by u; see `neo_hookean_mm`."""
    if u <= 0.0:
        return u, 1.0, 0.0
    # Newton's method on l^3 + 3 (u / h) l^2 = 1.
    strain = u / h
    t = 3.0 * strain
    stretch = np.sqrt((1.0 + GUESS * t) / (1.0 + (GUESS + 2.0 / 3.0 + GUESS * t) * t))
    for _ in range(NEWTON_STEPS):
        excess = stretch * stretch * (stretch + 3.0 * strain) - 1.0
        stretch -= excess / (3.0 * stretch * (stretch + 2.0 * strain))
    slope = stretch / (stretch + 2.0 * strain)
    curvature = -2.0 * (strain * slope + stretch) / (h * (stretch + 2.0 * strain) ** 2)
    return h * (1.0 - stretch), slope, curvature


@compiled(nogil=True)
def neo_hookean_mm(linear_mm, thickness_mm):
    """Deflection w, mm, of a neo-Hookean layer where a linear one deflects by u; (rows, columns).

    The linear layer's strain u / h is its stress over the modulus. A neo-Hookean solid carries that
    stress at a stretch l with (1 / l^2 - l) / 3 = u / h (Treloar, The Physics of Rubber Elasticity,
    1975), and w = h (1 - l). w equals u for small strain and is below h for any stress; where the
    surface bulges out (u < 0), w = u. The strain is uniform through the thickness, which neglects
    large rotations.
    """
    deflection = np.empty(linear_mm.shape)
    for i in range(linear_mm.shape[0]):
        for j in range(linear_mm.shape[1]):
            deflection[i, j], _, _ = stiffened(linear_mm[i, j], thickness_mm[i, j])
    return deflection
