"""Truths of the reference picture: light, color, shadow and symmetry."""

from dataclasses import replace

import numpy as np
import pytest
from kinds import gel_camera
from msgspec import structs

from t2twin.sim.optical.camera import optical_grid
from t2twin.sim.optical.image_renderer import ImageRenderer
from t2twin.sim.optical.pyrender_renderer import ReferenceRenderer
from t2twin.sim.optical.surface import ball_surface

DIGIT = gel_camera()
GEL, CAMERA, AMBIENT = DIGIT.own_gel, DIGIT.camera, DIGIT.spec.light.ambient
ROWS, COLUMNS = CAMERA.rows, CAMERA.columns
LEDS = DIGIT.spec.light.leds
X_MM, Y_MM = np.meshgrid(*optical_grid(GEL))
FLAT = np.zeros(X_MM.shape)
PURE = tuple(
    structs.replace(led, color=color) for led, color in zip(LEDS, np.eye(3).tolist(), strict=True)
)
GREY_AMBIENT = (0.03, 0.03, 0.03)


def render(surface_mm, leds=PURE, ambient=GREY_AMBIENT, shadows=True):
    with ReferenceRenderer(leds, ambient, CAMERA, GEL, shadows, led_points=1) as renderer:
        return renderer.render(surface_mm).astype(int)


@pytest.fixture(scope="module")
def ball():
    return ball_surface(GEL, 0.8, -0.6, 1.2)


@pytest.fixture(scope="module")
def ball_picture(ball):
    return render(ball)


def test_a_mirrored_press_under_mirrored_leds_gives_the_mirrored_picture(ball, ball_picture):
    mirrored = tuple(
        structs.replace(
            led, angle_deg=180.0 - led.angle_deg, aim_mm=(-led.aim_mm[0], *led.aim_mm[1:])
        )
        for led in PURE
    )
    picture = render(ball[:, ::-1], mirrored)
    difference = np.abs(picture[:, ::-1] - ball_picture)
    assert difference.mean() < 0.5
    assert np.percentile(difference, 99.5) <= 8  # hard shadow edges fall on other texels


def test_the_side_of_a_bulge_that_faces_an_led_is_the_bright_one(ball_picture):
    row, column = (int(v[0]) for v in CAMERA.project(*(np.array([v]) for v in (0.8, -0.6, -1.0))))
    for channel, led in enumerate(PURE):
        angle = np.radians(led.angle_deg)
        step = 20 * np.array([-np.sin(angle), np.cos(angle)])  # rows run down
        near = ball_picture[int(row + step[0]), int(column + step[1]), channel]
        far = ball_picture[int(row - step[0]), int(column - step[1]), channel]
        assert near > far + 60


def test_each_led_casts_its_shadow_on_the_far_side(ball, ball_picture):
    lost = render(ball, shadows=False) - ball_picture
    middle = np.array(
        [float(v[0]) for v in CAMERA.project(*(np.array([v]) for v in (0.8, -0.6, -0.5)))]
    )
    rows, columns = np.mgrid[:ROWS, :COLUMNS]
    for channel, led in enumerate(PURE):
        weight = np.clip(lost[..., channel] - 10, 0, None)
        assert weight.sum() > 0
        center = np.array([(rows * weight).sum(), (columns * weight).sum()]) / weight.sum()
        angle = np.radians(led.angle_deg)
        away = np.array([np.sin(angle), -np.cos(angle)])
        assert (center - middle) @ away > 15  # pixels


def test_a_gel_pressed_flat_everywhere_shows_no_edges():
    pressed = GEL.rest_surface_mm(X_MM, Y_MM) + 2.5  # a plane 2.5 mm into the sensor
    picture = render(pressed)
    for axis in (0, 1):
        assert np.abs(np.diff(picture, n=2, axis=axis)).max() <= 3


def test_a_closed_renderer_leaves_others_usable(ball, ball_picture):
    with ReferenceRenderer(PURE, GREY_AMBIENT, CAMERA, GEL, led_points=1) as renderer:
        render(FLAT)
        np.testing.assert_array_equal(renderer.render(ball), ball_picture)
        render(FLAT)


def test_the_baked_model_takes_a_gel_without_a_dome():
    flat_gel = replace(GEL, dome_width_radius_mm=np.inf, dome_length_radius_mm=np.inf)
    own = ImageRenderer(DIGIT.optics, GEL, 0.0, flat_gel)
    domed = DIGIT.image_renderer
    pressed = ball_surface(GEL, 0.5, -0.5, 0.8)
    middle = (slice(100, 200), slice(80, 180))
    with ReferenceRenderer(LEDS, AMBIENT, CAMERA, flat_gel, led_points=3) as renderer:
        pictures = [renderer.render(surface) for surface in (FLAT, pressed)]

    def psnr(wanted, given):
        return 10 * np.log10(255**2 / np.mean((wanted[middle].astype(float) - given[middle]) ** 2))

    assert psnr(pictures[0], own.background) > 38 > 32 > psnr(pictures[0], domed.background)
    assert (
        psnr(pictures[1], own.render(pressed)) > 34 > 30 > psnr(pictures[1], domed.render(pressed))
    )
    np.testing.assert_array_equal(own.render(FLAT), own.background)
