"""The mean pressure on the pads of taxels under a contact.

The cover spreads the pressure of the contact; a pad averages the stress at its base.
"""

from functools import lru_cache, partial
from typing import Literal

import numpy as np
from scipy import special

from t2twin.core.cached_files import cached_array
from t2twin.core.errors import T2TwinError
from t2twin.core.jit import compiled
from t2twin.sim.contact.layer import base_stress
from t2twin.sim.contact.tangential.kernels import spectra
from t2twin.sim.contact.types import Contact
from t2twin.sim.taxels.layout import Layout

Force = Literal["normal", "moment", "shear"]


def pad_pressure_mpa(contact: Contact, layout: Layout) -> np.ndarray:
    """Mean normal stress on each taxel's pad under a contact, (n,), MPa.

    Where a cell is pressed unevenly, its force acts at its center of pressure.
    Shear contributes to the stress: it raises it in front of a sliding shape.
    Raises T2TwinError for a layout that extends beyond the contact's grid.
    """
    key = (
        contact.elastomer.thickness_mm, contact.elastomer.poisson,
        tuple(contact.x_mm), tuple(contact.y_mm),
        tuple(layout.x_mm), tuple(layout.y_mm), tuple(layout.pad_diameter_mm),
    )  # fmt: skip
    loads: dict[Force, np.ndarray] = {
        "normal": 1e-3 * contact.pressure_kpa.astype(np.float64),
        "moment": 1e-3 * contact.moments_kpa_mm,
    }
    if contact.motion is not None:
        loads["shear"] = contact.motion.shear_mpa
    stress = np.zeros(layout.size)
    for force, load in loads.items():
        by_direction = np.ascontiguousarray(load, float).reshape(-1, contact.pressure_kpa.size)
        for weights, values in zip(_weights(*key, force), by_direction, strict=True):
            _add_stress(weights, values, stress)
    return stress


@compiled("void(f8[:, ::1], f8[::1], f8[::1])", nogil=True)
def _add_stress(weights, values, stress):
    """Add the effect of values on the cells, (cells,), to the pads' mean stress, (n,).

    Few cells are loaded. The last bits of a BLAS product would depend on the number of threads.
    """
    for cell in range(values.size):
        if values[cell] != 0.0:
            for n in range(stress.size):
                stress[n] += weights[cell, n] * values[cell]


@lru_cache(maxsize=16)
def _weights(
    thickness_mm: float,
    poisson: float,
    x_mm: tuple[float, ...],
    y_mm: tuple[float, ...],
    taxel_x_mm: tuple[float, ...],
    taxel_y_mm: tuple[float, ...],
    diameter_mm: tuple[float, ...],
    force: Force,
) -> np.ndarray:
    """Mean stress on each pad per unit of load on each cell: "normal", (1, rows * columns, n), or
    "moment" (1/mm) or "shear" along x and y, (2, rows * columns, n)."""
    taxel_x, taxel_y = np.array(taxel_x_mm), np.array(taxel_y_mm)
    reach_x, reach_y = max(x_mm), max(y_mm)
    if (np.abs(taxel_x) > reach_x).any() or (np.abs(taxel_y) > reach_y).any():
        raise T2TwinError(
            f"the layout has taxels outside the cover, which reaches {reach_x:g} mm in x and "
            f"{reach_y:g} mm in y from its center"
        )
    x, y = np.meshgrid(x_mm, y_mm)
    pitch = x_mm[1] - x_mm[0]
    ahead = np.stack([taxel_x - x.ravel()[:, None], taxel_y - y.ravel()[:, None]])
    distance = np.hypot(*ahead)
    weights = pitch**2 * _pad_responses(distance, pitch, thickness_mm, poisson, diameter_mm, force)
    return weights[None] if force == "normal" else weights * ahead / np.maximum(distance, 1e-9)


def _pad_responses(
    distance_mm: np.ndarray,
    pitch_mm: float,
    thickness_mm: float,
    poisson: float,
    diameter_mm: tuple[float, ...],
    force: Force,
) -> np.ndarray:
    """Mean stress on n round pads by a unit force on a cell at a distance, both (m, n), 1/mm^2.

    pitch_mm: side of the cell. force: "shear" is along the line from the force to the pad; "moment"
    is the increase of the stress per mm by which a normal force is nearer to the pad, 1/mm^3.
    Cached on disk.
    """
    responses = np.empty_like(distance_mm)
    for diameter in set(diameter_mm):
        same = np.array(diameter_mm) == diameter
        r = np.linspace(0.0, float(distance_mm[:, same].max()) + 0.1, 600)
        key = repr((force, pitch_mm, thickness_mm, poisson, diameter, float(r[-1])))
        compute = partial(_hankel, r, pitch_mm, thickness_mm, poisson, diameter, force)
        profile = cached_array("taxels", key, __file__, compute)
        responses[:, same] = np.interp(distance_mm[:, same], r, profile)
    return responses


def _hankel(
    r_mm: np.ndarray,
    pitch_mm: float,
    thickness_mm: float,
    poisson: float,
    diameter_mm: float,
    force: Force,
) -> np.ndarray:
    """`_pad_responses` at distances (n,), 1/mm^2, by a Hankel transform.

    The integrand is the stress at the base times the transforms of a disc and of a cell. The latter
    is that of a Gaussian with the second moment of the square, p^2 / 12 along each axis.
    """
    k = np.linspace(1e-4, 25.0 / thickness_mm, 3000)
    if force == "normal":
        spectrum, bessel = base_stress(k, thickness_mm, poisson), special.j0
    elif force == "moment":  # the derivative of J0 is -J1
        spectrum, bessel = k * base_stress(k, thickness_mm, poisson), special.j1
    else:
        spectrum, bessel = spectra(k, thickness_mm, 1.0, poisson).base_shear, special.j1
    disc, cell = disc_transform(k, diameter_mm), np.exp(-((k * pitch_mm) ** 2) / 24)
    spectrum = spectrum * disc * cell * k / (2 * np.pi)
    return np.trapezoid(spectrum * bessel(r_mm[:, None] * k), k, axis=1)


def disc_transform(wavenumber: np.ndarray, diameter_mm: float) -> np.ndarray:
    """Hankel transform of the mean over a round pad of radius a, 2 J1(k a) / (k a)."""
    reach = wavenumber * diameter_mm / 2
    return 2 * special.j1(reach) / reach
