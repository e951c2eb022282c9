"""Names of columns: misspelt ones are refused, with the name that was meant."""

import pytest

from t2twin.core.errors import T2TwinError
from t2twin.core.records import check_names, nearest

KNOWN = ("file", "force_n", "depth_mm", "ball_diameter_mm")


@pytest.mark.parametrize(
    "name, meant",
    [
        ("froce_n", "force_n"), ("force", "force_n"), (" Force (N)", "force_n"),
        ("depth_um", "depth_mm"), ("ball_diamter_mm", "ball_diameter_mm"), ("note", None),
    ],
)  # fmt: skip
def test_a_misspelt_name_is_near_the_right_one(name, meant):
    assert nearest(name, KNOWN) == meant
    words = f"did you mean {meant}" if meant else "expected file, force_n"
    with pytest.raises(T2TwinError, match=words):
        check_names(["file", name], KNOWN, "forces.csv")


def test_a_column_twice_is_refused():
    with pytest.raises(T2TwinError, match="two columns note"):
        check_names(["file", "note", "note"], KNOWN, "pairs.csv", others=True)


def test_others_may_be_allowed_but_no_misspelt_ones():
    check_names(["file", "note", "z_mm"], KNOWN, "pairs.csv", others=True)
    with pytest.raises(T2TwinError, match=r"has a key 'depht_mm', .* did you mean depth_mm"):
        check_names(["depht_mm"], KNOWN, "a taxel", others=True, what="key")
