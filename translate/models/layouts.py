"""A trained translator applied to a taxel layout that it was not trained on.

touch2touch draws a tactile image, and any layout's phi^-1 can read one. A field is read by
sim.cyskin.field_reading. ResNet18 has one output a taxel, so it cannot be read elsewhere.

Shape letters: S the run's image side, N taxels of the new layout.
"""

import numpy as np
from scipy.spatial import ConvexHull

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.sim.cyskin.layout import Layout
from t2twin.sim.cyskin.phi import Phi
from t2twin.translate.data.pairs import DataInfo

SAME_MM = 1e-3
"""Two layouts whose taxels lie within this of each other are one layout, mm (assumed: far below
any printed board)."""

OUTSIDE_MM = 0.01
"""How far a taxel may lie outside the trained layout's hull, mm: positions are often rounded."""

SAME_COVER = 1e-6
"""Parts of a pixel by which two hulls' covers may differ and count as the same (assumed)."""


def same_layout(trained: DataInfo, x_mm: np.ndarray, y_mm: np.ndarray) -> bool:
    """Whether these are the trained layout's positions, in its order. x_mm, y_mm: (N,), mm."""
    own, other = np.stack([trained.x_mm, trained.y_mm]), np.stack([x_mm, y_mm])
    return own.shape == other.shape and bool(np.abs(own - other).max() < SAME_MM)


def checked_counts(counts: object, data: DataInfo) -> np.ndarray:
    """(N,) or (B, N) float32. Raises T2TwinError for what cannot be counts of the layout."""
    found = arguments.array(counts, "counts").astype(np.float32)
    if found.ndim not in (1, 2) or found.shape[-1] != data.x_mm.size:
        raise T2TwinError(
            f"counts have shape {found.shape}; they must be ({data.x_mm.size},) or "
            f"(B, {data.x_mm.size}), one for each taxel of {data.layout}"
        )
    if not ((found >= 0) & (found <= data.full_scale_counts)).all():
        raise T2TwinError(
            f"a count is no number from 0 to {data.full_scale_counts:,.0f}, as the taxels of "
            f"{data.layout} give"
        )
    return found


def same_pads(one: Layout, other: Layout) -> bool:
    """Whether two layouts of the same positions have pads of the same sizes."""
    return bool(np.abs(one.pad_diameter_mm - other.pad_diameter_mm).max() < SAME_MM)


def check_inside(trained: DataInfo, x_mm: np.ndarray, y_mm: np.ndarray, name: str) -> None:
    """Raises T2TwinError for taxels outside the trained layout's convex hull.

    The tactile image says nothing there. x_mm, y_mm: (N,), mm. name: the new layout's.
    """
    sides = ConvexHull(np.column_stack([trained.x_mm, trained.y_mm])).equations  # (sides, 3)
    off_mm = (np.stack([x_mm, y_mm, np.ones_like(x_mm)], axis=1) @ sides.T).max(axis=1)
    outside = np.flatnonzero(off_mm > OUTSIDE_MM)
    if outside.size:
        n = int(outside[off_mm[outside].argmax()])
        raise T2TwinError(
            f"the layout {name} has {outside.size} taxel(s) outside the array that the run was "
            f"trained on ({trained.layout}), such as taxel {n} at x {x_mm[n]:g} mm, y "
            f"{y_mm[n]:g} mm, {off_mm[n]:.2f} mm off; all must lie inside, where there is a "
            "tactile image to read"
        )


def reading_at(new: Phi, trained: Phi) -> Phi:
    """`new` with a phi^-1 that reads images made by `trained`, both (S, S).

    A pixel on the rim of the new hull holds what lies outside it too, which the new phi knows
    nothing of; where the two hulls cover it differently, the pixel is left out.
    Raises T2TwinError where the other pixels do not tell the new taxels apart.
    """
    covers = [phi.matrix.sum(axis=1) for phi in (new, trained)]
    return new.with_inverse_from(np.flatnonzero(np.abs(covers[0] - covers[1]) < SAME_COVER))
