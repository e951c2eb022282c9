"""The baked model: the background, noise, shadows, LEDs, and how near it is to the reference."""

from dataclasses import replace

import numpy as np
import pytest
from kinds import gel_camera, psnr
from msgspec import structs
from scipy import stats
from skimage.metrics import structural_similarity

from maintenance.bake_optics import block, ring
from t2twin.core.errors import T2TwinError
from t2twin.sim.calibrate.frames import crop, measure_noise
from t2twin.sim.optical.camera import optical_grid
from t2twin.sim.optical.illumination import led_visibility
from t2twin.sim.optical.image_renderer import ImageRenderer, optics_of_leds
from t2twin.sim.optical.optics import Optics
from t2twin.sim.optical.pyrender_renderer import ReferenceRenderer
from t2twin.sim.optical.response import Noise, quantiles, standard_normal
from t2twin.sim.optical.surface import ball_surface

DIGIT, MINI = gel_camera(), gel_camera("gelsight-mini")
GEL, CAMERA, LIGHT = DIGIT.own_gel, DIGIT.camera, DIGIT.spec.light
ROWS, COLUMNS = CAMERA.rows, CAMERA.columns
NOISE_GREY = DIGIT.spec.camera.noise_grey
FLAT = np.zeros([axis.size for axis in reversed(optical_grid(GEL))])

TAPS = np.array([0.2, 0.5, 0.7, 0.5, 0.2])
MIX = np.array([[2.6, 0.0, 0.0], [-0.7, 1.4, 0.0], [0.2, -1.3, 2.7]])
NOISE = Noise(MIX, TAPS / np.linalg.norm(TAPS))


@pytest.fixture(scope="module")
def renderer():
    return DIGIT.image_renderer


@pytest.fixture(scope="module")
def reference():
    with ReferenceRenderer(LIGHT.leds, LIGHT.ambient, CAMERA, GEL, led_points=5) as renderer:
        yield renderer


def test_an_untouched_gel_gives_the_background(renderer):
    picture = renderer.render(FLAT)
    assert (picture.dtype, picture.shape) == (np.uint8, (ROWS, COLUMNS, 3))
    np.testing.assert_array_equal(picture, renderer.background)


def test_far_from_a_press_the_picture_is_the_background(renderer):
    picture = renderer.render(ball_surface(GEL, -3.5, -5.0, 0.6)).astype(int)
    assert np.abs(picture[200:] - renderer.background[200:]).max() <= 1
    assert np.abs(picture[:200] - renderer.background[:200]).max() > 40


def test_the_shipped_background_is_the_reference(renderer, reference):
    assert psnr(reference.render(FLAT), renderer.background) > 45


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
    middle = np.array(CAMERA.project(*(np.array(v) for v in (*place, 0.0))))
    wanted, given, nothing = (
        crop(each, middle).astype(float)
        for each in (reference.render(surface), renderer.render(surface), renderer.background)
    )
    assert psnr(wanted, given) > max(32, psnr(wanted, nothing) + 12)
    similarity = structural_similarity(wanted, given, channel_axis=2, data_range=255)
    assert float(np.mean(similarity)) > 0.95


def test_a_wall_hides_half_the_led_where_similar_triangles_say():
    pitch, height, wall = np.float32(0.1), 1.0, 60  # mm, mm, column
    start = np.float32(0.0)
    heights = np.zeros((21, 200), dtype=np.float32)
    heights[:, wall - 10 : wall + 1] = -height
    led = np.array([[-15.0, 1.0, -4.0]], dtype=np.float32)  # in line with row 10, left of the wall
    sight, shadowed = np.ones((1, *heights.shape), dtype=np.float32), np.zeros((1, 4), np.int64)
    led_visibility(
        heights, start, start, pitch, (0, 21, wall - 11, wall + 2), (0, 21, 0, 200), led,
        np.array([0.5]), np.empty((3, 200), np.float32), sight, shadowed,
    )  # fmt: skip
    shadow = sight[0, 10, wall + 2 :]
    far = (wall + 2 + np.argmax(shadow > 0.5)) * pitch  # first cell that sees half the disc
    edge = wall * pitch
    expected = edge + (edge + 15.0) * height / (4.0 - height)
    assert far == pytest.approx(expected, abs=0.6)  # the rays' step there
    assert (np.diff(shadow) >= -0.02).all() and shadow[0] == 0.0
    assert (sight[0, :, : wall - 11] == 1.0).all()
    dark = np.argwhere(sight[0] < 1.0)
    (top, left), (bottom, right) = dark.min(axis=0), dark.max(axis=0)
    assert list(shadowed[0]) == [top, bottom + 1, left, right + 1]


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


# Noise: sampled as measured, kept in the optics file, white where it is not measured


def alike(noise, rows, columns):
    """The correlation of pixels so far apart, of all colors together."""
    pairs = noise[rows:, columns:], noise[: ROWS - rows, : COLUMNS - columns]
    return float(np.mean(pairs[0] * pairs[1]) / np.mean(noise**2))


