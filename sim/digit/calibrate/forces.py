"""The twin's forces at the depths found in frames, and the gel's modulus from measured forces."""

import tempfile
from functools import partial
from pathlib import Path

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad.export import write_ball
from t2twin.primitives_cad.shape import Shape
from t2twin.sim.contact.contact_solver import DIGIT_PITCH_MM, solve_contact
from t2twin.sim.contact.depth import force_at_depth
from t2twin.sim.contact.elastomer import DIGIT_GEL
from t2twin.sim.contact.types import PressCommand


class BallForces:
    """Presses balls into the DIGIT's gel; prepares each ball once."""

    def __init__(self) -> None:
        self._balls: dict[float, Shape] = {}

    def of(self, poses: np.ndarray, diameters_mm: np.ndarray) -> np.ndarray:
        """(n,) N, in the default gel; NaN where no allowed force reaches the depth.

        poses: (n, 3) x_mm, y_mm, depth_mm.
        """
        return np.array(
            [
                self._force_n(pose, float(diameter_mm))
                for pose, diameter_mm in zip(poses, diameters_mm, strict=True)
            ]
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


def fit_young_mpa(measured_n: np.ndarray, default_n: np.ndarray) -> float:
    """The gel's modulus, MPa, by least squares over the presses with both forces.

    measured_n: (n,), NaN where not measured. default_n: (n,) the twin's at the same depths, in
    DIGIT_GEL. At a given depth the force of a frictionless contact is proportional to the modulus,
    since the layer's stiffening depends on its strain alone. Raises T2TwinError where no press has
    both.
    """
    both = np.isfinite(measured_n) & np.isfinite(default_n)
    if not both.any():
        raise T2TwinError("no press with a measured force can be pressed that deep in the twin")
    measured, default = measured_n[both], default_n[both]
    return float(DIGIT_GEL.young_mpa * (measured @ default) / (default @ default))
