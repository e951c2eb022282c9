"""What a fit looks for besides poses and response: the LEDs, and how the gel leaves a ball."""

import numpy as np

from t2twin.sim.digit.rays import Leds

# name, start, step of the difference quotient, spread of the prior
GEOMETRY = (
    ("azimuth_0_deg", 30.0, 0.7, 10.0),  # as TACTO's configuration and the maker's notes
    ("azimuth_1_deg", 150.0, 0.7, 10.0),
    ("azimuth_2_deg", 270.0, 0.7, 10.0),
    ("elevation_0_deg", 19.0, 0.5, 6.0),  # assumed from the lengths of real shadows
    ("elevation_1_deg", 19.0, 0.5, 6.0),
    ("elevation_2_deg", 13.0, 0.5, 6.0),
    ("radius_mm", 19.0, 0.5, 4.0),  # assumed: beside the gel
    ("log_size_0", np.log(2.0), 0.05, 0.5),  # assumed: an LED behind a diffuser, mm
    ("log_size_1", np.log(2.0), 0.05, 0.5),
    ("log_size_2", np.log(3.0), 0.05, 0.5),
    ("hold", 0.75, 0.01, 0.1),  # assumed; t2twin.sim.digit.deflections
    ("skirt", 1.0, 0.03, 0.3),
)
START = np.array([row[1] for row in GEOMETRY])
NUDGE = np.array([row[2] for row in GEOMETRY])
SPREAD = np.array([row[3] for row in GEOMETRY])


def leds_of(geometry: np.ndarray) -> Leds:
    """The LEDs that parameters in the order of GEOMETRY stand for."""
    azimuth, elevation = np.radians(geometry[0:3]), np.radians(geometry[3:6])
    radius = geometry[6]
    places = np.stack(
        [radius * np.cos(azimuth), -radius * np.sin(azimuth), -radius * np.tan(elevation)], axis=1
    )
    return Leds(places, np.exp(geometry[7:10]))
