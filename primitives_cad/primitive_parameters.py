"""Parameters of the eight families of tactile primitives.

The families, their parameters and the split by version are those of Grella et al. 2023. The sizes
are assumed, for a DIGIT with a view of about 12.5 x 16.7 mm. Most features lie within the view;
lines and the largest version of each flat family extend beyond it, as edges and faces of tools do.
Lines have several lengths, because an image of an edge does not show where it ends, and a network
trained on one length would predict it everywhere. All lengths are in mm.
"""

from math import sqrt

PLATE_SIDE_MM = 46.0
"""Side of a primitive's square base plate, mm (assumed: fits the longest line)."""

PLATE_THICKNESS_MM = 3.0
"""Thickness of the base plate, mm (assumed)."""

FEATURE_HEIGHT_MM = 6.0
"""Height of every feature's top above the plate, mm (assumed: more than the thickest soft layer,
4.07 mm, so that no press touches the plate)."""

VALIDATION_VERSION = 3
"""The version of each family in the validation split; the others are in the training split."""

FAMILIES: dict[str, tuple[dict[str, float], ...]] = {
    "line-smooth": (
        {"width": 1.6, "radius": 0.4, "length": 28.0},
        {"width": 3.0, "radius": 1.2, "length": 20.0},
        {"width": 2.2, "radius": 0.8, "length": 24.0},
        {"width": 7.0, "radius": 2.0, "length": 40.0},
    ),
    "square": ({"side": 5.6}, {"side": 8.4}, {"side": 7.0}, {"side": 16.0}),
    "circle-empty": (
        {"radius": 3.0, "edge": 0.8},
        {"radius": 4.6, "edge": 1.6},
        {"radius": 4.0, "edge": 1.1},
        {"radius": 6.5, "edge": 1.3},
    ),
    "circle": ({"radius": 2.5}, {"radius": 5.0}, {"radius": 3.6}, {"radius": 8.0}),
    "bump": (
        {"height": 0.8, "curvature": 4.0},
        {"height": 1.6, "curvature": 9.0},
        {"height": 1.2, "curvature": 7.0},
        {"height": 2.0, "curvature": 6.0},
    ),
    "square-empty": (
        {"side": 6.0, "edge": 0.8},
        {"side": 8.4, "edge": 1.6},
        {"side": 7.2, "edge": 1.1},
        {"side": 13.0, "edge": 1.3},
    ),
    "hemisphere": ({"radius": 2.5}, {"radius": 4.0}, {"radius": 3.3}, {"radius": 5.5}),
    "line-sharp": (
        {"width": 1.0, "length": 40.0},
        {"width": 2.6, "length": 20.0},
        {"width": 1.8, "length": 24.0},
        {"width": 5.5, "length": 28.0},
    ),
}
"""Parameters of versions 1 to 4 of each family, mm (assumed). radius: of the long edges'
rounding for line-smooth, else of the shape's outline (outer, for circle-empty). edge: wall
thickness. curvature: radius of the bump's spherical cap. length: along y; all are more than the
16.7 mm of a DIGIT's view."""

MIN_SPACING_MM = 1.0
"""Least spacing of the press grid, mm, so that presses on narrow shapes differ (assumed; Grella et
al. 2023 use 1.4 for a square, and their grid covers each primitive)."""

SPACING_STEP_MM = 0.05
"""Spacings are rounded to this, mm (assumed)."""

GRID_INTERVALS = 6
"""Intervals along one side of the protocol's 7 x 7 grid (Grella et al. 2023)."""

PRIMITIVES = tuple(
    f"{family}-{version + 1}"
    for family, versions in FAMILIES.items()
    for version in range(len(versions))
)
"""Names of the 32 primitives, family by family."""


def family(name: str) -> str:
    """Family of a primitive: `square` of `square-2`."""
    return name.rpartition("-")[0]


def version(name: str) -> int:
    """Version of a primitive, 1 to 4: 2 of `square-2`."""
    return int(name.rpartition("-")[2])


def parameters(name: str) -> dict[str, float]:
    """The parameters of a primitive by name, mm."""
    return dict(FAMILIES[family(name)][version(name) - 1])


def extents_mm(name: str) -> tuple[float, float]:
    """Sides of the feature's outline along x and y, mm."""
    sizes = parameters(name)
    kind = family(name)
    if kind in ("line-smooth", "line-sharp"):
        return sizes["width"], sizes["length"]
    if kind in ("square", "square-empty"):
        return sizes["side"], sizes["side"]
    radius = (
        cap_radius_mm(sizes["height"], sizes["curvature"]) if kind == "bump" else sizes["radius"]
    )
    return 2.0 * radius, 2.0 * radius


def cap_radius_mm(height_mm: float, curvature_mm: float) -> float:
    """Radius of the circle where a spherical cap of this height ends, mm: sqrt(2 R h - h^2)."""
    return sqrt(2.0 * curvature_mm * height_mm - height_mm**2)


def spacing_mm(extent: float) -> float:
    """Spacing of a 7 x 7 grid of presses that covers a feature of this extent (mm), mm."""
    steps = round(extent / GRID_INTERVALS / SPACING_STEP_MM)
    return round(max(steps * SPACING_STEP_MM, MIN_SPACING_MM), 2)


def spacings_mm(name: str) -> tuple[float, float]:
    """Spacings along x and y of the grid that covers a primitive, mm."""
    x, y = extents_mm(name)
    return spacing_mm(x), spacing_mm(y)
