"""A trained translator applied to a taxel layout that it was not trained on.

touch2touch draws a tactile image, and any layout's phi^-1 can read one. ResNet18 has one output a
taxel, so it cannot.

Shape letters: S the run's image side, N taxels of the new layout, M taxels of the trained one.
"""

from copy import copy
from dataclasses import replace

import numpy as np
from scipy.spatial import ConvexHull, Delaunay

from t2twin.primitives_cad.errors import T2TwinError
from t2twin.translate.data.pairs import DataInfo
from t2twin.translate.phi import LARGEST_CONDITION, Phi
from t2twin.translate.predict import TrainedTranslator
from t2twin.translate.touch2touch import Touch2Touch

SAME_MM = 1e-3
"""Two layouts whose taxels lie within this of each other are one layout, mm (assumed: far below
any printed board)."""

OUTSIDE_MM = 0.01
"""How far a taxel may lie outside the trained layout's hull, mm: positions are often rounded."""

SAME_COVER = 1e-6
"""Parts of a pixel by which two hulls' covers may differ and count as the same (assumed)."""


def for_layout(
    run: TrainedTranslator, x_mm: np.ndarray, y_mm: np.ndarray, name: str
) -> TrainedTranslator:
    """The run as a translator for another layout: it predicts those taxels' counts.

    x_mm, y_mm: (N,) taxel positions, mm, sensor frame. name: the layout's.
    The generator's tactile image stays what it is; the new layout's phi^-1 reads it, at the
    generator's size. A run of that very layout is given back as it is.
    Raises T2TwinError for a ResNet18 run, a layout that phi cannot interpolate, taxels outside the
    trained layout's convex hull (the image says nothing there), and taxels too close together for
    the generator's pixels.
    """
    trained = run.config.data
    if same_layout(trained, x_mm, y_mm):
        return run
    if not isinstance(run.translator, Touch2Touch):
        raise T2TwinError(
            f"{run.run_dir} is a ResNet18, which gives the {trained.x_mm.size} taxels of "
            f"{trained.layout} that it was trained on and no others; another layout needs a "
            "touch2touch run"
        )
    x_mm, y_mm = np.asarray(x_mm, dtype=float), np.asarray(y_mm, dtype=float)
    reading = Phi(x_mm, y_mm)
    _check_inside(trained, x_mm, y_mm, name)
    translator = copy(run.translator)
    translator.phi = _reading_of(reading.resized(run.translator.phi.shape), run.translator.phi)
    data = replace(trained, layout=name, x_mm=x_mm, y_mm=y_mm)
    return replace(run, config=replace(run.config, data=data), translator=translator)


def same_layout(trained: DataInfo, x_mm: np.ndarray, y_mm: np.ndarray) -> bool:
    """Whether these are the trained layout's positions, in its order. x_mm, y_mm: (N,), mm."""
    own, other = np.stack([trained.x_mm, trained.y_mm]), np.stack([x_mm, y_mm])
    return own.shape == other.shape and bool(np.abs(own - other).max() < SAME_MM)


def seen_through(trained: DataInfo, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
    """The part of a new layout's counts that the trained layout's tactile images can hold.

    x_mm, y_mm: (N,) taxels inside the trained layout's hull, mm. Returns (N, N): times true counts
    it is the nearest, by least squares, that the interpolation of any M trained taxels takes at
    the new ones.
    """
    points = np.column_stack([trained.x_mm, trained.y_mm])
    triangles = Delaunay(points)
    at = np.column_stack([x_mm, y_mm])
    found = triangles.find_simplex(at, tol=OUTSIDE_MM)
    transform = triangles.transform[found]
    two = np.einsum("pij,pj->pi", transform[:, :2], at - transform[:, 2])
    weights = np.zeros((at.shape[0], points.shape[0]))
    corners = triangles.simplices[found]
    np.put_along_axis(weights, corners, np.column_stack([two, 1.0 - two.sum(axis=1)]), axis=1)
    return weights @ np.linalg.pinv(weights)


def _check_inside(trained: DataInfo, x_mm: np.ndarray, y_mm: np.ndarray, name: str) -> None:
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


def _reading_of(new: Phi, trained: Phi) -> Phi:
    """`new` with a phi^-1 that reads images made by `trained`, both (S, S).

    A pixel on the rim of the new hull holds what lies outside it too, which the new phi knows
    nothing of; where the two hulls cover it differently, the pixel is left out.
    """
    covers = [phi.matrix.sum(axis=1) for phi in (new, trained)]
    kept = np.flatnonzero(np.abs(covers[0] - covers[1]) < SAME_COVER)
    matrix = new.matrix[kept]
    normal = (matrix.T @ matrix).toarray()
    if np.linalg.cond(normal) > LARGEST_CONDITION:
        raise T2TwinError(
            f"the taxels lie too close together, or too near the rim, to be told apart in the "
            f"{trained.shape[0]} x {trained.shape[1]} pixels that the run draws"
        )
    reading = copy(new)
    reading._backward = np.zeros_like(new._backward)
    reading._backward[kept] = matrix @ np.linalg.inv(normal)
    return reading
