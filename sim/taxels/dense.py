"""Dense counts: counts of a pad at each place of a fine grid over the cover of an array.

Counts of any layout of pads can be computed from it. The grid, of triangles or of squares, passes
through the array's first taxel. Taxels on its places have exactly these.

A pad's count is the pressure on the cover, smoothed by the cover and averaged over the pad. The
pressure is modeled as white noise (assumed: contacts have edges), so that the covariance of two
pads is the overlap of their kernels. The best linear estimate of a pad from the dense counts is
that covariance times the inverse of that of the dense counts (Wiener filter, simple kriging). It
takes the size of a pad into account. A pad of the same size at one of their places has that place's
count.

Pressures are additive, counts only approximately; the nonlinearity of the transducer is neglected.

Shape letters: N taxels, F places of the dense counts.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta, Struct
from scipy import special

from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.layer import base_stress
from t2twin.sim.contact.types import Contact
from t2twin.sim.taxels.layout import MAX_TAXELS, Layout
from t2twin.sim.taxels.pads import disc_transform

EDGE_MM = 0.25
"""Least distance of a place from the cover's edge, mm (assumed: half a cell of the contact's
grid)."""

SAME_MM = 1e-3
"""Distance within which a taxel lies on a place of the dense counts, mm (assumed: rounding)."""

NOISE_SHARE = 1e-2
"""Variance of the error of a place's count over its own variance (assumed). Predicted dense counts
are less smooth than a true one; without this term the weights would amplify the difference."""

WAVENUMBERS = 2000
"""Points of the Hankel transform, up to where the cover transmits 1e-4."""

RADII = 600
"""Distances at which the transform is computed; it is interpolated between them."""


class DenseTable(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The grid of the dense counts."""

    spacing_mm: Annotated[
        float, Meta(ge=0.2, le=50.0, description="distance of neighboring places")
    ]
    grid: Annotated[
        Literal["triangular", "square"], Meta(description="triangular or square grid")
    ] = "triangular"


@dataclass(frozen=True)
class DenseGrid:
    """The dense counts of an array. taxels_mm: x and y of its taxels; the grid passes through the
    first one. pad_diameter_mm: of the pads at the places. pitch_mm: of the contact's grid."""

    cover: Elastomer
    table: DenseTable
    taxels_mm: tuple[tuple[float, float], ...]
    pad_diameter_mm: float
    pitch_mm: float = 0.0

    @property
    def cell_mm2(self) -> float:
        """Area of the surface for each place, mm^2."""
        share = np.sqrt(0.75) if self.table.grid == "triangular" else 1.0
        return float(self.table.spacing_mm**2 * share)

    @property
    def layout(self) -> Layout:
        """The places as a layout of pads, column by column, rising in y.

        Raises T2TwinError for more than MAX_TAXELS places.
        """
        return _places(self)

    def tractions(self, contact: Contact) -> np.ndarray:
        """Normal pressure and traction along x and y on the cover, (3, F) float32, kPa.

        Each value is the force on the part of the surface that is nearest to a place, over
        cell_mm2. Their sums times cell_mm2 are the forces on the sensor.
        """
        nearest = _nearest(self, tuple(contact.x_mm), tuple(contact.y_mm))
        share = contact.pitch_mm**2 / self.cell_mm2
        stresses = (contact.pressure_kpa, *contact.shear_kpa)
        size = self.layout.size
        return np.stack(
            [share * np.bincount(nearest, each.ravel(), size) for each in stresses]
        ).astype(np.float32)


def reading_matrix(places: Layout, layout: Layout, cover: Elastomer) -> np.ndarray:
    """The matrix (N, F) from dense counts at places to the counts of a layout's taxels.

    places: with pads of one diameter. Raises T2TwinError for taxels that do not lie on the cover.
    """
    check_on_cover(layout, cover)
    pad_mm = float(places.pad_diameter_mm[0])
    inverse = _inverse(tuple(places.x_mm), tuple(places.y_mm), pad_mm, cover)
    matrix = np.empty((layout.size, places.size))
    distances = layout.distances_mm(places)
    for diameter in set(layout.pad_diameter_mm):
        same = layout.pad_diameter_mm == diameter
        matrix[same] = _covariance(distances[same], diameter, pad_mm, cover) @ inverse
    same = (distances.min(axis=1) < SAME_MM) & (layout.pad_diameter_mm == pad_mm)
    matrix[same] = np.eye(places.size)[distances[same].argmin(axis=1)]
    return matrix


