"""Samples and geometry of the fit of one press.

A sample is a block of 2 x 2 pixels; an image has (ROWS / 2, COLUMNS / 2). A press is fitted to the
samples in a square around it. The geometry is the vector of the nonlinear parameters that all
presses share: the LEDs, and the gel's profile around a ball.
"""

from dataclasses import dataclass

import numpy as np

from t2twin.sim.digit.calibrate.ridge import Terms
from t2twin.sim.digit.camera.pinhole import COLUMNS, ROWS
from t2twin.sim.digit.light.ray_casting import Leds
from t2twin.sim.digit.surface import ball_surface

HALF_SAMPLES = 36
"""Half side of the square around a press, samples: 7.5 mm, which contains the shadows."""

SHALLOWEST_MM, DEEPEST = 0.1, 0.93
"""Bounds of a press's depth: mm, and in parts of the ball's radius."""

Profile = tuple[float, float, float]
"""Radius of a ball, mm, and the gel's profile around it: hold and skirt of ball_surface."""

Square = tuple[slice, slice]
"""Rows and columns of samples."""

# name, start, step of the difference quotient, standard deviation of the prior
GEOMETRY = (
    ("azimuth_0_deg", 30.0, 0.7, 10.0),  # as TACTO's configuration and the maker's notes
    ("azimuth_1_deg", 150.0, 0.7, 10.0),
    ("azimuth_2_deg", 270.0, 0.7, 10.0),
    ("elevation_0_deg", 19.0, 0.5, 6.0),  # assumed from the lengths of real shadows
    ("elevation_1_deg", 19.0, 0.5, 6.0),
    ("elevation_2_deg", 13.0, 0.5, 6.0),
    ("radius_mm", 19.0, 0.5, 1.0),  # assumed: next to the gel
    ("log_size_0", np.log(2.0), 0.05, 0.5),  # assumed: an LED behind a diffuser, mm
    ("log_size_1", np.log(2.0), 0.05, 0.5),
    ("log_size_2", np.log(3.0), 0.05, 0.5),
    ("hold", 0.75, 0.01, 0.1),  # assumed; t2twin.sim.digit.surface
    ("skirt", 1.0, 0.03, 0.3),
)
START = np.array([row[1] for row in GEOMETRY])
NUDGE = np.array([row[2] for row in GEOMETRY])
SPREAD = np.array([row[3] for row in GEOMETRY])


@dataclass(frozen=True)
class State:
    """Fitted parameters.

    geometry: (12,) as in GEOMETRY. poses: (n, 3). response: (RGB, entries of its terms). error:
    mean square error with the priors.
    """

    geometry: np.ndarray
    poses: np.ndarray
    terms: Terms
    response: np.ndarray
    error: float


def samples_of(image: np.ndarray) -> np.ndarray:
    """(ROWS / 2, COLUMNS / 2, 3): the block means of an image (ROWS, COLUMNS, 3)."""
    return image.reshape(ROWS // 2, 2, COLUMNS // 2, 2, 3).mean(axis=(1, 3))


def square_about(patch: np.ndarray) -> Square:
    """The square of samples around a contact (row, column), px, moved into the image."""
    row = round(min(max(patch[0] / 2, HALF_SAMPLES), ROWS // 2 - HALF_SAMPLES))
    column = round(min(max(patch[1] / 2, HALF_SAMPLES), COLUMNS // 2 - HALF_SAMPLES))
    return (
        slice(row - HALF_SAMPLES, row + HALF_SAMPLES),
        slice(column - HALF_SAMPLES, column + HALF_SAMPLES),
    )


def inner(square: Square) -> Square:
    """The same square on the lattice of samples, which has one more row and column at each edge."""
    rows, columns = (slice(side.start + 1, side.stop + 1) for side in square)
    return rows, columns


def surface_at(pose: np.ndarray, profile: Profile) -> np.ndarray:
    """The deflection by a ball at a pose within the bounds, mm, on optical_grid()."""
    radius_mm, hold, skirt = profile
    depth = min(max(pose[2], SHALLOWEST_MM), DEEPEST * radius_mm)
    hold, skirt = min(max(hold, 0.3), 0.97), min(max(skirt, 0.3), 4.0)
    return ball_surface(pose[0], pose[1], depth, radius_mm, hold, skirt)


def leds_of(geometry: np.ndarray) -> Leds:
    """The LEDs of a geometry, (12,) in the order of GEOMETRY."""
    azimuth, elevation = np.radians(geometry[0:3]), np.radians(geometry[3:6])
    radius = geometry[6]
    places = np.stack(
        [radius * np.cos(azimuth), -radius * np.sin(azimuth), -radius * np.tan(elevation)], axis=1
    )
    return Leds(places, np.exp(geometry[7:10]))
