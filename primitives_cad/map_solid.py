"""The solid under a height map in any pose, and the loop that raises another map to it.

The surface is that of the map, two triangles a cell, with vertical sides where the map ends.
"""

import numpy as np

from t2twin.core.jit import compiled
from t2twin.primitives_cad.height_map import EDGE_MM
from t2twin.primitives_cad.shape import NOTHING_MM
from t2twin.primitives_cad.triangles import OUTLINE, STEEP, raise_to_triangle

SIDE_MM = 10.0
"""Height of the sides below the lowest point of the map, mm (assumed: more than any layer)."""

EVEN_MM = 1.0e-4
"""Distance from a plane, mm, within which neighboring cells of a row are one part (assumed: far
below any depth)."""

POINT, CELL = "UniTuple(f8, 3)", "UniTuple(i8, 2)"
FRAME = "Tuple((f8[:, ::1], f8, f8, f8, i8, i8))"
"""Types of a point, of a row and column of the source, and of what `_moved` needs."""

MOST = 10
"""Largest number of triangles of a part of a row: two, and two of each of its sides."""

NOT_SOLID = np.float32(-2.0)
"""Marks a cell without four solid corners, in place of the vertical component of a normal."""


@compiled("f8(f4[:, ::1], f8, f8, f8, f8[:, ::1], f8, f4[:, ::1])", nogil=True)
def raise_to_map(source, first_x, first_y, cell, rotation, pitch, heights):
    """Raise a map to the solid under another one, and return the greatest height.

    source: (ny, nx) heights on points `cell` apart from first_x, first_y, mm. rotation: of the
    solid. pitch, heights: of the map that is raised, as in t2twin.primitives_cad.triangles.
    """
    ups = _ups(source, cell, rotation)
    floor = _lowest(source) - SIDE_MM
    # From here on x is in columns and y in rows of the map.
    turned = np.empty((3, 3))
    for axis in range(3):
        for n in range(3):
            turned[axis, n] = rotation[axis, n] if axis == 2 else rotation[axis, n] / pitch
    frame = (turned, first_x, first_y, cell, heights.shape[1] // 2, heights.shape[0] // 2)
    edge, top = EDGE_MM / pitch, NOTHING_MM
    triangles, shifts = np.empty((MOST, 3, 3)), np.full((MOST, 3), edge)
    for i in range(ups.shape[0]):
        j = 0
        while j < ups.shape[1]:
            if ups[i, j] == NOT_SOLID:
                j += 1
                continue
            end = _end_of_part(source, ups, i, j)
            count = _part(frame, source, ups, i, j, end, floor, edge, triangles, shifts)
            for n in range(count):
                a, b, c = (
                    _corner(triangles, n, 0),
                    _corner(triangles, n, 1),
                    _corner(triangles, n, 2),
                )
                area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
                if area > 0.0:
                    ab, bc, ca = shifts[n, 0], shifts[n, 1], shifts[n, 2]
                    top = raise_to_triangle(a, b, c, area, ab, bc, ca, np.inf, top, heights)
            j = end
    return top


@compiled(
    f"i8({FRAME}, f4[:, ::1], f4[:, ::1], i8, i8, i8, f8, f8, f8[:, :, ::1], f8[:, ::1])",
    nogil=True,
)
def _part(frame, source, ups, i, j, end, floor, edge, triangles, shifts):
    """Write the triangles of the cells of row i from column j to before end, and of sides next to
    them that face up, and the columns by which their edges are moved; their number.

    floor: height at which sides end. edge: see `_shift`.
    """
    to_right, to_upper = frame[0][2, 0], frame[0][2, 1]
    lower, upper = _beyond(ups, i - 1, j), _beyond(ups, i + 1, j)
    left, right = _beyond(ups, i, j - 1), _beyond(ups, i, end)
    a, b = _place(frame, source, i, j), _place(frame, source, i, end)
    c, d = _place(frame, source, i + 1, end), _place(frame, source, i + 1, j)
    _write(a, b, c, triangles, 0)
    _write(a, c, d, triangles, 1)
    shifts[0, 0], shifts[0, 1] = _shift(lower, -to_upper, edge), _shift(right, to_right, edge)
    shifts[1, 1], shifts[1, 2] = _shift(upper, to_upper, edge), _shift(left, -to_right, edge)
    shifts[0, 2] = shifts[1, 0] = edge
    count = 2
    if lower == NOT_SOLID and to_upper < 0.0:
        count = _side(frame, a, b, (i, j), (i, end), floor, triangles, count)
    if right == NOT_SOLID and to_right > 0.0:
        count = _side(frame, b, c, (i, end), (i + 1, end), floor, triangles, count)
    if upper == NOT_SOLID and to_upper > 0.0:
        count = _side(frame, c, d, (i + 1, end), (i + 1, j), floor, triangles, count)
    if left == NOT_SOLID and to_right < 0.0:
        count = _side(frame, d, a, (i + 1, j), (i, j), floor, triangles, count)
    return count


@compiled(f"i8({FRAME}, {POINT}, {POINT}, {CELL}, {CELL}, f8, f8[:, :, ::1], i8)", nogil=True)
def _side(frame, one, other, at, then, floor, triangles, count):
    """Write the two triangles of a side below two points, at two places of the source; the number
    of all triangles so far. count: the number before."""
    below, after = _moved(frame, at[0], at[1], floor), _moved(frame, then[0], then[1], floor)
    _write(below, after, other, triangles, count)
    _write(below, other, one, triangles, count + 1)
    return count + 2


@compiled(inline="always")
def _write(a, b, c, triangles, n):
    """Write the corners of the n-th triangle."""
    for axis in range(3):
        triangles[n, 0, axis], triangles[n, 1, axis] = a[axis], b[axis]
        triangles[n, 2, axis] = c[axis]


@compiled(inline="always")
def _corner(triangles, n, k):
    """A corner of a triangle."""
    return triangles[n, k, 0], triangles[n, k, 1], triangles[n, k, 2]


@compiled(inline="always")
def _shift(outside, up, edge):
    """Columns by which a part's edge is moved outward: half of one at an outline.

    outside: vertical component of the normal of the cell beyond. up: that of a vertical side. edge:
    columns by which other edges are moved.
    """
    steepness = up if outside == NOT_SOLID else outside
    return OUTLINE if steepness < STEEP else edge


@compiled(inline="always")
def _beyond(ups, i, j):
    """The value of a cell, NOT_SOLID outside the map."""
    if i < 0 or j < 0 or i >= ups.shape[0] or j >= ups.shape[1]:
        return NOT_SOLID
    return ups[i, j]


@compiled(inline="always")
def _moved(frame, i, j, height):
    """The point at a height over a point of the source, in columns, rows and mm of the map."""
    turned, first_x, first_y, cell, column, row = frame
    x, y = first_x + j * cell, first_y + i * cell
    return (
        column + turned[0, 0] * x + turned[0, 1] * y + turned[0, 2] * height,
        row + turned[1, 0] * x + turned[1, 1] * y + turned[1, 2] * height,
        turned[2, 0] * x + turned[2, 1] * y + turned[2, 2] * height,
    )


@compiled(inline="always")
def _place(frame, source, i, j):
    """A point of the source's surface in the map."""
    return _moved(frame, i, j, np.float64(source[i, j]))


@compiled("i8(f4[:, ::1], f4[:, ::1], i8, i8)", nogil=True)
def _end_of_part(source, ups, i, j):
    """The column after the last cell of the plane part of a row that starts with a cell.

    Its neighbors above and below are outlines along the whole part, or nowhere.
    """
    start, along = np.float64(source[i, j]), np.float64(source[i, j + 1] - source[i, j])
    across = np.float64(source[i + 1, j] - source[i, j])
    end = j + 1
    if abs(source[i + 1, end] - (start + along + across)) > EVEN_MM:
        return end
    lower, upper = _kind(ups, i - 1, j), _kind(ups, i + 1, j)
    while end < ups.shape[1] and ups[i, end] != NOT_SOLID:
        expected = start + along * (end + 1 - j)
        if (
            abs(source[i, end + 1] - expected) > EVEN_MM
            or abs(source[i + 1, end + 1] - (expected + across)) > EVEN_MM
            or _kind(ups, i - 1, end) != lower
            or _kind(ups, i + 1, end) != upper
        ):
            break
        end += 1
    return end


@compiled(inline="always")
def _kind(ups, i, j):
    """Whether a cell is not solid, 2; steep, 1; or neither, 0."""
    up = _beyond(ups, i, j)
    return 2 if up == NOT_SOLID else (1 if up < STEEP else 0)


@compiled("f8(f4[:, ::1])", nogil=True)
def _lowest(source):
    """The lowest solid height, mm."""
    lowest = 0.0
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            if source[i, j] > NOTHING_MM / 2:
                lowest = min(lowest, np.float64(source[i, j]))
    return lowest


@compiled("f4[:, ::1](f4[:, ::1], f8, f8[:, ::1])", nogil=True)
def _ups(source, cell, rotation):
    """(ny - 1, nx - 1) vertical component of the cells' turned unit normals, or NOT_SOLID."""
    ups = np.empty((source.shape[0] - 1, source.shape[1] - 1), np.float32)
    for i in range(ups.shape[0]):
        for j in range(ups.shape[1]):
            a, b = source[i, j], source[i, j + 1]
            c, d = source[i + 1, j], source[i + 1, j + 1]
            if min(a, b, c, d) <= NOTHING_MM / 2:
                ups[i, j] = NOT_SOLID
            elif a == b == c == d:
                ups[i, j] = rotation[2, 2]
            else:
                x, y = (a + c - b - d) / (2 * cell), (a + b - c - d) / (2 * cell)
                up = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2]
                ups[i, j] = up / np.sqrt(x * x + y * y + 1.0)
    return ups
