"""Compiled loops that raise a height map to the geoms of a MuJoCo model.

All loops work in the shape frame of t2twin.primitives_cad.shape at x = y = yaw = 0: x of the
sensor, minus its y, and the height, which is minus its z. Lengths are in mm.

A map is (2 rows + 3, 2 columns + 3) float32, centered on the axis, with a rim of NOTHING_MM. A
geom's pose is its rotation to the shape frame, (3, 3), and its center, (3,). Surfaces above
`behind` are left out. Each loop takes the greatest height so far and returns the new one.
"""

from typing import Any

import numpy as np

from t2twin.core.jit import compiled
from t2twin.primitives_cad.height_map import EDGE_MM
from t2twin.primitives_cad.shape import NOTHING_MM

PLANE, SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX = 0, 2, 3, 4, 5, 6
"""Values of MuJoCo's mjtGeom."""

BLOCK = 64
"""Triangles that share a bounding box (assumed)."""

PARALLEL = 1.0e-9
"""Smallest component of the vertical in a geom's frame, in place of smaller ones (assumed: it moves
no surface of a meter by more than 1e-6 mm)."""

LEVEL = 1.0e-10
"""Rows, below which the extent of a triangle's side is replaced by it (assumed)."""

FAST: dict[str, Any] = {"nogil": True, "fastmath": {"nnan", "nsz"}}
"""Options of loops that take a maximum; without a case for NaN they use vector instructions."""

POSE = "f8[:, ::1], f8[::1]"
MAP = "f8, f8, f8, f4[:, ::1]"
"""Types of the pitch, `behind`, the greatest height so far, and the map."""

ROW = "f8[::1], f8[::1], f8[::1], f8[::1], f8[::1]"
"""Types of a row of grid points: their x from the geom's center; the row's start, the direction of
x, and the vertical, in the geom frame; and the geom's size."""


@compiled(f"f8(i8, f8[::1], {POSE}, {MAP})", nogil=True)
def raise_to_primitive(kind, size, rotation, center, pitch, behind, top, heights):
    """Raise a map to a geom with a formula. size: (3,) as geom_size, mm."""
    half_x, half_y = _half_extent(kind, size, rotation[0]), _half_extent(kind, size, rotation[1])
    rows, columns = (heights.shape[0] - 3) // 2, (heights.shape[1] - 3) // 2
    first_row, last_row = _grid_lines(center[1] - half_y, center[1] + half_y, pitch, rows)
    first, last = _grid_lines(center[0] - half_x, center[0] + half_x, pitch, columns)
    if last < first:
        return top
    x = np.arange(first, last + 1) * pitch - center[0]
    found, along, up = np.empty(x.size), rotation[0].copy(), rotation[2].copy()
    for axis in range(3):
        if abs(up[axis]) < PARALLEL:
            up[axis] = PARALLEL
    for row in range(first_row, last_row + 1):
        y = row * pitch - center[1]
        start = rotation[1] * y
        found[:] = NOTHING_MM
        if kind == SPHERE:
            _ball(x, y, np.zeros(3), size[0], found)
        elif kind == ELLIPSOID:
            _ellipsoid(x, start, along, up, size, found)
        elif kind == BOX:
            _box(x, start, along, up, size, found)
        elif kind == PLANE:
            _plane(x, start, along, up, size, found)
        elif kind == CYLINDER:
            _cylinder(x, start, along, up, size, found)
        else:
            _tube(x, start, along, up, size, found)
            _ball(x, y, rotation[:, 2] * size[1], size[0], found)
            _ball(x, y, rotation[:, 2] * -size[1], size[0], found)
        out = heights[row + rows + 1, first + columns + 1 : last + columns + 2]
        top = _raise_row(found, center[2], behind, top, out)
    return top


@compiled("f8(f8[::1], f8, f8, f8, f4[::1])", **FAST)
def _raise_row(found, middle, behind, top, out):
    """Raise a row of a map to heights above `middle`; a NOTHING_MM among them is left out."""
    highest = np.float32(top)
    for n in range(out.size):
        height = np.float32(found[n] + middle if found[n] > NOTHING_MM else NOTHING_MM)
        height = height if height <= behind else np.float32(NOTHING_MM)
        out[n] = out[n] if out[n] > height else height
        highest = highest if highest > height else height
    return highest


@compiled(inline="always")
def _grid_lines(low, high, pitch, limit):
    """First and last grid line between two coordinates, within -limit to limit."""
    outside = (limit + 1) * pitch
    first = np.ceil((min(max(low, -outside), outside) - EDGE_MM) / pitch)
    last = np.floor((min(max(high, -outside), outside) + EDGE_MM) / pitch)
    return max(int(first), -limit), min(int(last), limit)


