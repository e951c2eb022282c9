"""Tables of a sensor's file that both kinds of sensor have: its soft layer and its mount.

Values marked "assumed" in a file have no published source.
"""

from math import inf
from typing import Annotated

from msgspec import Meta, Struct

from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.elastomer import RANGES, Elastomer, Law
from t2twin.sim.contact.friction import MAX_FRICTION

LARGEST_MM = 100.0  # side of a layer, mm (assumed: beyond any published sensor of these kinds)
MAX_CELLS = 500  # cells of the contact's grid along a side (assumed: presses stay below a second)
DEEPEST_MM = 200.0  # largest depth of a sensor's housing, mm (assumed)

Side = Annotated[float, Meta(ge=1.0, le=LARGEST_MM)]
Radius = Annotated[float, Meta(ge=1.0)]
SensorName = Annotated[
    str, Meta(min_length=1, max_length=40, pattern="^[a-z0-9][a-z0-9_-]*$", description="name")
]
ColorValue = Annotated[float, Meta(ge=0.0, le=1.0)]


class LayerTable(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The soft layer, a gel or a cover, bonded to a rigid base around the sensor's axis."""

    width_mm: Annotated[Side, Meta(description="extent along x")]
    length_mm: Annotated[Side, Meta(description="extent along y")]
    thickness_mm: Annotated[
        float, Meta(ge=0.1, le=50.0, description="thickness at the thickest place")
    ]
    young_mpa: Annotated[
        float, Meta(ge=0.001, le=100.0, description="Young's modulus at small strain")
    ]
    poisson: Annotated[float, Meta(ge=0.0, le=0.499, description="Poisson's ratio")]
    friction: Annotated[
        float, Meta(ge=0.01, le=MAX_FRICTION, description="coefficient of friction of the surface")
    ]
    grid_mm: Annotated[float, Meta(ge=0.05, le=5.0, description="pitch of the contact's grid")]
    dome_width_radius_mm: Annotated[
        Radius, Meta(description="radius of the surface along x; inf is flat")
    ] = inf
    dome_length_radius_mm: Annotated[
        Radius, Meta(description="radius of the surface along y; inf is flat")
    ] = inf
    dome_flat_mm: Annotated[
        float,
        Meta(ge=0.0, le=LARGEST_MM, description="the surface is flat so far either side along y"),
    ] = 0.0
    law: Annotated[
        Law, Meta(description="elastic law: stiffening is neo-Hookean, linear is Hooke's")
    ] = "stiffening"

    def __post_init__(self) -> None:
        self.elastomer("layer")
        cells = max(self.width_mm, self.length_mm) / self.grid_mm
        if cells > MAX_CELLS:
            raise T2TwinError(
                f"grid_mm is {self.grid_mm:g}, which gives {cells:.0f} cells along a side; "
                f"expected at most {MAX_CELLS}"
            )

    def elastomer(self, name: str) -> Elastomer:
        """The layer as it is pressed."""
        return Elastomer(name=name, **{key: getattr(self, key) for key in RANGES}, law=self.law)


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
