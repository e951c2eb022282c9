"""Markers on the DIGIT's gel: their places, how images show them, and where they are recorded."""

import json
import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from msgspec import structs

from t2twin import Markers, Twin
from t2twin.cli import main
from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.types import SurfaceShift
from t2twin.sim.optical import pyrender_renderer, response
from t2twin.sim.optical.camera import optical_grid
from t2twin.sim.optical.image_renderer import ImageRenderer
from t2twin.sim.optical.markers import INK_REFLECTANCE, moved
from t2twin.sim.sensors.files import load_sensor

DIGIT: Any = load_sensor("digit")
GEL, CAMERA = DIGIT.own_gel, DIGIT.camera
ROWS, COLUMNS = CAMERA.rows, CAMERA.columns
X_MM, Y_MM = optical_grid(GEL)
FLAT = np.zeros((Y_MM.size, X_MM.size), dtype=np.float32)
FLAT_GEL = replace(GEL, dome_width_radius_mm=np.inf, dome_length_radius_mm=np.inf, dome_flat_mm=0.0)
GAMMA = 2.2
HALF = 10  # half the side of a window around a marker, px
MARKERS = Markers().printed(CAMERA)
AT_REST = CAMERA, FLAT_GEL, FLAT, GAMMA


def uniform(x_mm: float, y_mm: float) -> SurfaceShift:
    """A shift of the whole surface."""
    values = np.zeros((2, Y_MM.size, X_MM.size))
    values[0], values[1] = x_mm, y_mm
    return SurfaceShift(X_MM, Y_MM, values)


def covered(shade: np.ndarray) -> np.ndarray:
    """The part of each pixel that markers cover, from the factors of the grey levels."""
    return (1.0 - shade.astype(float) ** GAMMA) / (1.0 - INK_REFLECTANCE)


def spots(dark: np.ndarray, centers_px: np.ndarray):
    """Sums and centroids, px, of the darkness around markers (n, 2) inside the image, and which
    these are."""
    first = np.rint(centers_px).astype(int) - HALF
    size = 2 * HALF + 1
    inside = ((first >= 0) & (first + size <= (ROWS, COLUMNS))).all(axis=1)
    sums, centroids = [], []
    for row, column in first[inside]:
        part = dark[row : row + size, column : column + size]
        rows, columns = np.indices(part.shape)
        sums.append(part.sum())
        centroids.append(
            (row + (part * rows).sum() / sums[-1], column + (part * columns).sum() / sums[-1])
        )
    return np.array(sums), np.array(centroids), inside


def seen(places_mm: np.ndarray, gel=GEL) -> np.ndarray:
    """(n, 2) rows and columns of points of the gel at rest."""
    x, y = places_mm.T
    return np.stack(CAMERA.project(x, y, gel.rest_surface_mm(x, y)), axis=-1)


@pytest.fixture(scope="module")
def plain():
    return ImageRenderer(DIGIT.optics, GEL, 0.0)


@pytest.fixture(scope="module")
def marked():
    return ImageRenderer(DIGIT.optics, GEL, 0.0, markers=MARKERS)


def test_markers_at_rest_lie_on_the_pitch_grid_and_cover_the_image():
    markers = Markers(pitch_mm=1.1).printed(CAMERA)
    steps = markers.rest_mm / 1.1
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-9)
    assert len(np.unique(np.rint(steps), axis=0)) == len(steps)
    half = np.array(CAMERA.seen_half_extent_mm())
    assert (markers.rest_mm.max(axis=0) > half).all()
    assert (markers.rest_mm.min(axis=0) < -half).all()


