"""The baked model: the background, the noise, the shadows, and how near it is to the reference."""

from dataclasses import replace

import numpy as np
import pytest
from kinds import gel_camera
from skimage.metrics import structural_similarity

from maintenance.bake_optics import block, ring
from t2twin.core.errors import T2TwinError
from t2twin.sim.optical import shadows
from t2twin.sim.optical.camera import optical_grid
from t2twin.sim.optical.optics import Optics
from t2twin.sim.optical.pyrender_renderer import ReferenceRenderer
from t2twin.sim.optical.surface import ball_surface

DIGIT = gel_camera()
GEL, CAMERA, LIGHT = DIGIT.own_gel, DIGIT.camera, DIGIT.spec.light
ROWS, COLUMNS = CAMERA.rows, CAMERA.columns
LEDS = DIGIT.spec.light.leds
X_MM, Y_MM = np.meshgrid(*optical_grid(GEL))
FLAT = np.zeros(X_MM.shape)
HALF_CROP = 50


@pytest.fixture(scope="module")
def renderer():
    return DIGIT.image_renderer


@pytest.fixture(scope="module")
def reference():
    with ReferenceRenderer(LEDS, LIGHT.ambient, CAMERA, GEL, led_points=5) as renderer:
        yield renderer


def crop(picture, x_mm, y_mm):
    row, column = (int(v[0]) for v in CAMERA.project(*(np.array([v]) for v in (x_mm, y_mm, 0.0))))
    row = min(max(row, HALF_CROP), ROWS - HALF_CROP)
    column = min(max(column, HALF_CROP), COLUMNS - HALF_CROP)
    return picture[
        row - HALF_CROP : row + HALF_CROP, column - HALF_CROP : column + HALF_CROP
    ].astype(float)


def psnr(a, b):
    return 10 * np.log10(255**2 / np.mean((a - b) ** 2))


def test_an_untouched_gel_gives_the_background(renderer):
    picture = renderer.render(FLAT)
    assert picture.dtype == np.uint8
    assert picture.shape == (ROWS, COLUMNS, 3)
    np.testing.assert_array_equal(picture, renderer.background)


def test_far_from_a_press_the_picture_is_the_background(renderer):
    picture = renderer.render(ball_surface(GEL, -3.5, -5.0, 0.6)).astype(int)
    assert np.abs(picture[200:] - renderer.background[200:]).max() <= 1
    assert np.abs(picture[:200] - renderer.background[:200]).max() > 40


def test_the_shipped_background_is_the_reference(renderer, reference):
    picture = reference.render(FLAT).astype(float)
    assert psnr(picture, renderer.background.astype(float)) > 45


@pytest.mark.parametrize(
    "surface, place",
    [
        (ball_surface(GEL, 1.0, -1.4, 1.2), (1.0, -1.4)),
        (block(GEL, -1.5, 2.0, 0.6, 6.0, 3.0, 0.5), (-1.5, 2.0)),
        (ring(GEL, 0.5, 1.0, 0.7, 2.2, 3.0), (0.5, 1.0)),
    ],
    ids=["ball", "block", "ring"],
)
def test_the_baked_picture_is_the_reference(renderer, reference, surface, place):
    wanted = crop(reference.render(surface), *place)
    given = crop(renderer.render(surface), *place)
    nothing = crop(renderer.background, *place)
    assert psnr(wanted, given) > 32
    assert psnr(wanted, given) > psnr(wanted, nothing) + 12
    similarity = structural_similarity(wanted, given, channel_axis=2, data_range=255)
    assert float(np.mean(similarity)) > 0.95


def test_a_wall_hides_half_the_led_where_similar_triangles_say():
    pitch, height, wall = np.float32(0.1), 1.0, 60  # mm, mm, column
    start = np.float32(0.0)
    heights = np.zeros((21, 200), dtype=np.float32)
    heights[:, wall - 10 : wall + 1] = -height
    led = np.array([[-15.0, 1.0, -4.0]], dtype=np.float32)  # in line with row 10, left of the wall
    sight, shadowed = np.ones((1, *heights.shape), dtype=np.float32), np.empty((1, 4), np.int64)
    shadows.led_visibility(
        heights, start, start, pitch, (0, 21, wall - 11, wall + 2), (0, 21, 0, 200), led,
        np.array([0.5]), sight, shadowed,
    )  # fmt: skip
    shadow = sight[0, 10, wall + 2 :]
    far = (wall + 2 + np.argmax(shadow > 0.5)) * pitch  # first cell that sees half the disc
    edge = wall * pitch
    expected = edge + (edge + 15.0) * height / (4.0 - height)
    assert far == pytest.approx(expected, abs=0.6)  # the rays' step there
    assert (np.diff(shadow) >= -0.02).all()
    assert shadow[0] == 0.0
    assert (sight[0, :, : wall - 11] == 1.0).all()
    dark = np.argwhere(sight[0] < 1.0)
    (top, left), (bottom, right) = dark.min(axis=0), dark.max(axis=0)
    assert list(shadowed[0]) == [top, bottom + 1, left, right + 1]


def test_noise_has_the_stated_deviation_and_comes_from_the_generator(renderer):
    first = renderer.render(FLAT, np.random.default_rng(4), noise_grey=3.0)
    again = renderer.render(FLAT, np.random.default_rng(4), noise_grey=3.0)
    other = renderer.render(FLAT, np.random.default_rng(5), noise_grey=3.0)
    np.testing.assert_array_equal(first, again)
    assert (first != other).mean() > 0.5
    noise = first.astype(float) - renderer.background
    assert noise.mean() == pytest.approx(0.0, abs=0.03)
    assert noise.std() == pytest.approx(np.hypot(3.0, np.sqrt(1 / 12)), rel=0.02)
    neighbors = np.corrcoef(noise[:, :-1].ravel(), noise[:, 1:].ravel())[0, 1]
    assert abs(neighbors) < 0.01


def test_bad_input_is_refused(renderer, tmp_path):
    with pytest.raises(T2TwinError, match="must be"):
        renderer.render(np.zeros((5, 5)))
    holed = FLAT.copy()
    holed[3, 3] = np.nan
    with pytest.raises(T2TwinError, match="finite"):
        renderer.render(holed)
    with pytest.raises(T2TwinError, match="between 0 and 255"):
        renderer.render(FLAT, np.random.default_rng(0), noise_grey=-1.0)
    (tmp_path / "text.npz").write_text("no optics")
    for name in ("text.npz", "absent.npz"):
        with pytest.raises(T2TwinError, match="calibrat"):
            Optics.load(tmp_path / name)
    wrong = {"response": np.zeros((3, 2)), "leds_mm": np.full((3, 3), np.nan), "gamma": 9.0}
    for name, value in wrong.items():
        with pytest.raises(T2TwinError, match="the optics file's"):
            replace(DIGIT.optics, **{name: value})
