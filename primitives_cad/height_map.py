"""Height maps of solids in any pose: the highest point of triangles over each grid point.

A map is (2 rows + 3, 2 columns + 3) float32, mm, centered on the axis, with a rim of NOTHING_MM.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.core.jit import compiled
from t2twin.primitives_cad.shape import NOTHING_MM, HeightMap

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

# tolerance at a triangle's outline, for symmetric shapes (assumed: below any length)
EDGE_MM = 1.0e-6
# Share of the pitch by which outlines are moved outward, times the sum of the absolute components
# of their unit normals: cells of four points of the solid are too small by this much on average.
OUTLINE = 0.5 - 1.0e-6
STEEP = 0.1  # greatest vertical component of a wall's unit normal (assumed); its top is an outline
BLOCK = 64  # triangles that share a bounding box (assumed)
CODE_BITS = 10  # bits an axis of a triangle's place in the order of the blocks (assumed)
LEVEL = 1.0e-10  # rows, below which the extent of a triangle's side is replaced by it (assumed)
FAST: dict[str, Any] = {"nogil": True, "fastmath": {"nnan", "nsz"}}  # of loops that take a maximum


def aligned(
    mesh: "trimesh.Trimesh", pitch_mm: float | None = None, of_file: bool = False
) -> tuple["trimesh.Trimesh", HeightMap]:
    """A mesh (mm) moved along z so that its highest point within REACH_MM is at 0, and its map.

    pitch_mm: None for PITCH_MM, or FILE_PITCH_MM of a file, doubled until the map has at most
    MAX_CELLS. of_file: whether outlines are at the nearest points, see `rounded_outline`.
    Raises T2TwinError where the mesh has no surface within reach.
    """
    triangles = np.asarray(mesh.triangles)
    flat = triangles[:, :, :2]
    near = (flat.min(axis=1) <= REACH_MM).all(axis=1) & (flat.max(axis=1) >= -REACH_MM).all(axis=1)
    triangles = triangles[near]
    if not len(triangles):
        raise T2TwinError(f"the shape has no surface within {REACH_MM:g} mm of the press axis")
    half_x, half_y = np.minimum(np.abs(triangles[:, :, :2]).max(axis=(0, 1)), REACH_MM)
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
        raise T2TwinError(f"the shape has no surface within {REACH_MM:g} mm of the press axis")
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


class Triangles(NamedTuple):
    """Triangles in their own frame, mm, in blocks of BLOCK that are close to each other."""

    triangles_mm: np.ndarray  # (n, 3, 3)
    normals: np.ndarray  # (n, 3, 3) units of the neighbors at the sides from each corner, or 0
    boxes_mm: np.ndarray  # (blocks, 2, 3) centers and half extents of the bounding boxes
    is_closed: bool  # whether they enclose a volume

    def blocks_near(
        self, rotation: np.ndarray, center_mm: np.ndarray, half_mm: np.ndarray, lowest_mm: float,
        highest_mm: float,
    ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        """Blocks near a region of half extents (2,) and between two heights; their falling tops."""
        centers = self.boxes_mm[:, 0] @ rotation.T + center_mm
        halves = self.boxes_mm[:, 1] @ np.abs(rotation).T
        upper = centers[:, 2] + halves[:, 2]
        near = (np.abs(centers[:, :2]) <= halves[:, :2] + half_mm).all(axis=1)
        near &= (centers[:, 2] - halves[:, 2] <= highest_mm) & (upper >= lowest_mm)
        blocks = np.flatnonzero(near)
        blocks = blocks[np.argsort(-upper[blocks])]
        return blocks, upper[blocks]


def in_blocks(triangles_mm: np.ndarray, faces: np.ndarray | None = None) -> Triangles:
    """Triangles, (n, 3, 3), mm, with neighbors by the numbers (n, 3) or else places of corners."""
    centers = triangles_mm.mean(axis=1)
    low = centers.min(axis=0)
    extent = max(float((centers - low).max()), np.finfo(float).tiny)
    cells = ((centers - low) / extent * (2**CODE_BITS - 1)).astype(np.int64)
    # Interleaved bits: the Morton order.
    code = sum(
        ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
        for bit in range(CODE_BITS)
        for axis in range(3)
    )
    order = np.argsort(code)
    triangles_mm = np.ascontiguousarray(triangles_mm[order], np.float32)
    starts = np.arange(0, len(triangles_mm), BLOCK)
    low = np.minimum.reduceat(triangles_mm.min(axis=1), starts).astype(float)
    high = np.maximum.reduceat(triangles_mm.max(axis=1), starts).astype(float)
    boxes_mm = np.ascontiguousarray(np.stack(((low + high) / 2, (high - low) / 2), axis=1))
    found = None if faces is None else _neighbors(triangles_mm, faces[order])
    if found is None or not found[1]:
        _, points = np.unique(triangles_mm.reshape(-1, 3), axis=0, return_inverse=True)
        found = _neighbors(triangles_mm, points.reshape(-1, 3))
    return Triangles(triangles_mm, found[0], boxes_mm, found[1])


def _neighbors(triangles_mm: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, bool]:
    """Normals of the neighbors, see `Triangles`, and whether the triangles enclose a volume."""
    start = faces.astype(np.int64)
    end, points = np.roll(start, -1, axis=1), int(start.max()) + 1
    sides, reversed_sides = (start * points + end).ravel(), (end * points + start).ravel()
    order = np.argsort(sides)
    places = np.searchsorted(sides, reversed_sides, sorter=order)
    met = order[np.minimum(places, sides.size - 1)]
    a, b, c = triangles_mm.astype(float).transpose(1, 0, 2)
    across = np.cross(b - a, c - a)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), np.finfo(float).tiny)
    normals = np.where((sides[met] == reversed_sides)[:, None], across[met // 3], 0.0)
    volume = np.einsum("ni,ni->", a, np.cross(b, c))
    # Each side is met in the other direction equally often.
    is_closed = volume > 0.0 and np.array_equal(sides[order], np.sort(reversed_sides))
    return np.ascontiguousarray(normals.reshape(-1, 3, 3), np.float32), bool(is_closed)


@compiled(nogil=True)
def raise_to_triangles(
    triangles, normals, blocks, upper, closed, depth, rotation, center, pitch, behind, top, heights
):
    """Raise a map to the parts of a mesh that are at most `depth` below the greatest height.

    Takes the greatest height so far and returns the new one. Surfaces above `behind` are left out.
    blocks, upper: over the map, see `blocks_near`. closed: leave out triangles that face down.
    """
    # From here on x is in columns and y in rows of the map.
    turned, middle, scale = rotation.copy(), center.copy(), 1.0 / pitch
    turned[:2] *= scale
    middle[:2] *= scale
    middle[0] += heights.shape[1] // 2
    middle[1] += heights.shape[0] // 2
    for m in range(blocks.size):
        if upper[m] < top - depth:
            break
        for n in range(BLOCK * blocks[m], min(BLOCK * blocks[m] + BLOCK, triangles.shape[0])):
            a = moved(turned, middle, triangles[n, 0])
            b = moved(turned, middle, triangles[n, 1])
            c = moved(turned, middle, triangles[n, 2])
            area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
            if area == 0.0 or max(a[2], b[2], c[2]) < top - depth:
                continue  # seen edge-on, its neighbors include its outline
            if area > 0.0:
                ab, bc, ca = _outlines(turned, normals[n], 1.0, pitch)
                top = raise_to_triangle(a, b, c, area, ab, bc, ca, behind, top, heights)
            elif not closed:
                ab, bc, ca = _outlines(turned, normals[n], -1.0, pitch)
                top = raise_to_triangle(a, c, b, -area, ca, bc, ab, behind, top, heights)
    return top


@compiled(inline="always")
def moved(rotation, center, point):
    """A point of the triangles' frame in the frame of the map, (x, y, z)."""
    x, y, z = np.float64(point[0]), np.float64(point[1]), np.float64(point[2])
    return (
        center[0] + rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z,
        center[1] + rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z,
        center[2] + rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z,
    )


