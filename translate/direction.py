"""Which way a run goes: from the DIGIT to the CySkin, as the paper's translators, or the other."""

from pathlib import Path
from typing import Literal

from t2twin.primitives_cad import checks
from t2twin.primitives_cad.errors import T2TwinError

Direction = Literal["digit-to-cyskin", "cyskin-to-digit"]

DIGIT_TO_CYSKIN: Direction = "digit-to-cyskin"
CYSKIN_TO_DIGIT: Direction = "cyskin-to-digit"
DIRECTIONS = (DIGIT_TO_CYSKIN, CYSKIN_TO_DIGIT)

TURNS_ROUND = "touch2touch"
"""The model that goes either way: both of its sides are images."""


def check_direction(direction: str, model: str) -> None:
    """Raises T2TwinError for a direction that is none, and for one that the model does not go."""
    if checks.text(direction, "direction") not in DIRECTIONS:
        raise T2TwinError(
            f"the direction is {direction!r}; it must be one of {', '.join(DIRECTIONS)}"
        )
    if direction == CYSKIN_TO_DIGIT and model != TURNS_ROUND:
        raise T2TwinError(
            f"{model} does not go {direction}; {TURNS_ROUND} goes both ways, the other models "
            f"{DIGIT_TO_CYSKIN} only"
        )


def check_gives_counts(run_dir: Path, direction: str) -> None:
    """Raises T2TwinError for a run that draws DIGIT pictures, where counts are asked for."""
    if direction != DIGIT_TO_CYSKIN:
        raise T2TwinError(
            f"{run_dir} is a {direction} run, which draws DIGIT pictures of counts and gives no "
            f"counts; use a {DIGIT_TO_CYSKIN} run here, or t2twin.load(RUN).picture_of(counts)"
        )
