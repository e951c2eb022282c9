"""What a prompt shows of a result is one line, with what it amounts to."""

from dataclasses import replace

import numpy as np
import pytest

import t2twin
from t2twin.sim.touch import Notice


@pytest.fixture(scope="module")
def twin() -> t2twin.Twin:
    return t2twin.Twin()


def test_a_touch_is_its_contacts(twin: t2twin.Twin) -> None:
    touch = twin.press("square-1", force_n=4)
    digit, cyskin = touch.digit, touch.cyskin
    expected = (
        f"force 4 N, depth {digit.depth_mm:.3g} mm, area {digit.contact_area_mm2:.3g} mm2, settled"
    )
    assert repr(digit) == f"Contact('square-1', digit: {expected})"
    assert repr(touch) == f"Touch('square-1', digit: {expected}; cyskin-20: {cyskin.summary})"
    assert str(touch) == repr(touch)
    other = replace(digit, settled=False, bottomed=True)
    assert other.summary.endswith("mm2, not settled, bottomed")
    assert repr(replace(touch, readings={})) == "Touch('square-1', no contact)"
    lacking = replace(touch, notices=(Notice("hand", "a mesh", (0.0, 0.3, 0.4)),))
    assert repr(lacking) == f"{repr(touch)[:-1]}; not read: 0.5 N)"


def test_a_slide_has_its_shear(twin: t2twin.Twin) -> None:
    touches = twin.slide(twin.press("circle-1"), dx_mm=0.5, steps=2)
    shear_n = np.hypot(*touches[-1].digit.shear_n)
    assert f"force 8 N, shear {shear_n:.3g} N, depth" in repr(touches[-1])
    assert "\n" not in repr(touches)


def test_an_estimate_is_its_force(twin: t2twin.Twin) -> None:
    run, image = t2twin.load("field"), twin.press("square-1").image
    one = run.estimate(image)
    force = f"force {one.force_n:.3g} ± {one.force_std_n:.2g} N"
    assert repr(one).startswith(f"Estimate(counts (20,), dense_counts (216,), {force}, shear ")
    several = run.estimate([image, image])
    assert repr(several) == (
        "Estimate(counts (2, 20), dense_counts (2, 216), force (2,) N, shear (2, 2) N)"
    )
    for each in (one, run, run.config, twin.layout, t2twin.load_shape("square-1")):
        assert "\n" not in repr(each) and len(repr(each)) < 600
