"""The mean pressure on pads under a contact, and dense counts, from which pads can be read.

Dense counts are those of a pad at each place of a fine grid over the cover, through the array's
first taxel. The best linear estimate of another pad is its covariance with them times the inverse
of theirs (Wiener filter, simple kriging). The pressure is taken as white noise (assumed: contacts
have edges), so that covariances are overlaps of the pads' kernels. The transducer's nonlinearity is
neglected.

Shape letters: N taxels, F places of the dense counts.
"""

from functools import lru_cache
from typing import Literal

import numpy as np

from t2twin.core.cache_dir import cached_array, short_digest
from t2twin.core.errors import T2TwinError
from t2twin.core.jit import compiled
from t2twin.sim.contact.closed_forms import spectra
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.types import Contact
from t2twin.sim.taxels.layout import MAX_TAXELS, Layout
from t2twin.sim.taxels.spec import DenseTable

Force = Literal["normal", "moment", "shear"]

EDGE_MM = 0.25  # least distance of a place from the cover's edge (assumed: half a cell)
# distance within which a taxel lies on a place of the dense counts (assumed: rounding)
SAME_MM = 1e-3
# Variance of the error of a place's count over its own (assumed): predicted counts are less smooth
# than true ones, which the weights would amplify.
NOISE_SHARE = 1e-2
# points of a Hankel transform, up to where the cover transmits 1e-4, of responses and covariances
RESPONSE_POINTS, COVARIANCE_POINTS = 3000, 2000
RADII = 600  # distances at which the transform is computed; it is interpolated between them


def pad_pressure_mpa(contact: Contact, layout: Layout) -> np.ndarray:
    """Mean normal stress on each taxel's pad under a contact, (n,), MPa.

    A cell's force acts at its center of pressure; shear raises the stress in front of a slide.
    Raises T2TwinError for a layout that extends beyond the contact's grid.
    """
    cover = contact.elastomer
    key = cover.thickness_mm, cover.poisson, tuple(contact.x_mm), tuple(contact.y_mm), layout
    loads: dict[Force, np.ndarray] = {
        "normal": 1e-3 * contact.pressure_kpa.astype(np.float64),
        "moment": 1e-3 * contact.moments_kpa_mm,
    }
    if contact.motion is not None:
        loads["shear"] = contact.motion.shear_mpa
    stress = np.zeros(layout.size)
    for force, load in loads.items():
        by_direction = np.array(load, float).reshape(-1, contact.pressure_kpa.size)
        for weights, values in zip(_weights(*key, force), by_direction, strict=True):
            _add_stress(weights, values, stress)
    return stress


@compiled(nogil=True)
def _add_stress(weights, values, stress):
    """Add the effect of the cells' few values; the bits of a BLAS product depend on the threads."""
    for cell in range(values.size):
        if values[cell] != 0.0:
            for n in range(stress.size):
                stress[n] += weights[cell, n] * values[cell]


@lru_cache(maxsize=16)
def _weights(
    thickness_mm: float, poisson: float, x_mm: tuple[float, ...], y_mm: tuple[float, ...],
    layout: Layout, force: Force,
) -> np.ndarray:  # fmt: skip
    """(1 or 2 directions, cells, n) mean stress on each pad per unit of load on each cell."""
    check_within(layout, max(x_mm), max(y_mm))
    x, y = np.meshgrid(x_mm, y_mm)
    pitch = x_mm[1] - x_mm[0]
    ahead = np.stack([layout.x_mm - x.ravel()[:, None], layout.y_mm - y.ravel()[:, None]])
    distance = np.hypot(*ahead)
    k = np.linspace(1e-4, 25.0 / thickness_mm, RESPONSE_POINTS)
    layer = spectra(k, thickness_mm, 1.0, poisson)
    spectrum, bessel = {
        "normal": (layer.base_pressure, "j0"),
        # per mm nearer to the pad, 1/mm^3; the derivative of J0 is -J1
        "moment": (k * layer.base_pressure, "j1"),
        "shear": (layer.base_shear, "j1"),  # along the line from the force to the pad
    }[force]
    # a cell is a Gaussian with the second moment of the square, p^2 / 12 along each axis
    cell = np.exp(-((k * pitch) ** 2) / 24)
    weights = np.empty_like(distance)
    for diameter in set(layout.pad_diameter_mm):
        same = layout.pad_diameter_mm == diameter
        of_pad = spectrum * disc_transform(k, diameter) * cell * k / (2 * np.pi)
        weights[:, same] = pitch**2 * _at_distances(distance[:, same], of_pad, k, bessel)
    return weights[None] if force == "normal" else weights * ahead / np.maximum(distance, 1e-9)


