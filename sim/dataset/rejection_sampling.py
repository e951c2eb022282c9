"""Rejection sampling of presses: attempts are rejected until one touches the shape and settles."""

from collections import Counter
from collections.abc import Callable, Iterable

from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.shape import Shape
from t2twin.sim.contact.pin_layout import OffPadError
from t2twin.sim.touch import Touch
from t2twin.sim.world.presses import PressSample

Press = Callable[[Shape, PressSample], list[Touch]]
"""Makes a press and the touches of its path; the last one is rejected, or none."""


def press_until_accepted(
    attempts: Iterable[PressSample], shape: Shape, press: Press, rejected: Counter[str]
) -> tuple[list[Touch], int]:
    """The touches of the first accepted attempt at a path, and its number.

    attempts: from presses.path_attempts. shape: the planned one. rejected: counts the rejected
    attempts by reason. A press on the grid is not sampled: it may bottom out, and must settle.
    Raises T2TwinError where no attempt is accepted.
    """
    planned = shape.name
    for sample in attempts:
        if sample.command.shape != shape.name:
            shape = catalogue.load(sample.command.shape)
        if sample.attempt is None:
            touches = press(shape, sample)
            if not all(contact.settled for contact in touches[0].contacts.values()):
                raise T2TwinError(
                    f"press {sample.index} of {planned} did not settle; use another grid"
                )
            return touches, 0
        try:
            touches = press(shape, sample)
        except OffPadError:
            reason = "off the pad"
        else:
            reason = rejection_reason(touches[-1])
            if reason is None:
                return touches, sample.attempt
        rejected[reason] += 1
    raise T2TwinError(
        f"no attempt at a press touched {planned}; use places nearer to the middle of the shapes, "
        "or center = true in a part of files"
    )


def rejection_reason(touch: Touch) -> str | None:
    """Why a sampled press is rejected, None for an accepted one, such as a press of 0 N."""
    contacts = touch.contacts.values()
    if any(contact.bottomed for contact in contacts):
        return "on the base plate"
    return None if all(contact.settled for contact in contacts) else "not settled"
