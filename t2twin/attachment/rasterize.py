"""Compiled loops that raise a height map to the geoms of a MuJoCo model.

All loops work in the shape frame of t2twin.primitives_cad.shape at x = y = yaw = 0: x of the
sensor, minus its y, and the height, which is minus its z. Lengths are in mm.

A map is (2 rows + 3, 2 columns + 3) float32, centered on the axis, with a rim of NOTHING_MM. A
geom's pose is its rotation to the shape frame, (3, 3), and its center, (3,). Surfaces above
`behind` are left out. Each loop takes the greatest height so far and returns the new one.
"""

import numpy as np

from t2twin.core.jit import compiled
from t2twin.primitives_cad.shape import NOTHING_MM
from t2twin.primitives_cad.triangles import EDGE_MM, FAST, MAP, OUTLINE, POSE, STEEP

PLANE, SPHERE, CAPSULE, ELLIPSOID, CYLINDER = 0, 2, 3, 4, 5
"""Values of MuJoCo's mjtGeom."""

MEAN_ALONG_AXES = 4 / np.pi
"""Mean over all directions of the sum of the absolute components of a unit vector."""

PARALLEL = 1.0e-9
"""Smallest component of the vertical in a geom's frame, in place of smaller ones (assumed: it moves
no surface of a meter by more than 1e-6 mm)."""

ROW = "f8[::1], f8[::1], f8[::1], f8[::1], f8[::1]"
"""Types of a row of grid points: their x from the geom's center, and four vectors in the geom
frame. These are the row's start, the direction of x, the vertical, and the geom's size."""


@compiled(f"f8(i8, f8[::1], {POSE}, {MAP})", nogil=True)
def raise_to_primitive(kind, size, rotation, center, pitch, behind, top, heights):
    """Raise a map to a geom with a formula. size: (3,) as geom_size, mm."""
    if kind == CYLINDER:
        is_upright, is_lying = abs(rotation[2, 2]) > 1.0 - STEEP**2 / 2, abs(rotation[2, 2]) < STEEP
        size = size.copy()
        along_axes = abs(rotation[0, 2]) + abs(rotation[1, 2])
        size[0] += OUTLINE * pitch * MEAN_ALONG_AXES if is_upright else EDGE_MM
        size[1] += OUTLINE * pitch * along_axes if is_lying else EDGE_MM
    middle_row, middle_column = heights.shape[0] // 2, heights.shape[1] // 2
    reach = _half_extent(kind, size, rotation[1])
    first_row, last_row = _grid_lines(center[1], reach, pitch, middle_row)
    reach = _half_extent(kind, size, rotation[0])
    first, last = _grid_lines(center[0], reach, pitch, middle_column)
    if last < first:
        return top
    x, found = np.empty(last - first + 1), np.empty(last - first + 1)
    for n in range(x.size):
        x[n] = (first + n) * pitch - center[0]
    start, up = np.empty(3), np.empty(3)
    for axis in range(3):
        up[axis] = rotation[2, axis] if abs(rotation[2, axis]) > PARALLEL else PARALLEL
    for row in range(first_row, last_row + 1):
        y = row * pitch - center[1]
        for axis in range(3):
            start[axis] = rotation[1, axis] * y
        for n in range(x.size):
            found[n] = NOTHING_MM
        if kind == SPHERE:
            _ball(x, y, 0.0, 0.0, 0.0, size[0], found)
        elif kind == ELLIPSOID:
            _ellipsoid(x, start, rotation[0], up, size, found)
        elif kind == PLANE:
            _plane(x, start, rotation[0], up, size, found)
        elif kind == CYLINDER:
            _cylinder(x, start, rotation[0], up, size, found)
        else:
            dx, dy, dz = (
                rotation[0, 2] * size[1],
                rotation[1, 2] * size[1],
                rotation[2, 2] * size[1],
            )
            _tube(x, start, rotation[0], up, size, found)
            _ball(x, y, dx, dy, dz, size[0], found)
            _ball(x, y, -dx, -dy, -dz, size[0], found)
        out = heights[row + middle_row, first + middle_column : last + middle_column + 1]
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


@compiled("UniTuple(i8, 2)(f8, f8, f8, i8)", nogil=True)
def _grid_lines(center, reach, pitch, limit):
    """First and last grid line within reach of a center, which are within -limit and limit."""
    low, high = max(center - reach, -limit * pitch), min(center + reach, limit * pitch)
    first, last = int(np.ceil((low - EDGE_MM) / pitch)), int(np.floor((high + EDGE_MM) / pitch))
    return max(first, 1 - limit), min(last, limit - 1)


@compiled("f8(i8, f8[::1], f8[::1])", nogil=True)
def _half_extent(kind, size, direction):
    """Half the extent of a geom, mm, along a unit vector in its frame."""
    x, y, z = abs(direction[0]), abs(direction[1]), abs(direction[2])
    if kind == PLANE:
        return np.inf
    if kind == SPHERE:
        return size[0]
    if kind == CAPSULE:
        return size[0] + size[1] * z
    if kind == CYLINDER:
        return size[0] * np.sqrt(x * x + y * y) + size[1] * z
    x, y, z = size[0] * x, size[1] * y, size[2] * z
    return np.sqrt(x * x + y * y + z * z)


