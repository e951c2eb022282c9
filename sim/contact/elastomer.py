"""The sensors' soft layers: their geometry, their elasticity, and the neo-Hookean law.

Values marked "assumed" have no published source.
"""

from dataclasses import asdict, dataclass
from typing import Any, Literal, get_args

import numpy as np

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.jit import compiled
from t2twin.core.records import convert

Law = Literal["linear", "stiffening"]

# Least thickness of a domed gel at its corners, mm (assumed; the CAD's corners are rounded).
THINNEST_MM = 0.5
# Smallest and largest allowed value of each property (assumed: beyond any sensor's).
RANGES = {
    "thickness_mm": (0.1, 200.0),
    "young_mpa": (0.001, 100.0),
    "poisson": (0.0, 0.499),
    "width_mm": (1.0, 500.0),
    "length_mm": (1.0, 500.0),
    "dome_width_radius_mm": (1.0, np.inf),
    "dome_length_radius_mm": (1.0, np.inf),
    "dome_flat_mm": (0.0, 500.0),
}
MAY_BE_FLAT = ("dome_width_radius_mm", "dome_length_radius_mm")  # inf for a flat surface

NEWTON_STEPS = 2  # that bring the stretch from its initial guess to within 1e-9
# Coefficient of the rational initial guess of a stretch. The guess has the exact value and slope
# for small strain and the right limit for large; this value also makes it exact at l^3 + l^2 = 1.
GUESS = 0.36


@dataclass(frozen=True)
class Elastomer:
    """A soft layer bonded to a rigid base.

    thickness_mm: at the thickest place.
    young_mpa, poisson: small-strain modulus (MPa) and Poisson's ratio.
    width_mm, length_mm: extent along x and y, centered on the origin.
    dome_width_radius_mm, dome_length_radius_mm: radii of the outer surface along x and y;
        inf means flat. The surface is flat for dome_flat_mm either side of the middle in y.
    law: "linear", or "stiffening" for a neo-Hookean solid, whose deflection stays below its
        thickness (see `neo_hookean_mm`).
    Raises T2TwinError for values of another type or outside RANGES.
    """

    name: str
    thickness_mm: float
    young_mpa: float
    poisson: float
    width_mm: float
    length_mm: float
    dome_width_radius_mm: float = np.inf
    dome_length_radius_mm: float = np.inf
    dome_flat_mm: float = 0.0
    law: Law = "stiffening"

    def __post_init__(self) -> None:
        arguments.text(self.name, "name")
        for name, (low, high) in RANGES.items():
            value = getattr(self, name)
            if not (name in MAY_BE_FLAT and isinstance(value, float) and value == np.inf):
                arguments.number(value, name, low, high)
        if not self.is_flat and self.thickness_mm < THINNEST_MM:
            raise T2TwinError(
                f"thickness_mm is {self.thickness_mm:g}; a domed elastomer is at least "
                f"{THINNEST_MM:g} mm thick, a flat one 0.1 mm"
            )
        arguments.choice(self.law, "law", get_args(Law))

    @property
    def is_flat(self) -> bool:
        """Whether the surface has no dome."""
        return not np.isfinite([self.dome_width_radius_mm, self.dome_length_radius_mm]).any()

    def rest_surface_mm(self, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
        """Height of the undeformed surface above its apex, mm (<= 0), at points of equal shape."""
        beyond = np.maximum(np.abs(y_mm) - self.dome_flat_mm, 0.0)
        sag = _sag(np.abs(x_mm), self.dome_width_radius_mm) + _sag(
            beyond, self.dome_length_radius_mm
        )
        return -np.minimum(sag, max(self.thickness_mm - THINNEST_MM, 0.0))

    def thickness_at_mm(self, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
        """Local thickness, mm, at points of equal shape."""
        return self.thickness_mm + self.rest_surface_mm(x_mm, y_mm)


def _sag(distance_mm: np.ndarray, radius_mm: float) -> np.ndarray:
    if not np.isfinite(radius_mm):
        return np.zeros_like(distance_mm)
    inside = np.minimum(distance_mm, 0.999 * radius_mm)
    return radius_mm - np.sqrt(radius_mm**2 - inside**2)


def elastomer_json(elastomer: Elastomer) -> dict[str, Any]:
    """All properties by name, for JSON: an infinite radius is None."""
    return {key: None if value == np.inf else value for key, value in asdict(elastomer).items()}


def elastomer_of(content: dict[str, Any], source: object) -> Elastomer:
    """The elastomer of what elastomer_json returns. source: its origin, for messages.

    Raises T2TwinError for a missing property, one of another type or outside RANGES.
    """
    given = {key: value for key, value in content.items() if value is not None}
    return convert(given, Elastomer, source)


def neo_hookean_mm(linear_mm: np.ndarray, thickness_mm: np.ndarray) -> np.ndarray:
    """Deflection w, mm, of a neo-Hookean layer where a linear one deflects by u; (rows, columns).

    The linear layer's strain u / h is its stress over the modulus. A neo-Hookean solid carries that
    stress at a stretch l with (1 / l^2 - l) / 3 = u / h (Treloar, The Physics of Rubber Elasticity,
    1975), and w = h (1 - l). w equals u for small strain and is below h for any stress; where the
    surface bulges out (u < 0), w = u. The strain is uniform through the thickness, which neglects
    large rotations.
    """
    deflection = np.empty(linear_mm.shape)
    _neo_hookean(
        np.ascontiguousarray(linear_mm, np.float64),
        np.ascontiguousarray(thickness_mm, np.float64),
        deflection,
    )
    return deflection


@compiled(inline="always")
def stiffened(u, h):
    """Deflection w at one place, and its first and second derivative by u; see
    `neo_hookean_mm`."""
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


@compiled("void(f8[:, ::1], f8[:, ::1], f8[:, ::1])", nogil=True)
def _neo_hookean(linear, thickness, deflection):
    for i in range(linear.shape[0]):
        for j in range(linear.shape[1]):
            deflection[i, j], _, _ = stiffened(linear[i, j], thickness[i, j])