@compiled(inline="always")
def _outlines(rotation, normals, sign, pitch):
    """Columns by which each side of a triangle is moved outward."""
    up = rotation[2]
    ab = sign * (up[0] * normals[0, 0] + up[1] * normals[0, 1] + up[2] * normals[0, 2])
    bc = sign * (up[0] * normals[1, 0] + up[1] * normals[1, 1] + up[2] * normals[1, 2])
    ca = sign * (up[0] * normals[2, 0] + up[1] * normals[2, 1] + up[2] * normals[2, 2])
    edge = EDGE_MM / pitch
    return (
        OUTLINE if ab < STEEP else edge,
        OUTLINE if bc < STEEP else edge,
        OUTLINE if ca < STEEP else edge,
    )


@compiled(inline="always")
def _side(a, b, edge):
    """x at y = 0 and change with y of a row's left and right bound by the side from a to b."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    room = edge * (abs(dx) + abs(dy))
    dy = LEVEL if abs(dy) < LEVEL else dy
    start, change = a[0] + (room - dx * a[1]) / dy, dx / dy
    if dy > 0.0:
        return -np.inf, 0.0, start, change
    return start, change, np.inf, 0.0


@compiled(**FAST)
def raise_to_triangle(a, b, c, area, ab, bc, ca, behind, top, heights):
    """Raise a map to a triangle whose x is in columns and y in rows.

    a, b, c: corners, counterclockwise. area: twice. ab, bc, ca: how far the sides move outward.
    """
    highest, edge = np.float32(top), max(ab, bc, ca)
    first_row = max(int(np.ceil(min(a[1], b[1], c[1]) - edge)), 1)
    last_row = min(int(np.floor(max(a[1], b[1], c[1]) + edge)), heights.shape[0] - 2)
    lowest_x = max(np.ceil(min(a[0], b[0], c[0]) - edge), 1.0)
    greatest_x = min(np.floor(max(a[0], b[0], c[0]) + edge), heights.shape[1] - 2.0)
    if last_row < first_row or greatest_x < lowest_x:
        return top
    left_0, left_1, right_0, right_1 = _side(a, b, ab)
    left_2, left_3, right_2, right_3 = _side(b, c, bc)
    left_4, left_5, right_4, right_5 = _side(c, a, ca)
    low, high = min(a[2], b[2], c[2]), max(a[2], b[2], c[2])
    uz, vz = b[2] - a[2], c[2] - a[2]
    along_x = (uz * (c[1] - a[1]) - vz * (b[1] - a[1])) / area
    along_y = (vz * (b[0] - a[0]) - uz * (c[0] - a[0])) / area
    for row in range(first_row, last_row + 1):
        y = np.float64(row)
        left = max(left_0 + left_1 * y, left_2 + left_3 * y, left_4 + left_5 * y, lowest_x)
        right = min(right_0 + right_1 * y, right_2 + right_3 * y, right_4 + right_5 * y, greatest_x)
        start = a[2] + along_y * (y - a[1]) - along_x * a[0]
        out = heights[row]
        for column in range(int(np.ceil(left)), int(np.floor(right)) + 1):
            height = start + along_x * column
            height = low if height < low else height
            height = np.float32(high if height > high else height)
            height = height if height <= behind else np.float32(NOTHING_MM)
            at = np.uintp(column)
            out[at] = out[at] if out[at] > height else height
            highest = highest if highest > height else height
    return highest


@compiled(nogil=True)
def rasterize_triangles(triangles, pitch, rows, columns):
    """Highest z of triangles (n, 3, 3) over a grid, (2 rows + 3, 2 columns + 3) float32, mm.

    Triangles may face up or down; their outlines are not moved.
    """
    heights = np.full((2 * rows + 3, 2 * columns + 3), NOTHING_MM, np.float32)
    edge = EDGE_MM / pitch
    for n in range(triangles.shape[0]):
        x, y = triangles[n, :, 0] / pitch + (columns + 1), triangles[n, :, 1] / pitch + (rows + 1)
        z = triangles[n, :, 2]
        a, b, c = (x[0], y[0], z[0]), (x[1], y[1], z[1]), (x[2], y[2], z[2])
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if area < 0.0:
            b, c = c, b
        if area != 0.0:
            raise_to_triangle(a, b, c, abs(area), edge, edge, edge, np.inf, NOTHING_MM, heights)
    return heights
