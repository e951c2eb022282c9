"""Parameters of the eight families of tactile primitives, mm.

The families, their parameters and the split by version are those of Grella et al. 2023. The sizes
are assumed, for a DIGIT with a view of about 12.5 x 16.7 mm; lines and the largest flat versions
extend beyond it, as tools do. A network trained on one length of lines would predict it everywhere.
"""

from math import sqrt

PLATE_SIDE_MM = 46.0  # side of a primitive's square base plate, mm (assumed: fits the longest line)
PLATE_THICKNESS_MM = 3.0  # thickness of the base plate, mm (assumed)
FEATURE_HEIGHT_MM = 6.0  # above the plate (assumed: more than the thickest soft layer, 4.07 mm)
VALIDATION_VERSION = 3  # of each family, in the validation split; the others are for training
# Versions 1 to 4 of each family (assumed). radius: of line-smooth's long edges' rounding, else of
# the outline. edge: wall thickness. curvature: of the spherical cap. length: along y.
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

MIN_SPACING_MM = 1.0  # of the press grid, so that presses on narrow shapes differ (assumed)
SPACING_STEP_MM = 0.05  # spacings are rounded to this, mm (assumed)
GRID_INTERVALS = 6  # along one side of the protocol's 7 x 7 grid (Grella et al. 2023)
PRIMITIVES = tuple(f"{family}-{version}" for family in FAMILIES for version in (1, 2, 3, 4))


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
    if kind == "bump":
        sizes["radius"] = cap_radius_mm(sizes["height"], sizes["curvature"])
    return 2.0 * sizes["radius"], 2.0 * sizes["radius"]


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
