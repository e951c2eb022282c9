"""Optics of LEDs that a sensor's file describes: a Lambertian coating, lit by spot lights."""

from dataclasses import replace

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.optical.camera.pinhole import Camera
from t2twin.sim.optical.image_renderer import ImageRenderer
from t2twin.sim.optical.light.illumination import COSINE_TERMS
from t2twin.sim.optical.light.leds import Led
from t2twin.sim.optical.optics import PLACE_TERMS, Optics, place_terms

PLACES = 48
"""Places along each axis of the image to which the beams are fitted (assumed: beams are smooth)."""

Color = tuple[float, float, float]


def optics_of_leds(
    leds: tuple[Led, ...], ambient: Color, gamma: float, camera: Camera, gel: Elastomer
) -> Optics:
    """The optics of a unit with these LEDs.

    ambient: undirected light, which adds to the background. Raises T2TwinError where the gel at
    rest would be overexposed everywhere, or dark.
    """
    response = np.zeros((len(leds), 3, PLACE_TERMS, COSINE_TERMS))
    for led, own in zip(leds, response, strict=True):
        own[:, :, 0] = np.outer(led.color, _beam_terms(led, camera, gel))
    blank = Optics(
        background=np.zeros((camera.rows, camera.columns, 3), np.uint8),
        leds_mm=np.array([led.position_mm for led in leds]),
        sizes_mm=np.array([max(led.size_mm, 1e-3) for led in leds]),
        response=response,
        gamma=gamma,
        **camera.placement,
    )
    background = ImageRenderer(blank, gel, 0.0).background_in(np.array(ambient))
    for level, what in ((0, "black"), (255, "white")):
        if (background == level).all():
            raise T2TwinError(
                f"the LEDs leave the background {what} in every pixel and color; change their "
                "color or the ambient light"
            )
    return replace(blank, background=background)


def _beam_terms(led: Led, camera: Camera, gel: Elastomer) -> np.ndarray:
    """(PLACE_TERMS,) polynomial of an LED's beam over the part of the gel that the camera sees."""
    columns, rows = (np.linspace(0, count - 1, PLACES) for count in (camera.columns, camera.rows))
    points = np.stack(camera.gel_points(gel, columns, rows), axis=-1).reshape(-1, 3)
    terms, inside = place_terms(points[:, 0], points[:, 1]), led.in_beam(points)
    if np.ptp(inside) < 1e-6:
        return inside[0] * np.eye(PLACE_TERMS)[0]
    return np.linalg.lstsq(terms, inside, rcond=None)[0]