@compiled("void(f8[::1], f8, f8, f8, f8, f8, f8[::1])", **FAST)
def _ball(x, y, dx, dy, dz, radius, found):
    """dx, dy, dz: place of the ball from the geom's center, along the shape frame's axes."""
    most = radius * radius - (y - dy) * (y - dy)
    for n in range(x.size):
        square = most - (x[n] - dx) * (x[n] - dx)
        height = dz + np.sqrt(square if square > 0.0 else 0.0)
        height = height if square >= 0.0 else NOTHING_MM
        found[n] = found[n] if found[n] > height else height


@compiled(f"void({ROW}, f8[::1])", **FAST)
def _ellipsoid(x, start, along, up, size, found):
    """Upper intersections with the unit sphere of the coordinates divided by the half axes."""
    o0, o1, o2 = start[0] / size[0], start[1] / size[1], start[2] / size[2]
    a0, a1, a2 = along[0] / size[0], along[1] / size[1], along[2] / size[2]
    u0, u1, u2 = up[0] / size[0], up[1] / size[1], up[2] / size[2]
    square = u0 * u0 + u1 * u1 + u2 * u2
    dot, change, per_square = o0 * u0 + o1 * u1 + o2 * u2, a0 * u0 + a1 * u1 + a2 * u2, 1 / square
    for n in range(x.size):
        p0, p1, p2 = o0 + a0 * x[n], o1 + a1 * x[n], o2 + a2 * x[n]
        c0, c1, c2 = p1 * u2 - p2 * u1, p2 * u0 - p0 * u2, p0 * u1 - p1 * u0
        root = square - c0 * c0 - c1 * c1 - c2 * c2
        height = (np.sqrt(root if root > 0.0 else 0.0) - dot - change * x[n]) * per_square
        found[n] = height if root >= 0.0 else NOTHING_MM


@compiled(f"void({ROW}, f8[::1])", **FAST)
def _plane(x, start, along, up, size, found):
    """A half space below z = 0 of its frame; nothing where its surface faces away."""
    per = -1 / up[2]
    for n in range(x.size):
        found[n] = (start[2] + along[2] * x[n]) * per if up[2] > PARALLEL else NOTHING_MM


@compiled(f"void({ROW}, f8[::1])", **FAST)
def _cylinder(x, start, along, up, size, found):
    """Upper ends of the intervals within the side and between the caps."""
    radius, half = size[0], size[1] / abs(up[2])
    square, per_up = up[0] * up[0] + up[1] * up[1], 1 / up[2]
    most, per_square = square * radius * radius, 1 / square
    for n in range(x.size):
        o0, o1 = start[0] + along[0] * x[n], start[1] + along[1] * x[n]
        cross = o0 * up[1] - o1 * up[0]
        root = most - cross * cross
        reach = np.sqrt(root if root > 0.0 else 0.0) * per_square
        side, cap = -(o0 * up[0] + o1 * up[1]) * per_square, -(start[2] + along[2] * x[n]) * per_up
        upper, lower = min(side + reach, cap + half), max(side - reach, cap - half)
        found[n] = upper if root >= 0.0 and upper >= lower else NOTHING_MM


@compiled(f"void({ROW}, f8[::1])", **FAST)
def _tube(x, start, along, up, size, found):
    """The side of a capsule."""
    square = up[0] * up[0] + up[1] * up[1]
    most, per_square = square * size[0] * size[0], 1 / square
    for n in range(x.size):
        o0, o1 = start[0] + along[0] * x[n], start[1] + along[1] * x[n]
        cross = o0 * up[1] - o1 * up[0]
        root = most - cross * cross
        side = (np.sqrt(root if root > 0.0 else 0.0) - o0 * up[0] - o1 * up[1]) * per_square
        inside = root >= 0.0 and abs(start[2] + along[2] * x[n] + side * up[2]) <= size[1]
        found[n] = side if inside else NOTHING_MM


@compiled("void(f4[:, ::1], f8, f8, b1[::1], b1[::1])", nogil=True)
def lower_to_top(heights, top, depth, used_rows, used_columns):
    """Lower a map so that its highest point is at 0, and clear what is deeper than `depth`.

    used_rows, used_columns: False; set where a row or column is not empty.
    """
    nothing, by, least = np.float32(NOTHING_MM), np.float32(top), np.float32(-depth)
    for row in range(heights.shape[0]):
        out, used = heights[row], False
        for column in range(out.size):
            height = out[column] - by
            kept = height >= least
            out[column] = height if kept else nothing
            used_columns[column] |= kept
            used |= kept
        used_rows[row] = used


@compiled("i8(f4[:, :], i8)", nogil=True)
def width_cells(heights, most):
    """Side of the largest square of points of a map that a shape covers, at most `most`."""
    sides, widest = np.zeros(heights.shape[1], np.int64), 0
    for i in range(heights.shape[0]):
        before = 0  # of the point above and to the left
        for j in range(heights.shape[1]):
            above, side = sides[j], 0
            if heights[i, j] > NOTHING_MM / 2:
                left = sides[j - 1] if j > 0 else 0
                side = 1 + min(before, min(above, left))
            before, sides[j], widest = above, side, max(widest, side)
        if widest >= most:
            return most
    return widest
