"""What a user knows of the presses besides their frames: the balls, displacements, forces.

It stands in `forces.csv` beside the frames: a column file, and any of force_n, depth_mm and
ball_diameter_mm; a cell may be empty. How sure the numbers are is a Tolerance.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated

import numpy as np
from msgspec import Meta

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.tables import read_rows
from t2twin.sim.contact.types import FORCE_RANGE_N

FORCES = "forces.csv"
"""The file among the frames."""
BALL_MM = (1.0, 12.0)
"""Diameters of balls that press a DIGIT's gel and fit its picture, mm."""
DEEPEST_MM = 4.0
"""Deepest displacement, mm: the gel is 4.07 mm thick."""

Force = Annotated[float, Meta(ge=FORCE_RANGE_N[0], le=FORCE_RANGE_N[1])]
Depth = Annotated[float, Meta(gt=0.0, le=DEEPEST_MM)]
Diameter = Annotated[float, Meta(ge=BALL_MM[0], le=BALL_MM[1])]


@dataclass(frozen=True)
class Tolerance:
    """How far from what is stated the truth may be, either way.

    ball_mm: the balls' diameters. scale_px_per_mm: the picture's scale; where displacements are
    known it is not asked for. depth_mm: those displacements, their zero at the first touch
    foremost. force_n: known forces. young_mpa: the gel's modulus as the twin assumes it; where
    forces are known it is not asked for. Defaults are assumed: a slide gauge's for the ball; of the
    scale what reaches from 19.2 px/mm to the least of public units, 17.2; a stage's that is set to
    zero by eye; a kitchen scale's; and of the modulus what spans Gent's 0.41 to 0.57 MPa of Shore
    10A to 15A.
    Raises T2TwinError for one that is negative or not finite.
    """

    ball_mm: float = 0.1
    scale_px_per_mm: float = 2.0
    depth_mm: float = 0.03
    force_n: float = 0.05
    young_mpa: float = 0.1

    def __post_init__(self) -> None:
        for field in fields(self):
            value = arguments.real(getattr(self, field.name), field.name)
            if not (np.isfinite(value) and value >= 0.0):
                raise T2TwinError(
                    f"the tolerance {field.name} is {value:g}; it must be 0 or a positive number"
                )


@dataclass(frozen=True)
class _Row:
    """One press of the file."""

    file: str
    force_n: Force | None = None
    depth_mm: Depth | None = None
    ball_diameter_mm: Diameter | None = None


@dataclass(frozen=True)
class Measurements:
    """What is known of n presses, each (n,). diameters_mm: of the balls. depths_mm, forces_n: NaN
    where unknown; depths from the first touch."""

    diameters_mm: np.ndarray
    depths_mm: np.ndarray
    forces_n: np.ndarray

    def of(self, presses: Sequence[int]) -> "Measurements":
        """Of some of them, by their indices."""
        return Measurements(
            self.diameters_mm[presses], self.depths_mm[presses], self.forces_n[presses]
        )

    @property
    def has_depths(self) -> bool:
        return bool(np.isfinite(self.depths_mm).any())

    @property
    def has_forces(self) -> bool:
        return bool(np.isfinite(self.forces_n).any())


def read_known(folder: Path, names: Sequence[str], ball_diameter_mm: float) -> Measurements:
    """Of the frames of these names in a folder, from its FORCES, where there is one.

    ball_diameter_mm: of the presses of which the file says none. Raises T2TwinError for a ball out
    of BALL_MM, a file that is no such table, and one that names what is no frame, or a frame twice.
    """
    check_ball(ball_diameter_mm)
    path, at = folder / FORCES, {name: number for number, name in enumerate(names)}
    nothing = np.full(len(names), np.nan)
    known = Measurements(
        np.full(len(names), float(ball_diameter_mm)), nothing.copy(), nothing.copy()
    )
    if not path.exists():
        return known
    seen = set()
    for row in read_rows(path, _Row, "a table of presses"):
        if row.file not in at:
            raise T2TwinError(f"{path} names {row.file}, which is no frame in {folder}")
        if row.file in seen:
            raise T2TwinError(f"{path} names {row.file} twice; each frame has one row")
        seen.add(row.file)
        for values, value in (
            (known.diameters_mm, row.ball_diameter_mm),
            (known.depths_mm, row.depth_mm),
            (known.forces_n, row.force_n),
        ):
            if value is not None:
                values[at[row.file]] = value
    return known


def check_ball(diameter_mm: float) -> None:
    """Raises T2TwinError for a ball that fits no picture."""
    diameter_mm = arguments.real(diameter_mm, "ball_diameter_mm")
    if not BALL_MM[0] <= diameter_mm <= BALL_MM[1]:
        raise T2TwinError(
            f"the ball's diameter is {diameter_mm:g} mm; it must lie between "
            f"{BALL_MM[0]:g} and {BALL_MM[1]:g}"
        )