def test_the_record_is_a_value():
    one = Markers(2.0, 0.4, 0.1, 3)
    with pytest.raises(T2TwinError, match="the markers are on no sensor"):
        _ = one.rest_mm
    printed = one.printed(CAMERA)
    assert printed.rest_mm.size  # cached values do not change the record
    assert pickle.loads(pickle.dumps(printed)) == printed == one.printed(CAMERA)
    marked = DIGIT.with_options({"markers": one})
    assert pickle.loads(pickle.dumps(marked)) == marked != DIGIT


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"pitch_mm": 0.1}, "pitch_mm is 0.1; expected a number from 0.5 to 8"),
        ({"diameter_mm": 1.5}, "diameter_mm is 1.5; expected a number from 0.05 to 1.4"),
        ({"jitter_mm": 0.5}, "jitter_mm is 0.5; expected a number from 0 to 0.45"),
        ({"seed": -1}, "seed is -1; expected a whole number"),
    ],
)
def test_invalid_patterns_are_refused(given, message):
    with pytest.raises(T2TwinError, match=message):
        Markers(**given)


def test_each_marker_has_its_area_wherever_it_lies_between_pixels():
    area = np.pi * (MARKERS.diameter_mm / 2 * CAMERA.scale_px_per_mm) ** 2
    for shift in np.random.default_rng(0).uniform(-0.1, 0.1, (20, 2)):
        dark = covered(MARKERS.shade(*AT_REST, FLAT, uniform(*shift)))
        sums, _, _ = spots(dark, seen(MARKERS.rest_mm + shift, FLAT_GEL))
        assert sums.size > 60
        np.testing.assert_allclose(sums, area, rtol=2e-3)