def _at_distances(
    distance_mm: np.ndarray, spectrum: np.ndarray, k: np.ndarray, bessel: str = "j0"
) -> np.ndarray:
    """Hankel transform of a spectrum over wavenumbers, at distances of any shape."""
    r_mm = np.linspace(0.0, float(distance_mm.max()) + 0.1, RADII)
    key = repr((short_digest(spectrum.tobytes() + k.tobytes()), bessel, float(r_mm[-1])))
    profile = cached_array(
        "taxels", key, __file__,
        lambda: np.trapezoid(spectrum * _bessel(bessel, r_mm[:, None] * k), k, axis=1),
    )  # fmt: skip
    return np.interp(distance_mm, r_mm, profile)


def disc_transform(wavenumber: np.ndarray, diameter_mm: float) -> np.ndarray:
    """Hankel transform of the mean over a round pad of radius a, 2 J1(k a) / (k a)."""
    reach = wavenumber * diameter_mm / 2
    key = "disc " + short_digest(reach.tobytes())
    return cached_array("taxels", key, __file__, lambda: 2 * _bessel("j1", reach) / reach)


def _bessel(name: str, values: np.ndarray) -> np.ndarray:
    from scipy import special  # slow to import

    return getattr(special, name)(values)


def dense_tractions(places: Layout, cell_mm2: float, contact: Contact) -> np.ndarray:
    """Normal pressure and traction along x and y at the dense counts' places, (3, F) float32, kPa:
    force over the area of each place."""
    nearest = _nearest_place(places, tuple(contact.x_mm), tuple(contact.y_mm))
    share = contact.pitch_mm**2 / cell_mm2
    stresses = (contact.pressure_kpa, *contact.shear_kpa)
    found = [share * np.bincount(nearest, each.ravel(), places.size) for each in stresses]
    return np.stack(found).astype(np.float32)


@lru_cache(maxsize=8)
def dense_layout(cover: Elastomer, table: DenseTable, taxels: Layout, pitch_mm: float) -> Layout:
    """The places on a cover, column by column, rising in y, of a grid through the first taxel.
    pitch_mm: of the contact's grid."""
    spacing, is_triangular = table.spacing_mm, table.grid == "triangular"
    across = (spacing * np.sqrt(0.75), spacing / 2) if is_triangular else (spacing, 0.0)
    steps_mm = np.array([across, (0.0, spacing)])
    reach_x, reach_y = reach_mm(cover, pitch_mm)
    most = int(np.ceil((cover.width_mm + 2 * cover.length_mm) / spacing))
    steps = np.arange(-most, most + 1)
    i, j = (each.ravel() for each in np.meshgrid(steps, steps, indexing="ij"))
    taxels_mm = np.column_stack([taxels.x_mm, taxels.y_mm])
    x, y = taxels_mm[0][:, None] + steps_mm.T @ np.stack([i, j])
    on = (np.abs(x) <= min(reach_x, cover.width_mm / 2 - EDGE_MM)) & (
        np.abs(y) <= min(reach_y, cover.length_mm / 2 - EDGE_MM)
    )
    if (count := int(on.sum())) > MAX_TAXELS:
        raise T2TwinError(
            f"the dense counts of {cover.name} have {count} places, {spacing:g} mm apart; at most "
            f"{MAX_TAXELS} can be, so use a larger spacing_mm in its table [dense]"
        )
    x, y = x[on], y[on]
    # Layouts are rounded to 0.1 um; their places replace the computed ones.
    distance, nearest = _nearest(x, y, taxels_mm)
    same = distance < SAME_MM
    x[nearest[same]], y[nearest[same]] = taxels_mm[same].T
    return Layout("dense", x, y, np.full(count, taxels.pad_diameter_mm[0]))


