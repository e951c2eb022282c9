"""Anderson's acceleration of an iteration x <- g(x)."""

import numpy as np

from t2twin.core.jit import compiled

MEMORY = 4
"""Earlier steps that are kept; more does not save steps here."""

RIDGE = 1e-8
"""Relative addition to the normal equations' diagonal, so that equal steps do no harm."""

GROWN = 2.0
"""Growth of the residual in a step beyond which the earlier steps are forgotten."""


@compiled("b1(f8[:, ::1])", nogil=True)
def _eliminate(system):
    """Solves (k, k + 1) equations into their last column; False where they have no one solution."""
    size = len(system)
    for k in range(size):
        pivot = k
        for i in range(k, size):
            if not abs(system[i, k]) <= abs(system[pivot, k]):  # larger, or not a number
                pivot = i
        if not abs(system[pivot, k]) > 0.0:
            return False
        for m in range(size + 1):
            system[k, m], system[pivot, m] = system[pivot, m], system[k, m]
        for i in range(size):
            if i != k:
                part = system[i, k] / system[k, k]
                for m in range(k, size + 1):
                    system[i, m] -= part * system[k, m]
    for k in range(size):
        system[k, size] /= system[k, k]
    return True


@compiled(
    "b1(f8[:, ::1], f8[:, ::1], f8[:, ::1], i8, i8, f8[::1], f8[::1], f8[::1], f8[::1], f8[::1])",
    nogil=True,
)
def _mix(images, changes, normal, row, kept, last_image, last_residual, image, residual, mixed):
    """Takes a step into row of the kept ones, and mixes them; False where they are dependent."""
    size = image.size
    for n in range(size):
        images[row, n] = image[n] - last_image[n]
        changes[row, n] = residual[n] - last_residual[n]
    system = np.empty((kept, kept + 1))
    for k in range(kept):
        product, side = 0.0, 0.0
        for n in range(size):
            product += changes[k, n] * changes[row, n]
            side += changes[k, n] * residual[n]
        normal[row, k] = normal[k, row] = product
        system[k, kept] = side
    for k in range(kept):
        for m in range(kept):
            system[k, m] = normal[k, m] * (1 + RIDGE if k == m else 1.0)
    if not _eliminate(system):
        return False
    for n in range(size):  # an array set to another compiles words for its errors
        mixed[n] = image[n]
    for k in range(kept):
        for n in range(size):
            mixed[n] -= system[k, kept] * images[k, n]
    return True


class Anderson:
    """Steps of a fixed-point iteration combined so that the residual is least.

    Walker and Ni, SIAM J. Numer. Anal. 49, 2011: of all mixtures of the last steps, with weights
    that add up to 1, take the one whose linearized residual g(x) - x is smallest.
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
        row, self._kept = self._next, min(self._kept + 1, MEMORY)
        self._next = (row + 1) % MEMORY
        mixed = np.empty_like(image)
        kept = self._images, self._changes, self._normal
        if _mix(*kept, row, self._kept, *last, image, residual, mixed):
            return mixed
        self._kept = self._next = 0  # a step that changed nothing, or the same as an earlier one
        return image
