"""Contact maps of gel cameras: depth and pressure in the cells of the image."""

import numpy as np
import pytest
from kinds import gel_camera
from msgspec import structs

from t2twin.sim.optical.gel_camera import ImageReading, depth_on, pressure_on
from t2twin.twin import Twin

RADIUS_MM = 5.5
"""Of hemisphere-4."""


@pytest.fixture(scope="module")
def pressed() -> ImageReading:
    """A ball beside the middle of the default gel camera."""
    return Twin().press("hemisphere-4", x_mm=1.5, y_mm=-2.0, force_n=5.0).of_camera


UNITS = {"default": {}, "shifted and tilted": {
    "scale_px_per_mm": 17.5, "shift_x_px": 8.0, "shift_y_px": -6.0, "tilt_x_deg": 1.2,
}}  # fmt: skip
"""What differs between a unit's camera and that of the sensor's file."""


@pytest.mark.parametrize("name", UNITS)
def test_the_depth_under_a_ball_is_that_of_the_sphere_on_each_pixels_ray(pressed, name) -> None:
    sensor, contact = pressed.sensor, pressed.contact
    camera, grid, gel = (
        structs.replace(sensor.camera, **UNITS[name]),
        sensor.contact_grid,
        sensor.elastomer,
    )
    depth_mm, pressure_kpa = (
        depth_on(grid, contact, camera), pressure_on(grid, 1.0, contact, camera),
    )  # fmt: skip
    rows, columns = np.nonzero(pressure_kpa > 0.4 * pressure_kpa.max())  # not at the rim
    assert rows.size > 50
    row_px = (rows + 0.5) * camera.rows / grid[0] - 0.5
    column_px = (columns + 0.5) * camera.columns / grid[1] - 0.5
    across = (column_px - camera.middle[1]) / camera.focal_px
    down = (row_px - camera.middle[0]) / camera.focal_px

    def sphere_mm(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x, y = across * (camera.distance_mm + z), down * (camera.distance_mm + z)
        squares = RADIUS_MM**2 - (x - 1.5) ** 2 - (y + 2.0) ** 2
        under = RADIUS_MM - np.sqrt(squares) - contact.shape_depth_mm
        return under + camera.tilt_mm(x, y), gel.rest_surface_mm(x, y) - under

    low, high = np.full(rows.size, -3.0), np.full(rows.size, 3.0)
    for _ in range(60):  # bisection along the ray
        middle = (low + high) / 2
        is_below = middle < sphere_mm(middle)[0]
        low, high = np.where(is_below, middle, low), np.where(is_below, high, middle)
    np.testing.assert_allclose(depth_mm[rows, columns], sphere_mm(low)[1], atol=4e-3)


@pytest.mark.parametrize("name", UNITS)
def test_the_pressures_add_up_to_the_force_about_its_place(pressed, name) -> None:
    sensor, contact = pressed.sensor, pressed.contact
    camera, grid = structs.replace(sensor.camera, **UNITS[name]), sensor.contact_grid
    pressure_kpa = pressure_on(grid, 0.5, contact, camera)
    assert 1e-3 * 0.5 * pressure_kpa.sum() == pytest.approx(contact.force_n, rel=1e-4)
    share = pressure_kpa / pressure_kpa.sum()
    row = share.sum(axis=1) @ ((np.arange(grid[0]) + 0.5) * camera.rows / grid[0] - 0.5)
    column = share.sum(axis=0) @ ((np.arange(grid[1]) + 0.5) * camera.columns / grid[1] - 0.5)
    own = contact.pressure_kpa / contact.pressure_kpa.sum()
    x, y = np.array(own.sum(axis=0) @ contact.x_mm), np.array(own.sum(axis=1) @ contact.y_mm)
    z = sensor.elastomer.rest_surface_mm(x, y) + camera.tilt_mm(x, y) - contact.depth_mm
    np.testing.assert_allclose([row, column], camera.project(x, y, z), atol=0.5)  # pixels


@pytest.mark.parametrize("name", ["digit", "gelsight-mini"])
def test_the_grid_is_of_each_camera(name) -> None:
    sensor = gel_camera(name)
    grid, (half_width, half_height) = sensor.contact_grid, sensor.camera.seen_half_extent_mm()
    assert 0.9 < (half_width / grid[1]) / (half_height / grid[0]) < 1.1
    at_rest = sensor.read(None)
    assert not at_rest.depth_map_mm.any() and at_rest.pressure_map_kpa.shape == grid
