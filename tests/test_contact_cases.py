"""A difficult shape of the benchmark contact_cases."""

import pytest

from benchmarks.contact import contact_cases
from benchmarks.contact.contact_shapes import make_case
from benchmarks.contact.press import SENSORS

NEEDLES = 142
"""Number of a case of five round needles on the CySkin."""


def test_round_needles_have_the_depth_of_the_reference():
    case, own = make_case(NEEDLES), SENSORS["cyskin"]
    shape, top_mm = case.shape(contact_cases.FINE_MAP_MM)
    command = contact_cases.sample_command(case, NEEDLES)
    contact = contact_cases.press(shape, "cyskin", command)
    coarse, fine = (
        contact_cases.depth_on(
            pad, contact_cases.gaps(pad, case, top_mm, contact.command), contact.command
        )
        for pad in (contact_cases.flat_pad("cyskin", pitch) for pitch in contact_cases.PITCHES_MM)
    )
    assert own.flat.law == "linear" and contact.settled
    assert contact.depth_mm == pytest.approx(2 * fine - coarse, rel=0.02)