def _covariance(
    distance_mm: np.ndarray, diameter_mm: float, pad_mm: float, cover: Elastomer
) -> np.ndarray:
    """Covariance of a pad of a diameter and one of the dense counts at distances, same shape.

    The Hankel transform of the product of their spectra, for a white pressure.
    """
    k = np.linspace(1e-4, 25.0 / cover.thickness_mm, WAVENUMBERS)
    transmission = base_stress(k, cover.thickness_mm, cover.poisson) ** 2
    own, other = disc_transform(k, diameter_mm), disc_transform(k, pad_mm)
    spectrum = transmission * own * other * k / (2 * np.pi)
    radii = np.linspace(0.0, float(distance_mm.max()) + 0.1, RADII)
    profile = np.trapezoid(spectrum * special.j0(radii[:, None] * k), k, axis=1)
    return np.interp(distance_mm, radii, profile)


def check_on_cover(layout: Layout, cover: Elastomer, pitch_mm: float = 0.0) -> None:
    """Raises T2TwinError for a layout with taxels that do not lie on the cover.

    pitch_mm: of the contact's grid, whose outermost cells' centers bound the taxels; 0 for none.
    """
    half_x, half_y = reach_mm(cover, pitch_mm)
    outside = (np.abs(layout.x_mm) > half_x) | (np.abs(layout.y_mm) > half_y)
    if outside.any():
        n = int(np.flatnonzero(outside)[0])
        raise T2TwinError(
            f"the layout {layout.name} has {int(outside.sum())} taxel(s) off the cover, such as "
            f"taxel {n} at x {layout.x_mm[n]:g} mm, y {layout.y_mm[n]:g} mm; it reaches {half_x:g} "
            f"mm in x and {half_y:g} mm in y from its center"
        )


def reach_mm(cover: Elastomer, pitch_mm: float) -> tuple[float, float]:
    """Distance of the outermost cells' centers of a contact's grid from the cover's center along x
    and y, mm; of the cover's edges for a pitch of 0."""
    halves = cover.width_mm / 2, cover.length_mm / 2
    if pitch_mm == 0.0:
        return halves
    x_mm, y_mm = (int(half / pitch_mm + 1e-9) * pitch_mm - pitch_mm / 2 for half in halves)
    return x_mm, y_mm


@lru_cache(maxsize=8)
def _places(grid: DenseGrid) -> Layout:
    """The places of a grid on its cover."""
    spacing, cover = grid.table.spacing_mm, grid.cover
    is_triangular = grid.table.grid == "triangular"
    across = (spacing * np.sqrt(0.75), spacing / 2) if is_triangular else (spacing, 0.0)
    steps_mm = np.array([across, (0.0, spacing)])
    reach_x, reach_y = reach_mm(cover, grid.pitch_mm)
    most = int(np.ceil((cover.width_mm + 2 * cover.length_mm) / spacing))
    steps = np.arange(-most, most + 1)
    i, j = (each.ravel() for each in np.meshgrid(steps, steps, indexing="ij"))
    x, y = np.array(grid.taxels_mm[0])[:, None] + steps_mm.T @ np.stack([i, j])
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
    distance, nearest = _nearest_of(x, y, np.array(grid.taxels_mm))
    for place, taxel in zip(nearest[distance < SAME_MM], np.flatnonzero(distance < SAME_MM),
                            strict=True):  # fmt: skip
        x[place], y[place] = grid.taxels_mm[taxel]
    return Layout("dense", x, y, np.full(count, grid.pad_diameter_mm))


@lru_cache(maxsize=8)
def _nearest(grid: DenseGrid, x_mm: tuple[float, ...], y_mm: tuple[float, ...]) -> np.ndarray:
    """(rows * columns,) the place nearest to each cell of a contact's grid."""
    places = grid.layout
    cells = np.stack(np.meshgrid(x_mm, y_mm), axis=-1).reshape(-1, 2)
    return _nearest_of(places.x_mm, places.y_mm, cells)[1]


def _nearest_of(
    x_mm: np.ndarray, y_mm: np.ndarray, to_mm: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Distance to the nearest of the places (x, y) from each point, mm, and its index."""
    from scipy.spatial import KDTree  # slow to import, and not needed for counts

    distance, index = KDTree(np.column_stack([x_mm, y_mm])).query(to_mm)
    return np.asarray(distance), np.asarray(index)


@lru_cache(maxsize=8)
def _inverse(
    x_mm: tuple[float, ...], y_mm: tuple[float, ...], pad_mm: float, cover: Elastomer
) -> np.ndarray:
    """Inverse of the covariance of the places of the dense counts, (F, F)."""
    places = Layout("dense", np.array(x_mm), np.array(y_mm), np.full(len(x_mm), pad_mm))
    covariance = _covariance(places.distances_mm(places), pad_mm, pad_mm, cover)
    return np.linalg.inv(covariance + NOISE_SHARE * covariance[0, 0] * np.eye(places.size))
