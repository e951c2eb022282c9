"""Contact maps: depth and normal pressure of a gel camera's contact, on a grid over its image.

The grid divides the image into equal cells. A cell's depth is the deflection of the gel where the
ray through the cell's middle meets the deformed gel. A cell's pressure is the force on the part of
the gel that it shows, over the area of a cell in the view of the sensor's file. So the sum of the
pressures times that area is the force in the view, for each unit, whatever its scale and place.
"""

from dataclasses import dataclass

import numpy as np

from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.types import Contact
from t2twin.sim.optical.camera.pinhole import PARALLAX_STEPS, Camera, optical_grid
from t2twin.sim.optical.surface import surface_on

CELL_MM = 0.26
"""Approximate side of a cell, mm (assumed: about the pitch of a contact's grid, and 5 pixels of a
DIGIT)."""


@dataclass(frozen=True)
class ContactGrid:
    """The grid of contact maps. rows, columns: of its cells. cell_mm2: area of one, mm^2."""

    rows: int
    columns: int
    cell_mm2: float

    def depth_mm(self, contact: Contact, camera: Camera) -> np.ndarray:
        """(rows, columns) depth of a contact, in the image of a unit's camera."""
        gel = contact.elastomer
        x_mm, y_mm = optical_grid(gel)
        surface = surface_on(contact, x_mm, y_mm)
        step = x_mm[1] - x_mm[0]
        pixels = self._middles(camera.columns, self.columns), self._middles(camera.rows, self.rows)
        across, down = np.meshgrid(
            (pixels[0] - camera.middle[1]) / camera.focal_px,
            (pixels[1] - camera.middle[0]) / camera.focal_px,
        )
        z, depth = np.zeros_like(across), np.zeros_like(across)
        for _ in range(PARALLAX_STEPS):
            reach = camera.distance_mm + z
            x, y = across * reach, down * reach
            depth = _bilinear(surface, (y - y_mm[0]) / step, (x - x_mm[0]) / step)
            z = _rest_mm(gel, camera, x, y) - depth
        return depth

    def pressure_kpa(self, contact: Contact, camera: Camera) -> np.ndarray:
        """(rows, columns) pressure of a contact, in the image of a unit's camera.

        The force of each cell of the contact's grid is shared by the four nearest cells of the
        image; what is outside the image is left out.
        """
        loaded = np.nonzero(contact.pressure_kpa)
        moved_mm = contact.sheared_mm[:, *loaded]
        x, y = contact.x_mm[loaded[1]], contact.y_mm[loaded[0]]
        depth = contact.surface_mm[loaded] + moved_mm[2]
        x, y = x + moved_mm[0], y + moved_mm[1]
        z = _rest_mm(contact.elastomer, camera, x, y) - depth
        row, column = camera.project(x, y, z)
        row = (row + 0.5) * self.rows / camera.rows - 0.5
        column = (column + 0.5) * self.columns / camera.columns - 0.5
        values = contact.pressure_kpa[loaded] * contact.pitch_mm**2 / self.cell_mm2
        found = np.zeros((self.rows + 2, self.columns + 2))  # with a rim outside the image
        above, left = np.floor(row).astype(int), np.floor(column).astype(int)
        down, across = row - above, column - left
        for i, along_y in ((above, 1.0 - down), (above + 1, down)):
            for j, along_x in ((left, 1.0 - across), (left + 1, across)):
                place = np.clip(i + 1, 0, self.rows + 1), np.clip(j + 1, 0, self.columns + 1)
                np.add.at(found, place, values * along_y * along_x)
        return found[1:-1, 1:-1]

    @staticmethod
    def _middles(pixels: int, cells: int) -> np.ndarray:
        """(cells,) coordinates of the cells' middles, px."""
        return (np.arange(cells) + 0.5) * pixels / cells - 0.5


def grid_over(camera: Camera) -> ContactGrid:
    """The grid over the view of a sensor's camera."""
    half_width_mm, half_height_mm = camera.seen_half_extent_mm()
    columns, rows = (max(1, round(2 * half / CELL_MM)) for half in (half_width_mm, half_height_mm))
    return ContactGrid(rows, columns, 4 * half_width_mm * half_height_mm / (rows * columns))


def _rest_mm(gel: Elastomer, camera: Camera, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
    """z of a unit's gel at rest."""
    return gel.rest_surface_mm(x_mm, y_mm) + camera.tilt_mm(x_mm, y_mm)


def _bilinear(values: np.ndarray, row: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Values between the points of a grid; beyond its rim those at the rim."""
    row = row.clip(0, values.shape[0] - 1)
    column = column.clip(0, values.shape[1] - 1)
    i = np.minimum(row.astype(int), values.shape[0] - 2)
    j = np.minimum(column.astype(int), values.shape[1] - 2)
    down, across = row - i, column - j
    upper = values[i, j] + across * (values[i, j + 1] - values[i, j])
    lower = values[i + 1, j] + across * (values[i + 1, j + 1] - values[i + 1, j])
    return upper + down * (lower - upper)