@pytest.fixture(scope="module")
def white():
    return standard_normal(np.random.default_rng(0), (ROWS, 3 * COLUMNS))


def test_white_noise_is_normal(white):
    several = [
        standard_normal(np.random.default_rng(seed), (ROWS, 3 * COLUMNS)) for seed in range(8)
    ]
    assert np.mean(several) == pytest.approx(0.0, abs=0.003)
    assert np.std(several) == pytest.approx(1.0, abs=0.003)
    assert standard_normal(np.random.default_rng(0), (3, 5)).shape == (3, 5)
    shares = stats.norm.cdf(white)
    assert stats.kstest(shares.ravel(), "uniform").pvalue > 0.001
    assert np.abs(quantiles()).max() > 3.5


def test_white_noise_has_no_pattern(white):
    few = 4.5 / np.sqrt(white.size)  # of as many independent numbers, once in 100,000
    for rows, columns in ((0, 1), (0, 3), (0, 360), (1, 0), (1, 1), (2, 3), (7, 0)):
        one, other = white[rows:, columns:], white[: ROWS - rows, : 3 * COLUMNS - columns]
        for power in (1, 2):
            assert abs(np.corrcoef((one**power).ravel(), (other**power).ravel())[0, 1]) < 1.5 * few
    power = np.abs(np.fft.fft2(white)) ** 2 / white.size
    assert power.max() < np.log(white.size) + 8


def test_white_noise_has_the_stated_deviation_and_comes_from_the_generator(renderer):
    first, again, other = (
        renderer.render(FLAT, np.random.default_rng(seed), noise_grey=3.0) for seed in (4, 4, 5)
    )
    np.testing.assert_array_equal(first, again)
    assert (first != other).mean() > 0.5
    noise = first.astype(float) - renderer.background
    assert noise.mean() == pytest.approx(0.0, abs=0.03)
    assert noise.std() == pytest.approx(np.hypot(3.0, np.sqrt(1 / 12)), rel=0.02)
    assert abs(alike(noise, 0, 1)) < 0.01


def test_noise_has_its_covariance_and_autocorrelation():
    noise = NOISE.sample(np.random.default_rng(0), ROWS, COLUMNS)
    covariance = np.cov(noise.reshape(-1, 3).T)
    np.testing.assert_allclose(covariance, MIX @ MIX.T, atol=0.25)
    assert NOISE.grey == pytest.approx(np.sqrt(np.trace(covariance) / 3), rel=0.03)
    own = np.correlate(NOISE.taps, NOISE.taps, "full")[4:]
    for lag in range(1, 5):
        assert alike(noise, lag, 0) == pytest.approx(own[lag], abs=0.04)
        assert alike(noise, 0, lag) == pytest.approx(own[lag], abs=0.04)
    assert alike(noise, 1, 1) == pytest.approx(own[1] ** 2, abs=0.04)
    assert np.abs(noise.mean(axis=(0, 1))).max() < 0.1
    assert noise[:3].std() / noise.std() == pytest.approx(1.0, abs=0.1)


def test_sampled_noise_is_measured_again():
    rng = np.random.default_rng(0)
    still = np.full((ROWS, COLUMNS, 3), 90.0)
    frames = [np.rint(still + NOISE.sample(rng, ROWS, COLUMNS)) for _ in range(6)]
    found = measure_noise(still, np.array(frames).astype(np.uint8), frames[0].astype(np.uint8))
    assert found is not None
    # slow variation is removed as drift, and with it a part of noise as smooth as this
    assert found.grey == pytest.approx(NOISE.grey, rel=0.05)
    np.testing.assert_allclose(found.mix @ found.mix.T, MIX @ MIX.T, atol=0.6)
    again, truth = (np.correlate(of.taps, of.taps, "full") for of in (found, NOISE))
    np.testing.assert_allclose(again, truth, atol=0.07)


def test_images_have_the_measured_noise_and_averages_less_of_it(renderer):
    noisy = ImageRenderer(replace(DIGIT.optics, noise=NOISE), GEL, NOISE_GREY)
    one, mean = (
        noisy.render(FLAT, np.random.default_rng(1), grey) - noisy.background.astype(float)
        for grey in (None, NOISE_GREY / 2)
    )
    assert one.std() == pytest.approx(NOISE.grey, rel=0.05)
    assert mean.std() == pytest.approx(NOISE.grey / 2, rel=0.08)
    assert alike(one, 0, 1) > 0.6


