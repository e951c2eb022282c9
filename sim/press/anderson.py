"""Anderson's acceleration of an iteration x <- g(x)."""

import numpy as np

MEMORY = 4
"""Earlier steps that are kept; more does not save steps here."""

RIDGE = 1e-8
"""Relative addition to the normal equations' diagonal, so that equal steps do no harm."""

GROWN = 2.0
"""Growth of the residual in a step beyond which the earlier steps are forgotten."""


class Anderson:
    """Steps of a fixed-point iteration combined so that the residual is least.

    Walker and Ni, SIAM J. Numer. Anal. 49, 2011: of all mixtures of the last steps, with weights
    that add up to 1, take the one whose linearised residual g(x) - x is smallest.
    """

    def __init__(self) -> None:
        self._points: list[np.ndarray] = []
        self._residuals: list[np.ndarray] = []

    def next(self, point: np.ndarray, image: np.ndarray) -> np.ndarray:
        """Where to evaluate g next, (n,), after g(point) = image, both (n,)."""
        residual = image - point
        if self._residuals and np.abs(residual).sum() > GROWN * np.abs(self._residuals[-1]).sum():
            self._points, self._residuals = [], []
        self._points = [*self._points[-MEMORY:], point]
        self._residuals = [*self._residuals[-MEMORY:], residual]
        if len(self._points) == 1:
            return image
        steps = np.diff(np.array(self._points), axis=0)
        changes = np.diff(np.array(self._residuals), axis=0)
        # einsum and not a BLAS product, whose last bits depend on the number of threads.
        normal = np.einsum("in,jn->ij", changes, changes)
        normal[np.diag_indices(len(normal))] *= 1 + RIDGE
        weights = np.linalg.solve(normal, np.einsum("in,n->i", changes, residual))
        return image - np.einsum("i,in->n", weights, steps + changes)