def test_stretch_and_shear_make_ellipses_of_their_area_and_axes():
    gradient = np.array([[0.3, 0.4], [-0.1, -0.2]])  # du/dX
    values = np.einsum("ij,jyx->iyx", gradient, np.stack(np.meshgrid(X_MM, Y_MM)))
    dark = covered(MARKERS.shade(*AT_REST, FLAT, SurfaceShift(X_MM, Y_MM, values)))
    radius_px = MARKERS.diameter_mm / 2 * CAMERA.scale_px_per_mm
    deformation = np.eye(2) + gradient
    middle = dark[ROWS // 2 - HALF : ROWS // 2 + HALF, COLUMNS // 2 - HALF : COLUMNS // 2 + HALF]
    rows, columns = np.indices(middle.shape) - (HALF - 0.5)
    area = np.pi * radius_px**2 * np.linalg.det(deformation)
    assert middle.sum() == pytest.approx(area, rel=5e-3)
    places = np.stack([columns, rows])
    moments = np.einsum("iyx,jyx,yx->ij", places, places, middle) / middle.sum()
    # of an ellipse that is the image of a disc; each pixel adds 1/12 along both axes
    expected = radius_px**2 / 4 * deformation @ deformation.T + np.eye(2) / 12
    np.testing.assert_allclose(moments, expected, rtol=0.02)


def test_a_shift_of_the_surface_moves_the_markers_in_the_image_by_it(plain, marked):
    full = response.linear(plain.background, GAMMA).sum(axis=2)
    for x_mm, y_mm in ((0.0, 0.0), (0.37, 0.0), (-0.21, 0.53)):
        image = marked.render(FLAT, shift=uniform(x_mm, y_mm))
        places = moved(MARKERS.rest_mm, uniform(x_mm, y_mm))
        moves = places - MARKERS.rest_mm
        np.testing.assert_allclose(moves, [[x_mm, y_mm]] * len(places), atol=1e-6)
        expected, light = seen(places), response.linear(image, GAMMA).sum(axis=2)
        _, found, inside = spots(1.0 - light / full, expected)
        assert inside.sum() > 60
        np.testing.assert_allclose(found, expected[inside], atol=0.1)


def test_without_markers_images_keep_their_bytes(plain, marked):
    surface = 0.8 * np.exp(-(np.hypot(X_MM, Y_MM[:, None]) ** 2) / 4).astype(np.float32)
    bare, dotted = plain.render(surface), marked.render(surface)
    np.testing.assert_array_equal(plain.render(surface, shift=uniform(0.5, 0.5)), bare)
    np.testing.assert_array_equal(DIGIT.background_frame(), plain.background)
    changed = (dotted != bare).any(axis=2)
    assert 0.08 < changed.mean() < 0.15  # of the area: pi / 4 (0.5 / 1.4)^2 is 0.10
    assert (dotted[changed] <= bare[changed]).all()


def test_both_renderers_show_the_markers_at_the_same_places(shapes, monkeypatch):
    monkeypatch.setattr(pyrender_renderer, "LED_POINTS", 1)
    found, backgrounds = [], []
    for renderer in ("baked", "pyrender"):
        twins = Twin(renderer=renderer, markers=True), Twin(renderer=renderer)
        touches = [twin.press(shapes("hemisphere-4"), force_n=3.0, y_mm=1.0) for twin in twins]
        light, full = (response.linear(each.image, GAMMA).sum(axis=2) for each in touches)
        rest, moved = MARKERS.seen_px(CAMERA, touches[0].digit)
        np.testing.assert_allclose(rest, seen(MARKERS.rest_mm))
        _, centroids, inside = spots(1.0 - light / full, moved)
        np.testing.assert_allclose(centroids, moved[inside], atol=0.5)
        found.append(centroids)
        backgrounds.append(twins[0].background)
    assert len(found[0]) > 60
    np.testing.assert_allclose(found[0], found[1], atol=0.1)
    np.testing.assert_array_equal(*backgrounds)


def test_a_slide_drags_the_markers_along(shapes):
    twin = Twin(markers=Markers(pitch_mm=2.0))
    touch = twin.press(shapes("hemisphere-4"), force_n=3.0)
    press_mm, markers = touch.markers_mm, touch.markers
    assert markers is not None
    middle = np.hypot(*markers.rest_mm.T) == 0
    np.testing.assert_allclose(press_mm[middle], 0.0, atol=1e-3)
    assert 0.01 < np.abs(press_mm - markers.rest_mm).max() < 0.5
    moved = twin.slide(touch, dx_mm=0.2, steps=1)[0]
    change = moved.markers_mm - press_mm
    assert change[middle][0] == pytest.approx([0.2, 0.0], abs=0.01)  # it sticks to the shape
    far = np.abs(markers.rest_mm[:, 1]) > 7
    assert np.abs(change[far]).max() < 0.03
    lifted = twin.follow(shapes("hemisphere-4"), [(0, 0, 0, 3.0), (0, 0, 0, 0)])[-1]
    np.testing.assert_array_equal(lifted.markers_mm, markers.rest_mm)
    np.testing.assert_array_equal(lifted.image, twin.background)


def table(path):
    """The header and the values of a CSV file."""
    return path.read_text().splitlines()[0], np.loadtxt(path, delimiter=",", skiprows=1)


def test_press_and_slide_record_the_markers(shape_cache, tmp_path):
    given = ["hemisphere-4", "--force-n", "2", "--sensor", "digit", "--marker-pitch-mm", "2"]
    main(["press", *given, "--out", "press"])
    printed = Markers(2.0).printed(CAMERA)
    press = json.loads((tmp_path / "press" / "press.json").read_text())
    assert press["digit"]["markers"] == structs.asdict(printed)
    names, values = table(tmp_path / "press" / "markers.csv")
    assert names == "marker,rest_x_mm,rest_y_mm,x_mm,y_mm"
    np.testing.assert_allclose(values[:, 1:3], printed.rest_mm)
    main(["slide", *given, "--dx-mm", "0.2", "--steps", "2", "--out", "slide"])
    names, values = table(tmp_path / "slide" / "markers.csv")
    assert names == "step,marker,rest_x_mm,rest_y_mm,x_mm,y_mm"
    count = len(printed.rest_mm)
    np.testing.assert_array_equal(values[:, 0], np.repeat([0, 1, 2], count))
    first, last = values[:count], values[-count:]
    assert np.abs(last[:, 4:] - first[:, 4:]).max() == pytest.approx(0.2, abs=0.02)
