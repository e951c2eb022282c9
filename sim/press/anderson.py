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
    size: unknowns, n.
    """

    def __init__(self, size: int) -> None:
        self._images = np.empty((MEMORY, size))
        self._changes = np.empty((MEMORY, size))
        self._normal = np.empty((MEMORY, MEMORY))
        self._last: tuple[np.ndarray, np.ndarray] | None = None
        self._kept = self._next = 0

    def next(self, point: np.ndarray, image: np.ndarray) -> np.ndarray:
        """Where to evaluate g next, (n,), after g(point) = image, both (n,)."""
        residual = image - point
        last, self._last = self._last, (image, residual)
        if last is None:
            return image
        if np.abs(residual).sum() > GROWN * np.abs(last[1]).sum():
            self._kept = self._next = 0
            return image
        row = self._next
        self._images[row] = image - last[0]
        self._changes[row] = residual - last[1]
        self._kept = min(self._kept + 1, MEMORY)
        self._next = (row + 1) % MEMORY
        changes = self._changes[: self._kept]
        # einsum and not a BLAS product, whose last bits depend on the number of threads.
        products = np.einsum("in,n->i", changes, changes[row])
        self._normal[row, : self._kept] = self._normal[: self._kept, row] = products
        normal = self._normal[: self._kept, : self._kept].copy()
        normal[np.diag_indices(self._kept)] *= 1 + RIDGE
        try:
            weights = np.linalg.solve(normal, np.einsum("in,n->i", changes, residual))
        except np.linalg.LinAlgError:  # a step that changed nothing, or the same as an earlier one
            self._kept = self._next = 0
            return image
        return image - np.einsum("i,in->n", weights, self._images[: self._kept])
