"""Checks of taxel layouts that a trained translator is read at.

Shape letters: S image side of the run, N taxels of the new layout.
"""

import numpy as np
from scipy.spatial import ConvexHull

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.sim.cyskin.layout import Layout
from t2twin.sim.cyskin.phi import Phi
from t2twin.translate.data.pairs import DataInfo

SAME_MM = 1e-3
"""Largest distance of corresponding taxels of equal layouts, mm (assumed: far below the tolerance
of a printed board)."""

OUTSIDE_MM = 0.01
"""Largest distance of a taxel outside the trained layout's hull, mm: positions are often
rounded."""

SAME_COVER = 1e-6
"""Largest difference of two hulls' coverage of a pixel, as a fraction (assumed)."""


def same_layout(trained: DataInfo, x_mm: np.ndarray, y_mm: np.ndarray) -> bool:
    """Whether positions equal those of the trained layout, in its order. x_mm, y_mm: (N,), mm."""
    own, other = np.stack([trained.x_mm, trained.y_mm]), np.stack([x_mm, y_mm])
    return own.shape == other.shape and bool(np.abs(own - other).max() < SAME_MM)


def checked_counts(counts: object, data: DataInfo) -> np.ndarray:
    """Counts of the layout as an array, (N,) or (B, N) float32; T2TwinError if they are invalid."""
    found = arguments.array(counts, "counts").astype(np.float32)
    if found.ndim not in (1, 2) or found.shape[-1] != data.x_mm.size:
        raise T2TwinError(
            f"counts have shape {found.shape}; they must be ({data.x_mm.size},) or "
            f"(B, {data.x_mm.size}), one for each taxel of {data.layout}"
        )
    if not ((found >= 0) & (found <= data.full_scale_counts)).all():
        raise T2TwinError(
            f"a count is out of range; expected numbers from 0 to {data.full_scale_counts:,.0f}, "
            f"the range of the taxels of {data.layout}"
        )
    return found


def same_pads(one: Layout, other: Layout) -> bool:
    """Whether two layouts of equal positions have pads of equal sizes."""
    return bool(np.abs(one.pad_diameter_mm - other.pad_diameter_mm).max() < SAME_MM)


def check_inside(trained: DataInfo, x_mm: np.ndarray, y_mm: np.ndarray, name: str) -> None:
    """Raises T2TwinError for taxels outside the trained layout's hull, where images are undefined.

    x_mm, y_mm: (N,), mm. name: the new layout's.
    """
    sides = ConvexHull(np.column_stack([trained.x_mm, trained.y_mm])).equations  # (sides, 3)
    distance_mm = (np.stack([x_mm, y_mm, np.ones_like(x_mm)], axis=1) @ sides.T).max(axis=1)
    outside = np.flatnonzero(distance_mm > OUTSIDE_MM)
    if outside.size:
        n = int(outside[distance_mm[outside].argmax()])
        raise T2TwinError(
            f"the layout {name} has {outside.size} taxel(s) outside the array that the run was "
            f"trained on ({trained.layout}), such as taxel {n} at x {x_mm[n]:g} mm, y "
            f"{y_mm[n]:g} mm, {distance_mm[n]:.2f} mm outside; expected all taxels inside, where "
            "the tactile image is defined"
        )


def reading_at(new: Phi, trained: Phi) -> Phi:
    """`new` with a phi^-1 that reads images made by `trained`, both (S, S).

    phi^-1 ignores the pixels on the rim that the two hulls cover differently, because their values
    also depend on what lies outside the new hull.
    Raises T2TwinError if the other pixels do not determine the new taxels.
    """
    covers = [phi.matrix.sum(axis=1) for phi in (new, trained)]
    return new.with_inverse_from(np.flatnonzero(np.abs(covers[0] - covers[1]) < SAME_COVER))
