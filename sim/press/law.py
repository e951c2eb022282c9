"""How a soft layer stiffens: from the linear layer's deflection to the real one."""

import numpy as np

from t2twin.primitives_cad.jit import compiled

NEWTON_STEPS = 2
"""Steps that bring the stretch from its first guess to within 1e-9."""

GUESS = 0.36
"""Of the rational first guess of a stretch, which has the right value and slope for small strain
and goes as it should for large: this makes it right at l^3 + l^2 = 1 too."""


def neo_hookean_mm(
    linear_mm: np.ndarray, thickness_mm: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Deflection w, mm, of a stiffening layer where a linear one would give u, and dw / du.

    Both (rows, columns), as what is given. The linear layer's strain u / h stands for the stress
    over the modulus; a neo-Hookean solid takes that stress at a stretch l with
    (1 / l^2 - l) / 3 = u / h (Treloar, The Physics of Rubber Elasticity, 1975), and w = h (1 - l).
    Equal to u for small strain, below h for any stress; where the surface bulges out (u < 0) it
    stays u. The local strain is taken through the thickness, which leaves out large rotations.
    """
    deflection, slope = np.empty(linear_mm.shape), np.empty(linear_mm.shape)
    _neo_hookean(
        np.ascontiguousarray(linear_mm, np.float64),
        np.ascontiguousarray(thickness_mm, np.float64),
        deflection,
        slope,
    )
    return deflection, slope


@compiled(inline="always")
def stiffened(u, h):
    """Deflection and slope at one place; `neo_hookean_mm` has the formula."""
    if u <= 0.0:
        return u, 1.0
    # Newton's method on l^3 + 3 (u / h) l^2 = 1.
    strain = u / h
    t = 3.0 * strain
    stretch = np.sqrt((1.0 + GUESS * t) / (1.0 + (GUESS + 2.0 / 3.0 + GUESS * t) * t))
    for _ in range(NEWTON_STEPS):
        excess = stretch * stretch * (stretch + 3.0 * strain) - 1.0
        stretch -= excess / (3.0 * stretch * (stretch + 2.0 * strain))
    return h * (1.0 - stretch), stretch / (stretch + 2.0 * strain)


@compiled("void(f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1])", nogil=True)
def _neo_hookean(linear, thickness, deflection, slope):
    for i in range(linear.shape[0]):
        for j in range(linear.shape[1]):
            deflection[i, j], slope[i, j] = stiffened(linear[i, j], thickness[i, j])
