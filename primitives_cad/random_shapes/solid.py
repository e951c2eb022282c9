"""The solid under a height map: a plate that carries it, closed all round."""

import numpy as np
import trimesh

from t2twin.primitives_cad.primitive_parameters import PLATE_THICKNESS_MM
from t2twin.primitives_cad.shape import NOTHING_MM, HeightMap


def solid_under(surface: HeightMap) -> trimesh.Trimesh:
    """A closed mesh, mm, whose upper side is the surface, two triangles a cell.

    The rim of NOTHING_MM is left out; below the lowest height lies a plate.
    """
    rows, columns = (np.flatnonzero((surface.heights_mm > NOTHING_MM / 2).any(axis=axis))
                     for axis in (1, 0))  # fmt: skip
    rows, columns = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    heights = surface.heights_mm[rows, columns].astype(float)
    x, y = np.meshgrid(surface.x_mm[columns], surface.y_mm[rows])
    ny, nx = heights.shape
    top = np.column_stack([x.ravel(), y.ravel(), heights.ravel()])
    number = np.arange(ny * nx).reshape(ny, nx)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    faces = [np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))]
    # the rim, counter-clockwise seen from above, and its like at the plate's underside
    rim = np.concatenate([number[0, :-1], number[:-1, -1], number[-1, :0:-1], number[:0:-1, 0]])
    floor = float(heights.min()) - PLATE_THICKNESS_MM
    below = np.column_stack([top[rim, :2], np.full(rim.size, floor)])
    under = len(top) + np.arange(rim.size)
    on, under_on = np.roll(rim, -1), np.roll(under, -1)
    faces += [np.column_stack([rim, under, under_on]), np.column_stack([rim, under_on, on])]
    middle = len(top) + rim.size
    faces.append(np.column_stack([np.full(rim.size, middle), under_on, under]))
    center = np.array([[*top[:, :2].mean(axis=0), floor]])
    return trimesh.Trimesh(
        np.concatenate([top, below, center]), np.concatenate(faces), process=False
    )
