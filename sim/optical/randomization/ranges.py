"""Ranges of the parameters that differ between the units of a gel camera.

Each field is a range (low, high) with a default. Samples are uniform; those of the LEDs' distance
and sizes and of the noise are log-uniform. "Assumed" ranges were set to contain the default
optics and one real DIGIT; docs/explanation/optics.md compares them.
"""

from dataclasses import dataclass, fields
from functools import cache
from typing import Annotated, get_args, get_type_hints

import numpy as np
from msgspec import Meta

from t2twin.core.errors import T2TwinError
from t2twin.sim.optical.light.leds import LedDistance
from t2twin.sim.optical.spec import Distance, Elevation, Scale, Tilt

Amount = Annotated[float, Meta(ge=0.0, le=1.0)]
Part = Annotated[float, Meta(ge=-4.0, le=4.0)]
Around = Annotated[float, Meta(ge=-0.5, le=0.5)]
Grey = Annotated[float, Meta(ge=0.0, le=255.0)]
Degrees = Annotated[float, Meta(ge=-45.0, le=45.0)]
Shift = Annotated[float, Meta(ge=-50.0, le=50.0)]
OfLed = Annotated[float, Meta(ge=-20.0, le=20.0)]
Size = Annotated[float, Meta(ge=0.1, le=30.0)]
Gamma = Annotated[float, Meta(ge=0.5, le=4.0)]
Pixels = Annotated[float, Meta(ge=-100.0, le=320.0)]
Radius = Annotated[float, Meta(ge=0.5, le=50.0)]
Count = Annotated[int, Meta(ge=0, le=100)]
Noise = Annotated[float, Meta(ge=0.01, le=50.0)]


