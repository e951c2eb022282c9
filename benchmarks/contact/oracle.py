"""An independent solution of the contact problem, for comparison with the contact solver.

The elastic layer is the same; elasticity, discretization and solver are independent. The equations
of elasticity are integrated through the thickness for each plane wave. The pressure is constant on
each cell, and contact is enforced at the centers of the cells. The solver is a constrained
conjugate gradient iteration (Polonsky and Keer, Wear 231, 1999). No code is shared with the contact
solver, and MuJoCo is not used.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.fft import irfft2, next_fast_len, rfft2
from scipy.interpolate import CubicSpline
from scipy.linalg import expm

from t2twin.core.errors import T2TwinError

ALIASES = 4
"""Spectral images summed on either side."""

THICK = 12.0
"""Wavenumber times thickness beyond which a layer is a half-space: what is left is below 1e-8."""

THIN = 1e-3
"""Wavenumber times thickness below which a wave is as good as none."""

WAVES = 300
"""Waves between THIN and THICK that are integrated, and splined between."""


def wave(reduced: float, poisson: float) -> tuple[float, float]:
    """Sinking of the top, times shear modulus x wavenumber, and the base's stress, under a wave.

    The pressure is cos(k x) on a layer of thickness h, with k h = reduced. The displacements are
    a sin(k x) along x and b cos(k x) along z. The stresses over the shear modulus are t sin(k x) in
    shear and s cos(k x) along z. Hooke's law and equilibrium give four linear equations in k z. One
    matrix exponential relates the base (a = b = 0) to the top (t = 0, s = -1).
    """
    lame = 2 * poisson / (1 - 2 * poisson)
    confined = lame + 2
    growth = np.array(
        [
            [0, 1, 1, 0],
            [-lame / confined, 0, 0, 1 / confined],
            [confined - lame**2 / confined, 0, 0, lame / confined],
            [0, 0, -1, 0],
        ]
    )
    through = expm(growth * reduced)
    at_base = np.linalg.solve(through[2:, 2:], [0.0, -1.0])
    return -float(through[1, 2:] @ at_base), -float(at_base[1])


class Waves:
    """Compliance and base stress of a bonded layer, mm/MPa and 1, at any wavenumber, rad/mm."""

    def __init__(self, thickness_mm: float, young_mpa: float, poisson: float) -> None:
        self.thickness_mm = thickness_mm
        self.half_space = 2 * (1 - poisson**2) / young_mpa
        shear = young_mpa / (2 * (1 + poisson))
        reduced = np.geomspace(THIN, THICK, WAVES)
        sinking, base = np.array([wave(float(s), poisson) for s in reduced]).T
        self._sinking = CubicSpline(np.log(reduced), sinking * thickness_mm / shear / reduced)
        self._base = CubicSpline(np.log(reduced), base)

    def compliance(self, wavenumber: np.ndarray) -> np.ndarray:
        reduced = np.maximum(wavenumber * self.thickness_mm, THIN)
        within = np.log(np.minimum(reduced, THICK))
        beyond = self.half_space * self.thickness_mm / reduced
        return np.where(reduced < THICK, self._sinking(within), beyond)

    def base_stress(self, wavenumber: np.ndarray) -> np.ndarray:
        reduced = np.maximum(wavenumber * self.thickness_mm, THIN)
        return np.where(reduced < THICK, self._base(np.log(np.minimum(reduced, THICK))), 0.0)


@dataclass(frozen=True)
class Answer:
    """depth_mm; pressure_mpa and deflection_mm on the gap's grid."""

    depth_mm: float
    pressure_mpa: np.ndarray
    deflection_mm: np.ndarray


