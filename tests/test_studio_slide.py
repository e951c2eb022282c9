"""Slides with friction: in a session, and through the protocol of the page."""

import csv
from dataclasses import astuple
from pathlib import Path

import numpy as np
import pytest

import t2twin
from t2twin.cli import main
from t2twin.core.draw import traction_arrows
from t2twin.core.errors import T2TwinError
from t2twin.sim.slide import MAX_STEP_MM
from t2twin.studio import cards
from t2twin.studio.session import MAX_STEPS, PressState, Session

SHAPE = "hemisphere-4"
STATE = PressState(SHAPE, force_n=4.0, motion="slide", friction=0.6)
NO_TRACTION = [0.0, 0.0]


@pytest.fixture
def session(shape_cache):
    return Session()


def slide(session, state):
    """The results of all parts of a slide."""
    results = [session.press(state)]
    while any(results[-1].remaining):
        results.append(session.press(state))
    return results


@pytest.fixture(scope="module")
def slid(shape_cache):
    """A slide to the right and a turn, then more force."""
    session = Session()
    session.press(STATE)
    slide(session, STATE.with_changes({"x_mm": 1.0, "yaw_deg": 5.0}))
    (result,) = slide(session, STATE.with_changes({"x_mm": 1.0, "yaw_deg": 5.0, "force_n": 6.0}))
    return result


def test_the_path_repeats_the_slide(slid):
    rows = [astuple(row) for row in slid.rows]
    assert len(rows) == 7 and rows[-1] == (1.0, 0.0, 5.0, 6.0)
    touch = t2twin.Twin().follow(SHAPE, rows, friction=0.6)[-1]
    assert np.array_equal(slid.touch.image, touch.image)
    assert np.array_equal(slid.touch.counts, touch.counts)
    assert slid.tangential[-1]["digit"][0] == np.hypot(*touch.digit.shear_n)


def test_the_saved_slide_has_its_path_and_the_command_that_repeats_it(slid, tmp_path, monkeypatch):
    slid.save(tmp_path / "saved")
    monkeypatch.chdir(tmp_path / "saved")
    words = slid.command_line().split()
    assert words[:3] == ["t2twin", "slide", SHAPE]
    main([*words[1:], "--sensor", "digit", "--out", "out"])
    with Path("out/slide.csv").open() as file:
        *_, last = csv.DictReader(file)
    assert float(last["digit_shear_x_n"]) == pytest.approx(slid.touch.digit.shear_n[0], rel=1e-5)


def test_one_call_moves_the_shape_by_few_steps(session):
    session.press(STATE)
    far = STATE.with_changes({"x_mm": (MAX_STEPS + 2) * MAX_STEP_MM})
    first = session.press(far)
    assert any(first.remaining) and first.touch.command.x_mm == pytest.approx(
        MAX_STEPS * MAX_STEP_MM
    )
    assert first.remaining == pytest.approx((far.x_mm - first.touch.command.x_mm, 0.0))
    page = cards.press_html(first, *cards.scales_of(first))
    assert "The slide is behind: 0.4 mm and 0° remain." in page
    back = session.press(STATE.with_changes({"x_mm": MAX_STEP_MM}))  # the target has changed
    assert not any(back.remaining) and back.touch.command.x_mm == MAX_STEP_MM
    places = [row.x_mm for row in back.rows]
    assert places == pytest.approx([0.0, 0.2, 0.4, 0.6, 0.4, 0.2])


def test_a_slide_continues_the_memory(session):
    noisy = STATE.with_changes({"seed": 1, "imperfections": "recorded"})
    first = session.press(noisy).touch
    slid = session.press(noisy.with_changes({"x_mm": 0.2, "force_n": 1.0})).touch
    most = first.counts.argmax()
    assert (slid.of_array.memory[1] > 0.8 * first.of_array.memory[1])[most] and slid.counts[
        most
    ] > 0
    other = session.press(noisy.with_changes({"layout": "cyskin-63", "force_n": 1.0})).touch
    assert other.of_array.memory.shape == (2, 63)


def test_a_jump_has_no_shear(session):
    session.press(STATE)
    assert session.press(STATE.with_changes({"x_mm": 0.2})).touch.digit.shear_n[0] > 0.1
    result = session.press(STATE.with_changes({"x_mm": 0.2, "motion": "jump"}))
    assert not result.has_slid
    for contact in result.touch.contacts.values():
        assert contact.shear_n.tolist() == NO_TRACTION
    page = cards.press_html(result, *cards.scales_of(result))
    assert "traction" not in page and "tangential" not in page


@pytest.mark.parametrize(
    "changes, continues",
    [
        ({"y_mm": 1.0, "yaw_deg": 1.0, "force_n": 5.0}, True),
        ({"layout": "cyskin-63", "markers": True, "seed": 1, "imperfections": "all"}, True),
        ({"shape": "square-2"}, False),
        ({"optics": "other.npz"}, False),
        ({"motion": "jump"}, False),
        ({"depth_mm": 0.5}, False),
    ],
)
def test_what_lifts_the_shape_off(changes, continues):
    assert STATE.with_changes(changes).continues(STATE) == continues


def test_a_depth_is_that_of_the_press_and_its_force_stays(session):
    state = PressState(SHAPE, depth_mm=0.5, motion="slide")
    first = session.press(state)
    result = session.press(state.with_changes({"x_mm": 0.2}))
    assert result.touch.command.force_n == first.touch.command.force_n != 8.0
    assert session.press(state.with_changes({"force_n": 5.0, "x_mm": 0.2})).has_slid


def test_a_slide_off_the_pads_is_refused_and_the_contact_remains(session):
    session.press(STATE)
    before = session.press(STATE.with_changes({"x_mm": 0.2}))
    with pytest.raises(T2TwinError):
        session.press(STATE.with_changes({"x_mm": 60.0}))
    after = session.press(STATE.with_changes({"x_mm": 0.2}))
    assert after.rows == before.rows


def test_another_layout_and_markers_show_the_same_contact(session):
    session.press(STATE)
    state = STATE.with_changes({"x_mm": 0.2})
    first = session.press(state)
    other = session.press(state.with_changes({"layout": "cyskin-63"}))
    assert other.touch.counts.shape == (63,) and other.touch.cyskin is first.touch.cyskin
    marked = session.press(state.with_changes({"markers": True}))
    assert marked.has_slid and not np.array_equal(marked.touch.image, first.touch.image)
    twin = t2twin.Twin(markers=True)
    (touch,) = twin.slide(twin.press(SHAPE, force_n=4.0), dx_mm=0.2, steps=1, friction=0.6)
    assert np.array_equal(marked.touch.image, touch.image)


def test_arrows_show_the_traction(slid):
    contact = slid.touch.digit
    at, along_mm, peak_kpa = traction_arrows(contact, 10)
    assert 0 < contact.slipping[at].sum() < contact.slipping[at].size
    assert np.allclose(
        along_mm / np.hypot(*along_mm).max(),
        contact.shear_kpa[:, *at] / np.hypot(*contact.shear_kpa[:, *at]).max(),
    )
    assert peak_kpa == np.hypot(*contact.shear_kpa).max()
    assert 'data-name="slide"' in cards.press_html(slid, *cards.scales_of(slid))
