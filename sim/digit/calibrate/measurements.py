"""Measurements of the presses besides their frames: ball diameters, displacements, forces.

They are read from `forces.csv` in the folder of the frames. It has a column file, and any of
force_n, depth_mm and ball_diameter_mm; a cell may be empty. A Tolerance bounds their errors.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from os.path import lexists
from pathlib import Path
from typing import Annotated

import numpy as np
from msgspec import Meta

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.types import FORCE_RANGE_N
from t2twin.sim.tables import read_rows

FORCES = "forces.csv"
"""Name of the file of measurements."""
BALL_MM = (1.0, 12.0)
"""Ball diameters that press a DIGIT's gel and fit into its image, mm."""
DEEPEST_MM = 4.0
"""Largest displacement, mm: the gel is 4.07 mm thick."""

Force = Annotated[float, Meta(ge=FORCE_RANGE_N[0], le=FORCE_RANGE_N[1])]
Depth = Annotated[float, Meta(gt=0.0, le=DEEPEST_MM)]
Diameter = Annotated[float, Meta(ge=BALL_MM[0], le=BALL_MM[1])]


@dataclass(frozen=True)
class Tolerance:
    """Largest errors, in either direction.

    ball_mm: of the ball diameters. scale_px_per_mm: of the image scale; unused if displacements are
    measured. depth_mm: of the displacements, mainly of their zero at first contact. force_n: of the
    forces. young_mpa: of the gel's default modulus; unused if forces are measured.

    The defaults are assumed: a caliper for the ball, a stage zeroed by eye, and a kitchen scale.
    The scale's is from 19.2 px/mm to 17.2, the lowest of public units. The modulus' is Gent's 0.41
    to 0.57 MPa of Shore 10A to 15A.

    Raises T2TwinError for a value that is negative or not finite.
    """

    ball_mm: float = 0.1
    scale_px_per_mm: float = 2.0
    depth_mm: float = 0.03
    force_n: float = 0.05
    young_mpa: float = 0.1

    def __post_init__(self) -> None:
        for field in fields(self):
            arguments.number(getattr(self, field.name), f"the tolerance {field.name}", low=0.0)


@dataclass(frozen=True)
class _Row:
    """One press of the file."""

    file: str
    force_n: Force | None = None
    depth_mm: Depth | None = None
    ball_diameter_mm: Diameter | None = None


@dataclass(frozen=True)
class Measurements:
    """Measurements of n presses, each (n,).

    diameters_mm: of the balls. depths_mm: from first contact. forces_n. The last two are NaN where
    there is no measurement.
    """

    diameters_mm: np.ndarray
    depths_mm: np.ndarray
    forces_n: np.ndarray

    def subset(self, presses: Sequence[int]) -> "Measurements":
        """The measurements of the presses with these indices."""
        return Measurements(
            self.diameters_mm[presses], self.depths_mm[presses], self.forces_n[presses]
        )

    @property
    def has_depths(self) -> bool:
        return bool(np.isfinite(self.depths_mm).any())

    @property
    def has_forces(self) -> bool:
        return bool(np.isfinite(self.forces_n).any())


def read_measurements(folder: Path, names: Sequence[str], ball_diameter_mm: float) -> Measurements:
    """The measurements of the named frames of a folder; its file FORCES may be missing.

    ball_diameter_mm: of presses without a diameter in the file. Raises T2TwinError for a diameter
    outside BALL_MM, an invalid file, and a row without a frame or with the frame of another row.
    """
    check_ball(ball_diameter_mm)
    path, index = folder / FORCES, {name: number for number, name in enumerate(names)}
    missing = np.full(len(names), np.nan)
    measurements = Measurements(
        np.full(len(names), float(ball_diameter_mm)), missing.copy(), missing.copy()
    )
    if not lexists(path):  # a broken link is an error
        return measurements
    seen = set()
    for row in read_rows(path, _Row, "a table of presses"):
        if row.file not in index:
            raise T2TwinError(f"{path} names {row.file}, which is not a frame in {folder}")
        if row.file in seen:
            raise T2TwinError(f"{path} names {row.file} twice; each frame has one row")
        seen.add(row.file)
        for values, value in (
            (measurements.diameters_mm, row.ball_diameter_mm),
            (measurements.depths_mm, row.depth_mm),
            (measurements.forces_n, row.force_n),
        ):
            if value is not None:
                values[index[row.file]] = value
    return measurements


def check_ball(diameter_mm: float) -> None:
    """Raises T2TwinError for a ball diameter outside BALL_MM."""
    arguments.number(diameter_mm, "the ball's diameter in mm", *BALL_MM)
