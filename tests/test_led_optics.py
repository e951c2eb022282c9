"""Light of LEDs that a sensor's file describes, compared with pyrender's reference."""

import numpy as np
import pytest
from kinds import gel_camera

from t2twin.core.errors import T2TwinError
from t2twin.sim.optical.image_renderer import ImageRenderer, optics_of_leds
from t2twin.sim.optical.pyrender_renderer import ReferenceRenderer
from t2twin.sim.optical.surface import ball_surface


def psnr(one, other):
    return 10 * np.log10(255**2 / np.mean((one.astype(float) - other) ** 2))


@pytest.mark.parametrize(
    "name, least_db",
    [("digit", 36), pytest.param("gelsight-mini", 32, marks=pytest.mark.exhaustive)],
)
def test_an_image_in_the_light_of_leds_is_the_reference(name, least_db):
    sensor = gel_camera(name)
    light, camera, gel = sensor.spec.light, sensor.camera, sensor.own_gel
    leds = sensor.spec.light.leds
    optics = optics_of_leds(leds, light.ambient, light.gamma, camera, gel)
    renderer, ball = ImageRenderer(optics, gel, 0.0), ball_surface(gel, 0.5, -1.0, 1.1)
    with ReferenceRenderer(leds, light.ambient, camera, gel, led_points=3) as reference:
        still, pressed = reference.render(0.0 * ball), reference.render(ball)
    assert psnr(still, renderer.background) > least_db
    assert psnr(pressed, renderer.render(ball)) > least_db
    changes = [
        pressed.astype(float) - still,
        renderer.render(ball) - renderer.background.astype(float),
    ]
    one, other = (change.ravel() for change in changes)
    assert np.corrcoef(one, other)[0, 1] > 0.97


def test_the_light_follows_the_beam_and_the_distance():
    """Without a beam, Lambert's law at a flat gel: cosine over squared distance."""
    sensor = gel_camera("gelsight-mini")
    camera, gel = sensor.camera, sensor.own_gel
    led = sensor.spec.light.leds[0]
    wide = led.__class__((1.0, 1.0, 1.0), 0.0, 22.0, -8.0, 1.0, (0.0, 0.0, 0.0), (86.0, 90.0))
    optics = optics_of_leds((wide,), (0.0, 0.0, 0.0), 1.0, camera, gel)
    x, y, z = (v[120] for v in camera.gel_points(gel, np.arange(320.0), np.arange(240.0)))
    far = np.sqrt((22.0 - x) ** 2 + y**2 + (z + 8.0) ** 2)
    slope = -x / np.sqrt(gel.dome_width_radius_mm**2 - x**2)
    cosine = (8.0 + z + slope * (22.0 - x)) / np.hypot(1.0, slope) / far
    expected = 255 * cosine * (22.0 / far) ** 2
    assert np.abs(optics.background[120, :, 0] - expected)[5:-5].max() < 2


def test_light_that_shows_nothing_is_refused():
    sensor = gel_camera("gelsight-mini")
    leds = (sensor.spec.light.leds[0],)
    camera, gel = sensor.camera, sensor.own_gel
    with pytest.raises(T2TwinError, match="background white"):
        optics_of_leds(leds, (9.0, 9.0, 9.0), 2.2, camera, gel)
    with pytest.raises(T2TwinError, match="background black"):
        dark = leds[0].__class__(
            (0.0, 0.0, 0.0), 0.0, 22.0, -8.0, 1.0, (0.0, 0.0, 0.0), (86.0, 90.0)
        )
        optics_of_leds((dark,), (0.0, 0.0, 0.0), 2.2, camera, gel)