@dataclass(frozen=True)
class UnitRanges:
    """Ranges of a unit's parameters; None is that of the sensor's table [units].

    Parts are relative to the own LED's light in the image's
    middle; places are in units of PLACE_MM, 8 mm.

    Of the camera:
        scale_px_per_mm, distance_mm: image scale, and distance from the pinhole to the gel.
        shift_px: along both axes (assumed: half a millimeter). tilt_deg: about both (assumed).
    Of each LED:
        led_turn_deg: deviation from its angle around the gel (assumed).
        led_distance_mm: one value per unit, as the plate spreads the light (assumed).
        led_elevation_deg: over the apex, one value per unit; led_elevation_off_deg: deviation of
            each LED (assumed, from the lengths of shadows).
        led_size_mm: radius of the disc, at most 0.95 of its height (assumed: an LED behind a
            diffuser, 1 to 9 mm).
    Of the light that each LED leaves in each color:
        facing_grey: grey level of gel that faces its own LED (assumed).
        beam_along_part, beam_across_part: gradient of an LED's light towards it, and of LEDs at the
            right and left away from the image's lower end (assumed). beam_curve_part,
            beam_twist_part: half its second derivatives (assumed).
        cosine_slope_part, cosine_bend_part: deviation from a Lambertian surface, linear and
            quadratic in the cosine of incidence (assumed).
        leak_amount: of an LED's light in the other two channels, multiplied by leak_part of each;
            negative where the camera's color correction subtracts it (assumed).
        irregular_amount: of a separate pattern of the light in each color (assumed).
    Of the image:
        linear_amount: share of units with grey levels nearly linear in the light, of a gamma in
            linear_gamma; the others' is in gamma (assumed; TACTO's renderer 2.2, a real unit 1).
        scattered_part: undirected light on the gel at rest, added to the LEDs' (assumed).
        follow_amount: weight of the LEDs' light in the background, against a separate pattern
            whose gradients along both axes are gradient_part (assumed).
        brightness_grey: of a channel's mean in the background (assumed).
        pattern_grey: maximum of a channel's standard deviation, before the following (assumed).
        uneven_coarse_grey, uneven_fine_grey: standard deviation of smooth blotches about 80 and
            about 10 pixels wide (assumed). texture_grey: of the pixels' fixed pattern (assumed).
        edge_dark_amount: darkening of one side of the image, up to edge_px, blurred over
            edge_soft_px (assumed).
        specks: their number; speck_px: their radius; speck_grey: their contrast (assumed).
        noise_grey: standard deviation of one frame (2.8 measured on a real unit; TACTO 7).
    Of units near an optics file, relative to it:
        around_led_mm: LED positions. around_part: sizes, light, colors, brightness and noise; half
            of it for gamma, a quarter for scale and distance (assumed).
        around_shift_px, around_tilt_deg: camera (assumed).
    Raises T2TwinError for a range that is reversed or out of bounds.
    """

    scale_px_per_mm: tuple[Scale, Scale] | None = None
    distance_mm: tuple[Distance, Distance] | None = None
    shift_px: tuple[Shift, Shift] = (-10.0, 10.0)
    tilt_deg: tuple[Tilt, Tilt] = (-1.5, 1.5)
    led_turn_deg: tuple[Degrees, Degrees] = (-9.0, 9.0)
    led_distance_mm: tuple[LedDistance, LedDistance] | None = None
    led_elevation_deg: tuple[Elevation, Elevation] | None = None
    led_elevation_off_deg: tuple[Degrees, Degrees] = (-4.0, 4.0)
    led_size_mm: tuple[Size, Size] = (1.0, 9.0)
    facing_grey: tuple[Grey, Grey] = (110.0, 250.0)
    beam_along_part: tuple[Part, Part] = (-1.8, 0.4)
    beam_across_part: tuple[Part, Part] = (-0.2, 2.0)
    beam_curve_part: tuple[Part, Part] = (-2.0, 0.4)
    beam_twist_part: tuple[Part, Part] = (-1.0, 1.0)
    cosine_slope_part: tuple[Part, Part] = (-0.5, 0.8)
    cosine_bend_part: tuple[Part, Part] = (-2.0, 0.8)
    leak_amount: tuple[Amount, Amount] = (0.0, 1.0)
    leak_part: tuple[Part, Part] = (-0.8, 0.8)
    irregular_amount: tuple[Amount, Amount] = (0.0, 1.0)
    linear_amount: Amount = 0.4
    linear_gamma: tuple[Gamma, Gamma] = (0.9, 1.1)
    gamma: tuple[Gamma, Gamma] = (1.1, 2.4)
    scattered_part: tuple[Part, Part] = (0.0, 1.2)
    follow_amount: tuple[Amount, Amount] = (0.1, 1.0)
    gradient_part: tuple[Part, Part] = (-0.5, 0.5)
    brightness_grey: tuple[Grey, Grey] = (70.0, 135.0)
    pattern_grey: tuple[Grey, Grey] = (10.0, 48.0)
    uneven_coarse_grey: tuple[Grey, Grey] = (0.0, 10.0)
    uneven_fine_grey: tuple[Grey, Grey] = (0.0, 3.0)
    texture_grey: tuple[Grey, Grey] = (0.0, 1.3)
    edge_dark_amount: tuple[Amount, Amount] = (0.0, 0.6)
    edge_px: tuple[Pixels, Pixels] = (-30.0, 45.0)
    edge_soft_px: tuple[Radius, Radius] = (6.0, 40.0)
    specks: tuple[Count, Count] = (0, 6)
    speck_px: tuple[Radius, Radius] = (1.0, 6.0)
    speck_grey: tuple[Grey, Grey] = (10.0, 60.0)
    noise_grey: tuple[Noise, Noise] = (1.5, 7.0)
    around_led_mm: tuple[OfLed, OfLed] = (-1.0, 1.0)
    around_part: tuple[Around, Around] = (-0.1, 0.1)
    around_shift_px: tuple[Shift, Shift] = (-4.0, 4.0)
    around_tilt_deg: tuple[Tilt, Tilt] = (-0.5, 0.5)

    def __post_init__(self) -> None:
        for field in fields(self):
            value, (low, high) = getattr(self, field.name), _bounds()[field.name]
            if value is None:
                continue
            pair = value if isinstance(value, tuple) else (value, value)
            if not all(low <= of <= high for of in pair):
                raise T2TwinError(
                    f"{field.name} is {_shown(value)}; it must lie between {low:g} and {high:g}"
                )
            if len(pair) != 2 or pair[0] > pair[1]:
                raise T2TwinError(
                    f"{field.name} is {_shown(value)}; it must be two numbers, the smaller first"
                )


def _shown(value: object) -> str:
    """A value in TOML's notation."""
    return str(list(value)) if isinstance(value, tuple) else str(value)


@cache
def _bounds() -> dict[str, tuple[float, float]]:
    """The bounds of each field's numbers, from their types."""
    bounds = {}
    for name, kind in get_type_hints(UnitRanges, include_extras=True).items():
        kind = get_args(kind)[0] if type(None) in get_args(kind) else kind
        number = get_args(kind)[0] if get_args(kind)[0] not in (int, float) else kind
        meta = number.__metadata__[0]
        bounds[name] = (meta.ge, meta.le)
    return bounds


Range = tuple[float, float]


def log_uniform(rng: np.random.Generator, bounds: Range, shape: int | tuple = ()) -> np.ndarray:
    """Samples of a shape whose logarithm is uniform."""
    return np.exp(rng.uniform(np.log(bounds[0]), np.log(bounds[1]), shape))