@lru_cache(maxsize=8)
def _nearest_place(places: Layout, x_mm: tuple[float, ...], y_mm: tuple[float, ...]) -> np.ndarray:
    """(rows * columns,) the place nearest to each cell of a contact's grid."""
    cells = np.stack(np.meshgrid(x_mm, y_mm), axis=-1).reshape(-1, 2)
    return _nearest(places.x_mm, places.y_mm, cells)[1]


def _nearest(x_mm: np.ndarray, y_mm: np.ndarray, to_mm: np.ndarray) -> tuple[np.ndarray, ...]:
    """Distance to the nearest of the places (x, y) from each point, mm, and its index."""
    points = np.column_stack([x_mm, y_mm])

    def nearest() -> np.ndarray:
        from scipy.spatial import KDTree  # slow to import

        return np.stack(KDTree(points).query(to_mm))

    key = f"nearest {short_digest(points.tobytes())} {short_digest(to_mm.tobytes())}"
    distance, index = cached_array("taxels", key, __file__, nearest)
    return distance, index.astype(int)


def reading_matrix(places: Layout, layout: Layout, cover: Elastomer) -> np.ndarray:
    """The matrix (N, F) from dense counts at places, with pads of one diameter, to the counts of a
    layout's taxels. Raises T2TwinError for taxels that do not lie on the cover."""
    check_within(layout, *reach_mm(cover))
    pad_mm = float(places.pad_diameter_mm[0])
    inverse = _inverse(places, cover)
    matrix = np.empty((layout.size, places.size))
    distances = layout.distances_mm(places)
    for diameter in set(layout.pad_diameter_mm):
        same = layout.pad_diameter_mm == diameter
        matrix[same] = _covariance(distances[same], diameter, pad_mm, cover) @ inverse
    same = (distances.min(axis=1) < SAME_MM) & (layout.pad_diameter_mm == pad_mm)
    matrix[same] = np.eye(places.size)[distances[same].argmin(axis=1)]
    return matrix


@lru_cache(maxsize=8)
def _inverse(places: Layout, cover: Elastomer) -> np.ndarray:
    """Inverse of the covariance of the places of the dense counts, (F, F)."""
    pad_mm = float(places.pad_diameter_mm[0])
    covariance = _covariance(places.distances_mm(places), pad_mm, pad_mm, cover)
    return np.linalg.inv(covariance + NOISE_SHARE * covariance[0, 0] * np.eye(places.size))


def _covariance(
    distance_mm: np.ndarray, diameter_mm: float, pad_mm: float, cover: Elastomer
) -> np.ndarray:
    """Covariance, for a white pressure, of a pad and one of the dense counts at distances."""
    k = np.linspace(1e-4, 25.0 / cover.thickness_mm, COVARIANCE_POINTS)
    transmission = spectra(k, cover.thickness_mm, 1.0, cover.poisson).base_pressure ** 2
    own, other = disc_transform(k, diameter_mm), disc_transform(k, pad_mm)
    return _at_distances(distance_mm, transmission * own * other * k / (2 * np.pi), k)


def check_within(layout: Layout, reach_x_mm: float, reach_y_mm: float) -> None:
    """Raises T2TwinError for a layout with taxels farther from the cover's center."""
    outside = (np.abs(layout.x_mm) > reach_x_mm) | (np.abs(layout.y_mm) > reach_y_mm)
    if outside.any():
        n = int(np.flatnonzero(outside)[0])
        raise T2TwinError(
            f"the layout {layout.name} has {int(outside.sum())} taxel(s) off the cover, such as "
            f"taxel {n} at x {layout.x_mm[n]:g} mm, y {layout.y_mm[n]:g} mm; it reaches "
            f"{reach_x_mm:g} mm in x and {reach_y_mm:g} mm in y from its center"
        )


def reach_mm(cover: Elastomer, pitch_mm: float = 0.0) -> tuple[float, float]:
    """x and y of the outermost cells' centers of a contact's grid, mm; of the edges for pitch 0."""
    halves = cover.width_mm / 2, cover.length_mm / 2
    if pitch_mm == 0.0:
        return halves
    x_mm, y_mm = (int(half / pitch_mm + 1e-9) * pitch_mm - pitch_mm / 2 for half in halves)
    return x_mm, y_mm