@compiled("f8(i8, f8[::1], f8[::1])", nogil=True)
def _half_extent(kind, size, direction):
    """Half the extent of a geom, mm, along a unit vector in its frame."""
    if kind == PLANE:
        return np.inf
    if kind == SPHERE:
        return size[0]
    if kind == CAPSULE:
        return size[0] + size[1] * abs(direction[2])
    if kind == CYLINDER:
        return size[0] * np.hypot(direction[0], direction[1]) + size[1] * abs(direction[2])
    if kind == ELLIPSOID:
        return np.sqrt(np.sum((size * direction) ** 2))
    return np.sum(size * np.abs(direction))


@compiled("void(f8[::1], f8, f8[::1], f8, f8[::1])", nogil=True)
def _ball(x, y, middle, radius, found):
    """middle: (3,) of the ball, from the geom's center, along the shape frame's axes."""
    for n in range(x.size):
        square = radius**2 - (x[n] - middle[0]) ** 2 - (y - middle[1]) ** 2
        if square >= 0.0:
            found[n] = max(found[n], middle[2] + np.sqrt(square))


@compiled(f"void({ROW}, f8[::1])", nogil=True)
def _ellipsoid(x, start, along, up, size, found):
    """Upper intersections with the unit sphere of the coordinates divided by the half axes."""
    o0, o1, o2 = start[0] / size[0], start[1] / size[1], start[2] / size[2]
    a0, a1, a2 = along[0] / size[0], along[1] / size[1], along[2] / size[2]
    u0, u1, u2 = up[0] / size[0], up[1] / size[1], up[2] / size[2]
    square = u0 * u0 + u1 * u1 + u2 * u2
    dot, change = o0 * u0 + o1 * u1 + o2 * u2, a0 * u0 + a1 * u1 + a2 * u2
    for n in range(x.size):
        p0, p1, p2 = o0 + a0 * x[n], o1 + a1 * x[n], o2 + a2 * x[n]
        c0, c1, c2 = p1 * u2 - p2 * u1, p2 * u0 - p0 * u2, p0 * u1 - p1 * u0
        root = square - c0 * c0 - c1 * c1 - c2 * c2
        if root >= 0.0:
            found[n] = (np.sqrt(root) - dot - change * x[n]) / square


@compiled(f"void({ROW}, f8[::1])", nogil=True)
def _box(x, start, along, up, size, found):
    """Upper ends of the intervals between all three pairs of faces."""
    r0, r1, r2 = (
        (size[0] + EDGE_MM) / abs(up[0]),
        (size[1] + EDGE_MM) / abs(up[1]),
        (size[2] + EDGE_MM) / abs(up[2]),
    )
    for n in range(x.size):
        m0 = -(start[0] + along[0] * x[n]) / up[0]
        m1 = -(start[1] + along[1] * x[n]) / up[1]
        m2 = -(start[2] + along[2] * x[n]) / up[2]
        upper = min(m0 + r0, m1 + r1, m2 + r2)
        if upper >= max(m0 - r0, m1 - r1, m2 - r2):
            found[n] = upper


@compiled(f"void({ROW}, f8[::1])", nogil=True)
def _plane(x, start, along, up, size, found):
    """A half space below z = 0 of its frame; nothing where its surface faces away."""
    if up[2] > PARALLEL:
        for n in range(x.size):
            found[n] = -(start[2] + along[2] * x[n]) / up[2]


@compiled(f"void({ROW}, f8[::1])", nogil=True)
def _cylinder(x, start, along, up, size, found):
    """Upper end of each vertical line's interval within the side and between the caps."""
    radius, half = size[0] + EDGE_MM, (size[1] + EDGE_MM) / abs(up[2])
    square = up[0] ** 2 + up[1] ** 2
    for n in range(x.size):
        o0, o1, o2 = (
            start[0] + along[0] * x[n],
            start[1] + along[1] * x[n],
            start[2] + along[2] * x[n],
        )
        root = square * radius**2 - (o0 * up[1] - o1 * up[0]) ** 2
        if root >= 0.0:
            side, cap = -(o0 * up[0] + o1 * up[1]) / square, -o2 / up[2]
            reach = np.sqrt(root) / square
            upper = min(side + reach, cap + half)
            if upper >= max(side - reach, cap - half):
                found[n] = upper


@compiled(f"void({ROW}, f8[::1])", nogil=True)
def _tube(x, start, along, up, size, found):
    """The side of a capsule."""
    square = up[0] ** 2 + up[1] ** 2
    for n in range(x.size):
        o0, o1, o2 = (
            start[0] + along[0] * x[n],
            start[1] + along[1] * x[n],
            start[2] + along[2] * x[n],
        )
        root = square * size[0] ** 2 - (o0 * up[1] - o1 * up[0]) ** 2
        if root >= 0.0:
            side = (np.sqrt(root) - o0 * up[0] - o1 * up[1]) / square
            if abs(o2 + side * up[2]) <= size[1]:
                found[n] = side