def test_the_file_keeps_the_noise(tmp_path):
    path = tmp_path / "unit.npz"
    replace(DIGIT.optics, noise=NOISE).save(path)
    kept = Optics.load(path).noise
    assert kept is not None
    np.testing.assert_array_equal(kept.mix, NOISE.mix)
    np.testing.assert_array_equal(kept.taps, NOISE.taps)
    DIGIT.optics.save(path)
    with np.load(path) as file:
        parts = dict(file)
    assert "noise_mix" not in parts
    for more, message in (
        ({"noise_mix": MIX}, "noise_taps is not a file"),
        ({"young_kpa": 500.0}, "its young_kpa is not read"),
        ({"noise_mix": MIX, "noise_taps": TAPS * 9}, "taps must lie between"),
    ):
        np.savez(path, **{**parts, **more})  # pyright: ignore[reportArgumentType]
        with pytest.raises(T2TwinError, match=message):
            Optics.load(path)


# Light of LEDs that a sensor's file describes


@pytest.mark.parametrize(
    "name, least_db",
    [("digit", 36), pytest.param("gelsight-mini", 32, marks=pytest.mark.exhaustive)],
)
def test_an_image_in_the_light_of_leds_is_the_reference(name, least_db):
    sensor = gel_camera(name)
    light, camera, gel = sensor.spec.light, sensor.camera, sensor.own_gel
    optics = optics_of_leds(light.leds, light.ambient, light.gamma, camera, gel)
    renderer, ball = ImageRenderer(optics, gel, 0.0), ball_surface(gel, 0.5, -1.0, 1.1)
    with ReferenceRenderer(light.leds, light.ambient, camera, gel, led_points=3) as reference:
        still, pressed = reference.render(0.0 * ball), reference.render(ball)
    assert psnr(still, renderer.background) > least_db
    assert psnr(pressed, renderer.render(ball)) > least_db
    one = (pressed.astype(float) - still).ravel()
    other = (renderer.render(ball) - renderer.background.astype(float)).ravel()
    assert np.corrcoef(one, other)[0, 1] > 0.97


def led_of(color, beam_deg=(86.0, 90.0)):
    """An LED at the right."""
    first = MINI.spec.light.leds[0]
    return first.__class__(color, 0.0, 22.0, -8.0, 1.0, (0.0, 0.0, 0.0), beam_deg)


def test_the_light_follows_the_beam_and_the_distance():
    """Without a beam, Lambert's law at a flat gel: cosine over squared distance."""
    camera, gel = MINI.camera, MINI.own_gel
    optics = optics_of_leds((led_of((1.0, 1.0, 1.0)),), (0.0, 0.0, 0.0), 1.0, camera, gel)
    x, y, z = (v[120] for v in camera.gel_points(gel, np.arange(320.0), np.arange(240.0)))
    far = np.sqrt((22.0 - x) ** 2 + y**2 + (z + 8.0) ** 2)
    slope = -x / np.sqrt(gel.dome_width_radius_mm**2 - x**2)
    cosine = (8.0 + z + slope * (22.0 - x)) / np.hypot(1.0, slope) / far
    expected = 255 * cosine * (22.0 / far) ** 2
    assert np.abs(optics.background[120, :, 0] - expected)[5:-5].max() < 2


# pyrender's reference: light, color, shadow and symmetry


PURE = tuple(
    structs.replace(led, color=color)
    for led, color in zip(LIGHT.leds, np.eye(3).tolist(), strict=True)
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
    pressed = (
        GEL.rest_surface_mm(*np.meshgrid(*optical_grid(GEL))) + 2.5
    )  # a plane 2.5 mm into the sensor
    picture = render(pressed)
    for axis in (0, 1):
        assert np.abs(np.diff(picture, n=2, axis=axis)).max() <= 3


def test_a_closed_renderer_leaves_others_usable(ball, ball_picture):
    with ReferenceRenderer(PURE, GREY_AMBIENT, CAMERA, GEL, led_points=1) as renderer:
        render(FLAT)
        np.testing.assert_array_equal(renderer.render(ball), ball_picture)
        render(FLAT)


def test_the_baked_model_takes_a_gel_without_a_dome():
    flat = {"dome_width_radius_mm": np.inf, "dome_length_radius_mm": np.inf, "dome_flat_mm": 0.0}
    flat_gel = replace(GEL, **flat)
    own = ImageRenderer(DIGIT.optics, GEL, 0.0, flat_gel)
    domed = DIGIT.image_renderer
    pressed = ball_surface(GEL, 0.5, -0.5, 0.8)
    middle = (slice(100, 200), slice(80, 180))
    with ReferenceRenderer(LIGHT.leds, LIGHT.ambient, CAMERA, flat_gel, led_points=3) as renderer:
        pictures = [renderer.render(surface) for surface in (FLAT, pressed)]

    def check(wanted, given, domed_image, least_db, most_domed_db):
        """The model with the flat gel is near the reference, that with the dome is not."""
        assert psnr(wanted[middle], given[middle]) > least_db
        assert psnr(wanted[middle], domed_image[middle]) < most_domed_db

    check(pictures[0], own.background, domed.background, 38, 32)
    check(pictures[1], own.render(pressed), domed.render(pressed), 34, 30)
    np.testing.assert_array_equal(own.render(FLAT), own.background)
