"""Height maps of meshes: the highest point of a mesh over each grid point."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad.shape import NOTHING_MM, HeightMap
from t2twin.primitives_cad.triangles import EDGE_MM, raise_to_corners

if TYPE_CHECKING:
    import trimesh

PITCH_MM = 0.05  # finest pitch of a height map, mm (assumed: about one pixel of a DIGIT)
# finest pitch of a file; 0.05 mm makes thin walls worse (benchmark contact_cases)
FILE_PITCH_MM = 0.025
# Half the side of a height map. Assumed: half the diagonal of a 28 x 46 mm cover, 27 mm, and the
# largest offset of a press on a tool's or a file's shape, 4.5 mm.
REACH_MM = 32.0
MAX_CELLS = 1_500_000  # limit on the cells of a map whose pitch is not given (assumed)
# least rise of a wall over half a pitch, pitches (assumed: a slope of 76 degrees)
WALL_POINTS = 2.0
DIRECTIONS = 8  # directions in which a point is compared with points half a pitch away
FACE_MM = 0.02  # height range of a flat face, mm (assumed: finer than a print's layer)
FACE_SHARE = 0.2  # least share of a base plate in the surface, seen from above (assumed)
FEATURES_MM = 0.1  # least height of features on a base plate, mm (assumed)
FLAT_TOP_MM = 0.1  # height range of a shape's highest part (assumed: the depth of a light press)
PLACE_POINTS = 300  # points from the middle in which the highest part is searched (assumed)
# heights of walls without width and of narrow parts that are ignored (assumed)
WALL_MM, NEEDLE_MM = 0.1, 0.5


def aligned(
    mesh: "trimesh.Trimesh",
    pitch_mm: float | None = None,
    reach_mm: float = REACH_MM,
    of_file: bool = False,
) -> tuple["trimesh.Trimesh", HeightMap]:
    """A mesh (mm) moved along z so that its highest point within reach is at 0, and its height map.

    pitch_mm: None for PITCH_MM, or FILE_PITCH_MM of a file, doubled until the map has at most
    MAX_CELLS. of_file: whether outlines are at the nearest points, see `rounded_outline`.
    Raises T2TwinError where the mesh has no surface within reach.
    """
    triangles = np.asarray(mesh.triangles)
    flat = triangles[:, :, :2]
    near = (flat.min(axis=1) <= reach_mm).all(axis=1) & (flat.max(axis=1) >= -reach_mm).all(axis=1)
    triangles = triangles[near]
    if not len(triangles):
        raise T2TwinError(f"the shape has no surface within {reach_mm:g} mm of the press axis")
    half_x, half_y = np.minimum(np.abs(triangles[:, :, :2]).max(axis=(0, 1)), reach_mm)
    pitch = pitch_mm or (FILE_PITCH_MM if of_file else PITCH_MM)
    while not pitch_mm and (2 * half_x / pitch + 3) * (2 * half_y / pitch + 3) > MAX_CELLS:
        pitch *= 2.0
    beyond = 0.5 if of_file else 0.0
    columns, rows = (int(np.floor(half / pitch + beyond + EDGE_MM)) for half in (half_x, half_y))

    def sample(dx_mm: float, dy_mm: float) -> np.ndarray:
        moved = triangles - np.array((dx_mm, dy_mm, 0.0))
        return rasterize_triangles(moved, pitch, rows, columns)

    heights = rounded_outline(sample, pitch) if of_file else sample(0.0, 0.0)
    top = float(heights.max())
    if top == NOTHING_MM:
        raise T2TwinError(f"the shape has no surface within {reach_mm:g} mm of the press axis")
    heights[heights != NOTHING_MM] -= top
    lowered = mesh.copy()
    lowered.apply_translation((0.0, 0.0, -top))
    return lowered, HeightMap(
        heights_mm=heights.astype(np.float32),
        x_mm=np.arange(-columns - 1, columns + 2) * pitch,
        y_mm=np.arange(-rows - 1, rows + 2) * pitch,
    )


def highest_place(mesh: "trimesh.Trimesh") -> tuple[float, float]:
    """x and y of the middle of a mesh's highest part, mm: the point farthest from its outline."""
    from scipy import ndimage  # slow to import

    triangles = np.asarray(mesh.triangles)
    sides = triangles[:, 1:, :2] - triangles[:, :1, :2]
    triangles = triangles[np.linalg.det(sides) != 0.0]
    if not len(triangles):
        raise T2TwinError("the shape has no surface that is seen from above (+z)")
    level = triangles[:, :, 2].max() - FLAT_TOP_MM
    triangles = triangles[triangles[:, :, 2].max(axis=1) >= level]
    low, high = triangles[:, :, :2].min(axis=(0, 1)), triangles[:, :, :2].max(axis=(0, 1))
    middle, half = (low + high) / 2, (high - low) / 2
    pitch = max(float(half.max()) / PLACE_POINTS, PITCH_MM)
    columns, rows = (int(np.ceil(side / pitch)) for side in half)
    moved = triangles - np.array((*middle, 0.0))
    top = rasterize_triangles(moved, pitch, rows, columns) >= level
    if not top.any():  # narrower than the pitch
        x, y, _ = triangles.reshape(-1, 3)[triangles[:, :, 2].argmax()]
        return float(x), float(y)
    inside = np.asarray(ndimage.distance_transform_edt(top))
    row, column = divmod(int(inside.argmax()), top.shape[1])
    return (
        float(middle[0] + (column - columns - 1) * pitch),
        float(middle[1] + (row - rows - 1) * pitch),
    )


