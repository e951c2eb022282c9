"""What varies from one DIGIT to the next, and between which bounds: plain numbers.

Each field is a range (least, most); its default is the shipped distribution. Draws are even, but
for the LEDs' distance and sizes and the noise, which are even in their logarithm. "Assumed" ranges
were chosen in view of two units, the shipped light and one real DIGIT, so that both lie inside:
docs/light.md says where.
"""

from dataclasses import dataclass, fields
from functools import cache
from typing import Annotated, get_args, get_type_hints

import numpy as np
from msgspec import Meta

from t2twin.core.errors import T2TwinError

Amount = Annotated[float, Meta(ge=0.0, le=1.0)]
Part = Annotated[float, Meta(ge=-4.0, le=4.0)]
Around = Annotated[float, Meta(ge=-0.5, le=0.5)]
Grey = Annotated[float, Meta(ge=0.0, le=255.0)]
Degrees = Annotated[float, Meta(ge=-45.0, le=45.0)]
Tilt = Annotated[float, Meta(ge=-5.0, le=5.0)]
Shift = Annotated[float, Meta(ge=-50.0, le=50.0)]
OfLed = Annotated[float, Meta(ge=-20.0, le=20.0)]
FarLed = Annotated[float, Meta(ge=10.0, le=100.0)]
Size = Annotated[float, Meta(ge=0.1, le=30.0)]
Gamma = Annotated[float, Meta(ge=0.5, le=4.0)]
Pixels = Annotated[float, Meta(ge=-100.0, le=320.0)]
Radius = Annotated[float, Meta(ge=0.5, le=50.0)]
Count = Annotated[int, Meta(ge=0, le=100)]
Scale = Annotated[float, Meta(ge=10.0, le=40.0)]
Distance = Annotated[float, Meta(ge=10.0, le=50.0)]
Noise = Annotated[float, Meta(ge=0.01, le=50.0)]


@dataclass(frozen=True)
class UnitRanges:
    """Ranges of what makes a unit. Parts are of the own LED's light in the picture's middle; places
    in them are counted in PLACE_MM, 8 mm.

    Of the camera:
        scale_px_per_mm, distance_mm: public calibrations of single units.
        shift_px: along both axes (assumed: half a millimeter). tilt_deg: about both (assumed).
    Of each of the three LEDs:
        led_turn_deg: off 30, 150 and 270 degrees around the gel, the angles of TACTO's
            configuration (assumed).
        led_distance_mm: one for the unit, as the light is spread out by the plate (assumed).
        led_elevation_deg: over the apex, one for the unit; led_elevation_off_deg: of an LED from it
            (assumed, from the lengths of shadows).
        led_size_mm: radius of the disc, at most 0.95 of its height (assumed: an LED behind a
            diffuser, 1 to 9 mm).
    Of the light that each LED leaves in each color:
        facing_grey: of the gel that faces its own LED (assumed).
        beam_along_part, beam_across_part: rise of an LED's light towards it, and of the two upper
            LEDs' away from the picture's lower end (assumed). beam_curve_part, beam_twist_part:
            its second derivatives' halves (assumed).
        cosine_slope_part, cosine_bend_part: how far it differs from lambertian paint, with the
            cosine of incidence and its square (assumed).
        leak_amount: of an LED's light in the other two channels, times leak_part for each of
            them; negative where the camera's color correction takes it off (assumed).
        irregular_amount: by how much the light in each color has a pattern of its own (assumed).
    Of the picture:
        linear_amount: share of units whose grey levels go with the light, with a gamma in
            linear_gamma; the others' is in gamma (assumed; TACTO's renderer 2.2, a real unit 1).
        scattered_part: undirected light beside the LEDs' own on the untouched gel (assumed).
        follow_amount: how far the background follows the LEDs' light and not a pattern of its own,
            whose rise along both axes is gradient_part (assumed).
        brightness_grey: bounds of a channel's mean in the background (assumed).
        pattern_grey: the most that a channel's standard deviation in it is, before what follows
            (assumed).
        uneven_coarse_grey, uneven_fine_grey: standard deviation of smooth blotches about 80 and
            about 10 pixels wide (assumed). texture_grey: of the pixels' fixed pattern (assumed).
        edge_dark_amount: how dark the picture is at one of its sides, as far as edge_px, blurred
            over edge_soft_px (assumed).
        specks: how many; speck_px: their radius; speck_grey: how bright or dark (assumed).
        noise_grey: standard deviation of one frame (2.8 measured on a real unit; TACTO 7).
    Of units about a calibration:
        around_led_mm: its LEDs' places. around_part: its sizes, light, colors, brightness and
            noise; half as much of its gamma, a quarter of its scale and distance (assumed).
        around_shift_px, around_tilt_deg: its camera (assumed).
    Raises T2TwinError for a range that is reversed or out of bounds.
    """

    scale_px_per_mm: tuple[Scale, Scale] = (17.2, 19.6)
    distance_mm: tuple[Distance, Distance] = (20.8, 22.0)
    shift_px: tuple[Shift, Shift] = (-10.0, 10.0)
    tilt_deg: tuple[Tilt, Tilt] = (-1.5, 1.5)
    led_turn_deg: tuple[Degrees, Degrees] = (-9.0, 9.0)
    led_distance_mm: tuple[FarLed, FarLed] = (16.0, 25.0)
    led_elevation_deg: tuple[Degrees, Degrees] = (11.0, 25.0)
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
            pair = value if isinstance(value, tuple) else (value, value)
            if not all(low <= of <= high for of in pair):
                raise T2TwinError(
                    f"{field.name} is {_shown(value)}; it must lie between {low:g} and {high:g}"
                )
            if len(pair) != 2 or pair[0] > pair[1]:
                raise T2TwinError(
                    f"{field.name} is {_shown(value)}; it must be two numbers, the least first"
                )


def _shown(value: object) -> str:
    """A value as a user writes it."""
    return str(list(value)) if isinstance(value, tuple) else str(value)


@cache
def _bounds() -> dict[str, tuple[float, float]]:
    """Least and most of each field's numbers, as their types say."""
    bounds = {}
    for name, kind in get_type_hints(UnitRanges, include_extras=True).items():
        number = get_args(kind)[0] if get_args(kind)[0] not in (int, float) else kind
        meta = number.__metadata__[0]
        bounds[name] = (meta.ge, meta.le)
    return bounds


Range = tuple[float, float]


def evenly(rng: np.random.Generator, between: Range, shape: int | tuple = ()) -> np.ndarray:
    """Even draws of a shape."""
    return rng.uniform(between[0], between[1], shape)


def log_uniform(rng: np.random.Generator, between: Range, shape: int | tuple = ()) -> np.ndarray:
    """Draws of a shape whose logarithm is even."""
    return np.exp(rng.uniform(np.log(between[0]), np.log(between[1]), shape))
