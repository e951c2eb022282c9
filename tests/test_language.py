"""Product code has none of the former private words; see tests/language.py."""

import pytest
from language import ALLOWED, in_text, places


def test_product_code_has_no_private_words():
    found = [str(place) for place in places()]
    assert not found, "\n".join([*found[:40], f"{len(found)} places; python -m tests.language"])


def test_few_places_are_allowed():
    assert len(ALLOWED) <= 20
    assert all(each.token and each.reason for each in ALLOWED)


@pytest.mark.parametrize(
    "text, words",
    [
        ("def _told(self): ...", ["told"]),
        ("toldAgain = ToldAgain", ["told", "told"]),
        ("MOST_SHAPES = 3  # what ships", ["ships", "MOST_SHAPES"]),
        ('"""A pair,\nof which one is new."""', ["of which"]),
        ("class Made: pass", ["Made"]),
        ("More = 1  # Made of More", ["More"]),
        ("made = 'a relationship of skin, traded'", []),
        ("share = untouched_share", []),
    ],
)
def test_words_are_found_in_names_and_text(text, words):
    assert [place.word for place in in_text(text, "t2twin/a.py")] == words


def test_drawn_is_a_plot_only_where_plots_are_made():
    assert not [*in_text("a bar is drawn", "t2twin/report/page.py")]
    assert [place.word for place in in_text("is drawn", "sim/a.py")] == ["drawn"]
    assert [place.word for place in in_text("", "sim/teller.py")] == ["teller"]
