"""Compiled loops that raise a height map to the geoms of a MuJoCo model.

All loops work in the shape frame of t2twin.primitives_cad.shape at x = y = yaw = 0: x of the
sensor, minus its y, and the height, which is minus its z. Lengths are in mm.

A map is (2 rows + 3, 2 columns + 3) float32, centered on the axis, with a rim of NOTHING_MM. A
geom's pose is its rotation to the shape frame, (3, 3), and its center, (3,). Surfaces above
`behind` are left out. Each loop takes the greatest height so far and returns the new one.
"""

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

LEVEL_MM = 1.0e-12
"""Extent along y, mm, below which a triangle's side is parallel to x (assumed)."""

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
        for n in range(x.size):
            height = np.float32(found[n] + center[2])
            if out[n] < height <= behind and found[n] > NOTHING_MM:
                out[n] = height
                top = max(top, height)
    return top


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


@compiled(f"f8(f4[:, :, ::1], f8[:, :, ::1], f8, {POSE}, {MAP})", nogil=True)
def raise_to_triangles(triangles, boxes, depth, rotation, center, pitch, behind, top, heights):
    """Raise a map to the parts of a mesh that are at most `depth` below the greatest height.

    triangles: (n, 3, 3), in blocks of BLOCK. boxes: (blocks, 2, 3) centers and half extents of the
    blocks' bounding boxes. All in mm in the geom frame.
    """
    reach_y, reach_x = pitch * heights.shape[0] / 2, pitch * heights.shape[1] / 2
    upper = np.empty(boxes.shape[0])
    for block in range(upper.size):
        x, y, z = _moved(rotation, center, boxes[block, 0])
        half_x, half_y, half_z = _half_extents(rotation, boxes[block, 1])
        inside = abs(x) - half_x <= reach_x and abs(y) - half_y <= reach_y
        upper[block] = z + half_z if inside and z - half_z <= behind else -np.inf
    for block in np.argsort(-upper):
        if upper[block] < top - depth or upper[block] == -np.inf:
            break
        for n in range(BLOCK * block, min(BLOCK * block + BLOCK, triangles.shape[0])):
            a = _moved(rotation, center, triangles[n, 0])
            b = _moved(rotation, center, triangles[n, 1])
            c = _moved(rotation, center, triangles[n, 2])
            if max(a[2], b[2], c[2]) >= top - depth:
                top = _raise_to_triangle(a, b, c, pitch, behind, top, heights)
    return top


@compiled(inline="always")
def _moved(rotation, center, point):
    """A point of the geom frame in the shape frame, (x, y, z)."""
    x, y, z = np.float64(point[0]), np.float64(point[1]), np.float64(point[2])
    return (
        center[0] + rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z,
        center[1] + rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z,
        center[2] + rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z,
    )


@compiled(inline="always")
def _half_extents(rotation, half):
    """Half extents of a turned box along the shape frame's axes."""
    return (
        abs(rotation[0, 0]) * half[0]
        + abs(rotation[0, 1]) * half[1]
        + abs(rotation[0, 2]) * half[2],
        abs(rotation[1, 0]) * half[0]
        + abs(rotation[1, 1]) * half[1]
        + abs(rotation[1, 2]) * half[2],
        abs(rotation[2, 0]) * half[0]
        + abs(rotation[2, 1]) * half[1]
        + abs(rotation[2, 2]) * half[2],
    )


@compiled(inline="always")
def _left_and_right(a, b, turn, y, left, right):
    """The interval from left to right, cut by a triangle's side from a to b at a height y."""
    dx, dy = turn * (b[0] - a[0]), turn * (b[1] - a[1])
    room = dx * (y - a[1]) + EDGE_MM * np.sqrt(dx * dx + dy * dy)
    if abs(dy) < LEVEL_MM:
        return left, right if room >= 0.0 else -np.inf
    cut = a[0] + room / dy
    return (left, min(right, cut)) if dy > 0.0 else (max(left, cut), right)


@compiled(f"f8(UniTuple(f8, 3), UniTuple(f8, 3), UniTuple(f8, 3), {MAP})", nogil=True)
def _raise_to_triangle(a, b, c, pitch, behind, top, heights):
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    area = ux * vy - uy * vx
    if area == 0.0:
        return top  # seen edge-on: its neighbors include its outline
    turn = 1.0 if area > 0.0 else -1.0
    along_x, along_y = (uz * vy - vz * uy) / area, (ux * vz - vx * uz) / area
    low, high = min(a[2], b[2], c[2]), max(a[2], b[2], c[2])
    rows, columns = (heights.shape[0] - 3) // 2, (heights.shape[1] - 3) // 2
    first_row, last_row = _grid_lines(min(a[1], b[1], c[1]), max(a[1], b[1], c[1]), pitch, rows)
    x_low, x_high = min(a[0], b[0], c[0]) - EDGE_MM, max(a[0], b[0], c[0]) + EDGE_MM
    for row in range(first_row, last_row + 1):
        y = row * pitch
        left, right = _left_and_right(a, b, turn, y, x_low, x_high)
        left, right = _left_and_right(b, c, turn, y, left, right)
        left, right = _left_and_right(c, a, turn, y, left, right)
        if left > right:
            continue
        first = int(np.ceil(max(left, -columns * pitch - EDGE_MM) / pitch))
        last = int(np.floor(min(right, columns * pitch + EDGE_MM) / pitch))
        start = a[2] + along_y * (y - a[1]) - along_x * a[0]
        out = heights[row + rows + 1]
        for column in range(first, last + 1):
            z = np.float32(min(max(start + along_x * (column * pitch), low), high))
            if out[column + columns + 1] < z <= behind:
                out[column + columns + 1] = z
                top = max(top, z)
    return top


@compiled("UniTuple(i8, 4)(f4[:, ::1], f8, f8)", nogil=True)
def lower_to_top(heights, top, depth):
    """Lower a map so that its highest point is at 0, and clear what is deeper than `depth`.

    Returns the first and last row, and the first and last column that are not empty.
    """
    first_row, last_row, first_column, last_column = heights.shape[0], -1, heights.shape[1], -1
    for row in range(heights.shape[0]):
        for column in range(heights.shape[1]):
            height = np.float32(heights[row, column] - top)
            if height < -depth:
                heights[row, column] = NOTHING_MM
                continue
            heights[row, column] = height
            first_row, last_row = min(first_row, row), row
            first_column, last_column = min(first_column, column), max(last_column, column)
    return first_row, last_row, first_column, last_column
