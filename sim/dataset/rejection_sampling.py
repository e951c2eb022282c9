"""A press that is drawn, and drawn again as long as it touches nothing that was meant."""

from collections.abc import Callable
from dataclasses import dataclass

from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.shape import Shape
from t2twin.sim.contact.pin_layout import OffPadError
from t2twin.sim.sensors import Sample
from t2twin.sim.world.presses import PressSample, attempts_of, sample_press
from t2twin.sim.world.recipe import Part


@dataclass(frozen=True)
class AcceptedPress:
    """What came of a draw. shape: the planned one or its stand-in. sample: None where the press is
    an untouched one. attempt: which draw it was."""

    shape: Shape
    drawn: PressSample
    sample: Sample | None
    attempt: int


def sample_until_contact(
    part: Part,
    shape: Shape,
    number: int,
    press: int,
    seed: tuple[int, ...],
    press_it: Callable[[Shape, PressSample], Sample],
    again: Callable[[str], None],
    first: int = 0,
) -> AcceptedPress:
    """Draws a press of a part until it touches the shape's features and settles.

    shape, number, press, seed: as for presses.sample_press. press_it: presses what was drawn.
    again: told why a draw was refused. first: attempts that need not be made, as none touched.
    Raises T2TwinError where no draw touched.
    """
    planned = shape.name
    for attempt in range(first, attempts_of(part)):
        drawn = sample_press(part, planned, number, press, seed, attempt)
        if drawn.command.shape != shape.name:
            shape = catalogue.load(drawn.command.shape)
        if drawn.is_untouched:
            return AcceptedPress(shape, drawn, None, attempt)
        try:
            sample = press_it(shape, drawn)
        except OffPadError:
            again("beside the pad")
            continue
        why = why_again(sample)
        if why is None:
            return AcceptedPress(shape, drawn, sample, attempt)
        again(why)
    raise T2TwinError(
        f"{planned} could not be touched in {attempts_of(part)} draws; take places nearer to the "
        "shapes' middles"
    )


def why_again(sample: Sample) -> str | None:
    """Why a press that was drawn is drawn again, None where it is as it was meant."""
    contacts = (sample.digit, sample.cyskin)
    if any(contact.bottomed for contact in contacts):
        return "on the base plate"
    return None if all(contact.settled for contact in contacts) else "not settled"