def kernel(
    rows: int, columns: int, pitch_mm: float, thickness_mm: float, young_mpa: float, poisson: float
) -> np.ndarray:
    """Deflection of cells' middles per unit pressure on one, (2 rows - 1, 2 columns - 1)."""
    n = int(np.ceil(max(2.5 * max(rows, columns) * pitch_mm, 14 * thickness_mm) / pitch_mm))
    # The spectrum is even in both wavenumbers: a quarter of it says it all.
    base = 2 * np.pi * np.arange(n // 2 + 1) / (n * pitch_mm)
    shifts = 2 * np.pi * np.arange(-ALIASES, ALIASES + 1) / pitch_mm
    waves = Waves(thickness_mm, young_mpa, poisson)
    quarter = np.zeros((base.size, base.size))
    for shift_x in shifts:
        kx = base[None, :] + shift_x
        for shift_y in shifts:
            ky = base[:, None] + shift_y
            cell = np.sinc(kx * pitch_mm / 2 / np.pi) * np.sinc(ky * pitch_mm / 2 / np.pi)
            quarter += cell * waves.compliance(np.hypot(kx, ky))
    mirrored = quarter[np.abs(np.fft.fftfreq(n, 1 / n)).astype(int)]
    whole = np.fft.fftshift(np.fft.irfft2(mirrored, (n, n)))
    middle = n // 2
    return whole[middle - rows + 1 : middle + rows, middle - columns + 1 : middle + columns]


def solve(
    gap_mm: np.ndarray,
    force_n: float,
    pitch_mm: float,
    answer_of_cell: np.ndarray,
    tolerance: float = 1e-5,
    most: int = 6000,
    start: np.ndarray | None = None,
) -> Answer:
    """Contact of a rigid shape, given by its gaps (rows, columns), under a force.

    answer_of_cell: what `kernel` gave for this grid. tolerance: change of the pressure in an
    iteration, as a share of all of it, below which it has ended; most: iterations. start: a
    pressure near the solution, (rows, columns). Raises T2TwinError where they are not enough.
    """
    deflection = deflection_under(answer_of_cell)
    area = pitch_mm**2
    if start is None:
        start = np.where(gap_mm <= np.quantile(gap_mm, 0.1), 1.0, 0.0)
    pressure = start * (force_n / (start.sum() * area))
    direction = np.zeros_like(pressure)
    last_square, restart = 1.0, True
    for _ in range(most):
        touching = pressure > 0
        residual = deflection(pressure) + gap_mm
        residual -= residual[touching].mean()
        square = float((residual[touching] ** 2).sum())
        turn = 0.0 if restart else square / last_square
        direction = np.where(touching, residual + turn * direction, 0.0)
        last_square = square
        answer = deflection(direction)
        answer -= answer[touching].mean()
        step = (residual[touching] * direction[touching]).sum() / (
            answer[touching] * direction[touching]
        ).sum()
        moved = np.where(touching, np.maximum(pressure - step * direction, 0.0), 0.0)
        entering = (moved == 0) & (residual < 0)
        restart = bool(entering.any())
        moved[entering] -= step * residual[entering]
        moved *= force_n / (moved.sum() * area)
        change = np.abs(moved - pressure).sum() / pressure.sum()
        pressure = moved
        if change < tolerance:
            sunk = deflection(pressure)
            depth = float((sunk + gap_mm)[pressure > 0].mean())
            return Answer(depth, pressure, sunk)
    raise T2TwinError(f"the oracle did not settle within {most} iterations")


def deflection_under(answer_of_cell: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Deflection of every cell's middle, mm, under a pressure on the cells, MPa, both
    (rows, columns); answer_of_cell: what `kernel` gave for so many."""
    rows, columns = (side // 2 + 1 for side in answer_of_cell.shape)
    # What wraps round falls on places that are not read.
    padded = next_fast_len(2 * rows - 1, real=True), next_fast_len(2 * columns - 1, real=True)
    spectrum = np.asarray(rfft2(answer_of_cell, padded))

    def deflection(pressure: np.ndarray) -> np.ndarray:
        answers = np.asarray(irfft2(np.asarray(rfft2(pressure, padded)) * spectrum, padded))
        return answers[rows - 1 : 2 * rows - 1, columns - 1 : 2 * columns - 1]

    return deflection
