"""The forces that the twin needs for the depths found in frames, and the gel's modulus from those
that a scale showed."""

import tempfile
from functools import partial
from pathlib import Path

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad.ball import write_ball
from t2twin.primitives_cad.shape import Shape
from t2twin.sim.contact.contact_solver import DIGIT_PITCH_MM, solve_contact
from t2twin.sim.contact.depth import force_at_depth
from t2twin.sim.contact.elastomer import DIGIT_GEL
from t2twin.sim.contact.types import PressCommand


class BallForces:
    """Presses balls into the DIGIT's gel, each ball prepared once."""

    def __init__(self) -> None:
        self._balls: dict[float, Shape] = {}

    def of(self, poses: np.ndarray, diameters_mm: np.ndarray) -> np.ndarray:
        """(n,) N, of the gel as it is assumed; NaN where no force that may be commanded goes so
        deep. poses: (n, 3) x_mm, y_mm, depth_mm."""
        return np.array(
            [self._force_n(pose, float(of)) for pose, of in zip(poses, diameters_mm, strict=True)]
        )

    def _force_n(self, pose: np.ndarray, diameter_mm: float) -> float:
        ball = self._ball(diameter_mm)
        command = PressCommand(ball.name, float(pose[0]), float(pose[1]), 0.0, 1.0)
        press = partial(solve_contact, ball, elastomer=DIGIT_GEL, pitch_mm=DIGIT_PITCH_MM)
        try:
            return force_at_depth(press, command, float(pose[2]))
        except T2TwinError:
            return float("nan")

    def _ball(self, diameter_mm: float) -> Shape:
        if diameter_mm not in self._balls:
            with tempfile.TemporaryDirectory() as folder:
                self._balls[diameter_mm] = write_ball(Path(folder) / "ball.step", diameter_mm)
        return self._balls[diameter_mm]


def fitted_young_mpa(known_n: np.ndarray, assumed_n: np.ndarray) -> float:
    """The gel's modulus, MPa, by least squares of forces (n,), of which NaN are left out.

    known_n: measured. assumed_n: the twin's at the same depths, of DIGIT_GEL. A contact without
    friction at a given depth carries a force that goes with the modulus: the layer's stiffening
    depends on its strain alone. Raises T2TwinError where none can be compared.
    """
    both = np.isfinite(known_n) & np.isfinite(assumed_n)
    if not both.any():
        raise T2TwinError("no press of a known force can be pressed so deep in the twin")
    known, assumed = known_n[both], assumed_n[both]
    return float(DIGIT_GEL.young_mpa * (known @ assumed) / (assumed @ assumed))
