"""An independent answer to the contact problem, to hold the engine against.

The same elastic layer, but its own discretisation and its own solver: pressure constant on each
cell, contact enforced at the cells' middles, and a constrained conjugate-gradient iteration
(Polonsky and Keer, Wear 231, 1999) on the layer's kernel, which is worked out here from the closed
form by its own sum over aliases. It knows nothing of MuJoCo.
"""

from dataclasses import dataclass

import numpy as np
from scipy.signal import fftconvolve

from sim.press.layer import compliance_mm_per_mpa

ALIASES = 4
"""Spectral images summed on either side."""


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
    base = 2 * np.pi * np.fft.fftfreq(n, pitch_mm)
    shifts = 2 * np.pi * np.arange(-ALIASES, ALIASES + 1) / pitch_mm
    spectrum = np.zeros((n, n))
    for shift_x in shifts:
        kx = base[None, :] + shift_x
        for shift_y in shifts:
            ky = base[:, None] + shift_y
            cell = np.sinc(kx * pitch_mm / 2 / np.pi) * np.sinc(ky * pitch_mm / 2 / np.pi)
            k = np.hypot(kx, ky)
            spectrum += cell * compliance_mm_per_mpa(k, thickness_mm, young_mpa, poisson)
    whole = np.fft.fftshift(np.fft.ifft2(spectrum).real)
    middle = n // 2
    return whole[middle - rows + 1 : middle + rows, middle - columns + 1 : middle + columns]


def solve(
    gap_mm: np.ndarray,
    force_n: float,
    pitch_mm: float,
    answer_of_cell: np.ndarray,
    tolerance: float = 1e-5,
    most: int = 500,
) -> Answer:
    """Contact of a rigid shape, given by its gaps (rows, columns), under a force.

    answer_of_cell: what `kernel` gave for this grid.
    """
    rows, columns = gap_mm.shape

    def deflection(pressure: np.ndarray) -> np.ndarray:
        return fftconvolve(pressure, answer_of_cell, mode="full")[
            rows - 1 : 2 * rows - 1, columns - 1 : 2 * columns - 1
        ]

    area = pitch_mm**2
    pressure = np.where(gap_mm <= np.quantile(gap_mm, 0.1), 1.0, 0.0)
    pressure *= force_n / (pressure.sum() * area)
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
            break
    found = deflection(pressure)
    touching = pressure > 0
    return Answer(float((found + gap_mm)[touching].mean()), pressure, found)