@compiled(f"f8(f4[:, :, ::1], f8[:, :, ::1], b1, f8, {POSE}, {MAP})", nogil=True)
def raise_to_triangles(
    triangles, boxes, closed, depth, rotation, center, pitch, behind, top, heights
):
    """Raise a map to the parts of a mesh that are at most `depth` below the greatest height.

    triangles: (n, 3, 3), in blocks of BLOCK. boxes: (blocks, 2, 3) centers and half extents of the
    blocks' bounding boxes. Both in mm in the geom frame. closed: whether triangles that face down
    are left out.
    """
    # From here on x is in columns and y in rows of the map.
    per_cell = np.array([1 / pitch, 1 / pitch, 1.0])
    rotation, middle = rotation * per_cell[:, None], center * per_cell
    middle[0] += heights.shape[1] // 2
    middle[1] += heights.shape[0] // 2
    upper = np.empty(boxes.shape[0])
    for block in range(upper.size):
        x, y, z = _moved(rotation, middle, boxes[block, 0])
        half_x, half_y, half_z = _moved(np.abs(rotation), np.zeros(3), boxes[block, 1])
        inside = x + half_x >= 0.0 and x - half_x <= heights.shape[1]
        inside &= y + half_y >= 0.0 and y - half_y <= heights.shape[0]
        upper[block] = z + half_z if inside and z - half_z <= behind else -np.inf
    for block in np.argsort(-upper):
        if upper[block] < top - depth or upper[block] == -np.inf:
            break
        for n in range(BLOCK * block, min(BLOCK * block + BLOCK, triangles.shape[0])):
            a = _moved(rotation, middle, triangles[n, 0])
            b = _moved(rotation, middle, triangles[n, 1])
            c = _moved(rotation, middle, triangles[n, 2])
            area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
            if area == 0.0:
                continue  # seen edge-on: its neighbors include its outline
            if max(a[2], b[2], c[2]) < top - depth:
                continue
            if area > 0.0:
                top = _raise_to_triangle(a, b, c, area, EDGE_MM / pitch, behind, top, heights)
            elif not closed:
                top = _raise_to_triangle(a, c, b, -area, EDGE_MM / pitch, behind, top, heights)
    return top


@compiled(inline="always")
def _moved(rotation, center, point):
    """A point of the geom frame in the frame of the map, (x, y, z)."""
    x, y, z = np.float64(point[0]), np.float64(point[1]), np.float64(point[2])
    return (
        center[0] + rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z,
        center[1] + rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z,
        center[2] + rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z,
    )


@compiled(inline="always")
def _side(a, b, edge):
    """Bounds of rows by a side from a to b of a triangle on its left: x at y = 0 and change with y,
    of the left and of the right bound; infinite where the side is on the other side of the row."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    room = edge * (abs(dx) + abs(dy))
    dy = LEVEL if abs(dy) < LEVEL else dy
    start, change = a[0] + (room - dx * a[1]) / dy, dx / dy
    if dy > 0.0:
        return -np.inf, 0.0, start, change
    return start, change, np.inf, 0.0


TRIANGLE = "UniTuple(f8, 3), UniTuple(f8, 3), UniTuple(f8, 3), f8, f8"
"""Types of a triangle's corners, counterclockwise, its double area, and its outline's tolerance."""


@compiled(f"f8({TRIANGLE}, f8, f8, f4[:, ::1])", **FAST)
def _raise_to_triangle(a, b, c, area, edge, behind, top, heights):
    """Raise a map to a triangle whose x is in columns and y in rows."""
    highest = np.float32(top)
    first_row = max(int(np.ceil(min(a[1], b[1], c[1]) - edge)), 1)
    last_row = min(int(np.floor(max(a[1], b[1], c[1]) + edge)), heights.shape[0] - 2)
    lowest_x = max(np.ceil(min(a[0], b[0], c[0]) - edge), 1.0)
    greatest_x = min(np.floor(max(a[0], b[0], c[0]) + edge), heights.shape[1] - 2.0)
    if last_row < first_row or greatest_x < lowest_x:
        return top
    left_0, left_1, right_0, right_1 = _side(a, b, edge)
    left_2, left_3, right_2, right_3 = _side(b, c, edge)
    left_4, left_5, right_4, right_5 = _side(c, a, edge)
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


@compiled("UniTuple(i8, 4)(f4[:, ::1], f8, f8)", nogil=True)
def lower_to_top(heights, top, depth):
    """Lower a map so that its highest point is at 0, and clear what is deeper than `depth`.

    Returns the first and last row, and the first and last column that are not empty.
    """
    nothing, by, least = np.float32(NOTHING_MM), np.float32(top), np.float32(-depth)
    used, first_row, last_row = np.zeros(heights.shape[1], np.bool_), -1, -1
    for row in range(heights.shape[0]):
        out, any_used = heights[row], False
        for column in range(out.size):
            height = out[column] - by
            kept = height >= least
            out[column] = height if kept else nothing
            used[column] |= kept
            any_used |= kept
        if any_used:
            first_row, last_row = row if first_row < 0 else first_row, row
    columns = np.flatnonzero(used)
    return first_row, last_row, columns[0], columns[-1]
