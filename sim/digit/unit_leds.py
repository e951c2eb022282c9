"""What stands for a drawn unit's LEDs in pyrender: lamps of the same places, sizes and colours.

Each has the lobe of the shipped LED in its place, turned and moved with it: pyrender's shadow maps
are as fine as that lobe is narrow. Its colour is such that in the picture's middle it gives the
drawn light. Light that is taken away, as by a negative leak, is left out.
"""

import numpy as np

from t2twin.sim.digit.leds import DIGIT_LEDS, Led
from t2twin.sim.digit.unit_light import DrawnLight, at_middle

LEAST_IN_BEAM = 0.2
"""Least part of a lobe's light that the middle counts as getting, so that no LED is too bright."""


def leds_like(light: DrawnLight) -> tuple[Led, ...]:
    """LEDs for t2twin.sim.digit.reference, in the order of the light's."""
    colours = np.maximum(at_middle(light.response), 0.0)
    return tuple(
        _led_like(shipped, place, float(size), colour)
        for shipped, place, size, colour in zip(
            DIGIT_LEDS, light.places_mm, light.sizes_mm, colours, strict=True
        )
    )


def _led_like(shipped: Led, place_mm: np.ndarray, size_mm: float, colour: np.ndarray) -> Led:
    """A shipped LED moved to another place, of another size and colour."""
    angle = np.arctan2(-place_mm[1], place_mm[0])
    radius_mm = float(np.hypot(place_mm[0], place_mm[1]))
    turn, stretch = angle - np.radians(shipped.angle_deg), radius_mm / shipped.radius_mm
    cos, sin = stretch * np.cos(turn), stretch * np.sin(turn)
    aim_x, aim_y, aim_z = shipped.aim_mm
    # angles rise against y, which runs down the picture
    aim_mm = (float(cos * aim_x + sin * aim_y), float(cos * aim_y - sin * aim_x), aim_z)
    colour = colour / max(_in_beam(place_mm, np.array(aim_mm), shipped.beam_rad), LEAST_IN_BEAM)
    return Led(
        colour=(float(colour[0]), float(colour[1]), float(colour[2])),
        angle_deg=float(np.degrees(angle)),
        radius_mm=radius_mm,
        z_mm=float(place_mm[2]),
        size_mm=size_mm,
        aim_mm=aim_mm,
        beam_rad=shipped.beam_rad,
    )


def _in_beam(place_mm: np.ndarray, aim_mm: np.ndarray, beam_rad: tuple[float, float]) -> float:
    """Part of a lobe's light that the gel's apex gets: glTF's spot light, as in pyrender."""
    axis, middle = aim_mm - place_mm, -place_mm
    cosine = np.dot(axis, middle) / (np.linalg.norm(axis) * np.linalg.norm(middle))
    inner, outer = np.cos(beam_rad)
    return float(np.clip((cosine - outer) / (inner - outer), 0.0, 1.0) ** 2)