def rounded_outline(sample: Callable[[float, float], np.ndarray], pitch_mm: float) -> np.ndarray:
    """Heights at the points of a map, mm, with its outlines at the nearest points.

    A point less than half a pitch from a wall belongs to its top, so that widths are right on
    average. sample: heights at the points moved by dx, dy, mm.
    """
    heights, half = sample(0.0, 0.0), (1 - EDGE_MM) * pitch_mm / 2
    raised = heights
    for angle in 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS:
        raised = np.maximum(
            raised, sample(half * float(np.cos(angle)), half * float(np.sin(angle)))
        )
    return np.where(raised - heights > WALL_POINTS * pitch_mm, raised, heights)


def narrow_mm(mesh: "trimesh.Trimesh", surface: HeightMap, sides_mm: tuple[float, float]) -> float:
    """Height of needles and thin walls above parts with at least these sides, mm; 0 if small."""
    from scipy import ndimage  # slow to import

    x, y, z = mesh.vertices.view(np.ndarray).T
    near = (np.abs(x) <= surface.x_mm[-2]) & (np.abs(y) <= surface.y_mm[-2])
    higher = float(z[near].max(initial=0.0))
    heights, pitch = surface.heights_mm, surface.pitch_mm
    # A square that fits into a strip of the narrower side at any angle.
    side = int(sides_mm[0] / np.sqrt(2.0) / pitch) + 1
    points = min(int(sides_mm[0] * sides_mm[1] / pitch**2) + 1, heights.size)
    widest = float(ndimage.minimum_filter(heights, side, mode="nearest").max())
    largest = float(np.partition(heights, heights.size - points, axis=None)[-points])
    narrow = higher - min(widest, largest)
    return narrow if higher > WALL_MM or narrow > NEEDLE_MM else 0.0


def base_mm(surface: HeightMap) -> float | None:
    """Height of the lowest face, mm, if it is flat, large and not the only one."""
    heights = surface.heights_mm[surface.heights_mm > NOTHING_MM / 2]
    lowest = float(heights.min())
    share = float((heights <= lowest + FACE_MM).mean())
    return lowest if share >= FACE_SHARE and lowest < -FEATURES_MM else None


def rasterize_triangles(
    triangles: np.ndarray, pitch_mm: float, rows: int, columns: int
) -> np.ndarray:
    """Highest z of triangles (n, 3, 3) over a grid, (2 rows + 3, 2 columns + 3) float32, mm."""
    heights = np.full((2 * rows + 3, 2 * columns + 3), NOTHING_MM, np.float32)
    raise_to_corners(np.ascontiguousarray(triangles, np.float64), pitch_mm, heights)
    return heights
