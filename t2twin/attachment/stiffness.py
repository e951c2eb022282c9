"""Contact parameters of MuJoCo with which a body sinks into a sensor as deep as into its layer.

At rest, MuJoCo's force at a penetration r is stiffness d(r)^2 r / (d_w^2 (1 - d(r)) A), with the
impedance d(r), d_w = d(width), and the inverse mass A of both bodies. It follows from the relation
a + d (b v + k r) = (1 - d) a0 in MuJoCo's documentation, Modeling, Solver parameters, with a = 0.
"""

from typing import NamedTuple

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad.shape import Shape
from t2twin.sim.contact.contact_solver import solve_contact
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.types import PressCommand

# Forces at which the depths are fitted, N: those of most grasps (assumed).
FIT_FORCES_N = (0.5, 1.0, 2.0, 4.0, 8.0, 12.0)
MIDPOINT = 0.5  # muJoCo's default midpoint of the impedance
# Limits of the impedance (assumed). A low one also lets bodies creep against friction.
IMPEDANCE = (0.5, 0.98)
MAX_POWER = 6.0  # largest power of the impedance's curve (assumed)
POINTS = 400  # points of a force curve


class Stiffness(NamedTuple):
    """solref: (2,) and solimp: (5,) as in MuJoCo. error_mm: largest difference between the depths
    of the layer and of MuJoCo at FIT_FORCES_N."""

    solref: np.ndarray
    solimp: np.ndarray
    error_mm: float


def fit_stiffness(
    shape: Shape, elastomer: Elastomer, pitch_mm: float, inverse_mass: float
) -> Stiffness:
    """Parameters for one contact point of a shape on an elastomer, with elliptic friction cones.

    inverse_mass: of the two bodies along the normal, 1/kg. The damping is critical.
    Raises T2TwinError as solve_contact does, and for bodies that cannot move.
    """
    from scipy.optimize import least_squares  # slow to import

    if inverse_mass <= 0:
        raise T2TwinError(f"neither {shape.name} nor the sensor can move; expected a joint")
    forces = np.array(FIT_FORCES_N)
    commands = [PressCommand(shape.name, 0.0, 0.0, 0.0, force) for force in FIT_FORCES_N]
    depths_m = 1e-3 * np.array(
        [solve_contact(shape, command, elastomer, pitch_mm).depth_mm for command in commands]
    )
    width = depths_m[-1]
    grid = np.linspace(0.0, 1.5 * width, POINTS)

    def solved(unknowns: np.ndarray) -> np.ndarray:
        return np.interp(forces, _force_n(grid, unknowns, width, inverse_mass), grid)

    start = forces[-1] * inverse_mass / width, 0.6, 0.5, 2.0
    found = least_squares(
        lambda unknowns: (solved(unknowns) - depths_m) / width,
        [np.log(start[0]), *start[1:]],
        bounds=([-50.0, IMPEDANCE[0], 0.0, 1.0], [50.0, IMPEDANCE[1], 1.0, MAX_POWER]),
        x_scale=[1.0, 0.1, 0.1, 1.0],
    ).x
    log_stiffness, low, _, power = found
    return Stiffness(
        np.array([-np.exp(log_stiffness), -2.0 * np.exp(log_stiffness / 2)]),
        np.array([low, _high(found), width, MIDPOINT, power]),
        float(1e3 * np.abs(solved(found) - depths_m).max()),
    )


def _force_n(
    penetration_m: np.ndarray, unknowns: np.ndarray, width_m: float, inverse_mass: float
) -> np.ndarray:
    """MuJoCo's force at rest, with log of stiffness, impedance, its rise and its power."""
    log_stiffness, low, _, power = unknowns
    high = _high(unknowns)
    share = np.minimum(penetration_m / width_m, 1.0)
    curve = np.where(
        share <= MIDPOINT,
        share**power / MIDPOINT ** (power - 1),
        1 - (1 - share) ** power / (1 - MIDPOINT) ** (power - 1),
    )
    impedance = low + (high - low) * curve
    per_m = np.exp(log_stiffness) * (impedance / high) ** 2 / (1 - impedance)
    return per_m * penetration_m / inverse_mass


def _high(unknowns: np.ndarray) -> float:
    """The impedance at the width."""
    return float(unknowns[1] + unknowns[2] * (IMPEDANCE[1] - unknowns[1]))
