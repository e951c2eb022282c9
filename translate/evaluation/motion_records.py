"""Records of an evaluation of pairs with motion; see module metrics.motion."""

from dataclasses import dataclass


@dataclass(frozen=True)
class MotionFigures:
    """Figures over still or moving pairs. coverage_percent: of the 90 %
    intervals of the counts, None without uncertainty."""

    pairs: int
    rmse_counts: float
    rmse_percent: float
    coverage_percent: float | None


@dataclass(frozen=True)
class ShearMetrics:
    """Errors of the predicted shear force on the DIGIT.

    pairs: number of moving pairs with a true shear force above min_shear_n, N.
    direction_error_deg, magnitude_error_percent: medians over these pairs, the magnitude's relative
    to the true one; None without such pairs. coverage_percent: of the 90 % intervals of the
    components, over all moving pairs.
    """

    pairs: int
    min_shear_n: float
    direction_error_deg: float | None
    magnitude_error_percent: float | None
    coverage_percent: float
