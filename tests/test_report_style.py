"""How the pages look: names that come from outside, two schemes of colors, narrow screens."""

import re
import xml.etree.ElementTree as ET

import pytest
from matplotlib.figure import Figure

from t2twin.report.html import markup
from t2twin.report.html.figures import figure
from t2twin.report.html.labels import MAX_NAME, name_of, shape_name
from t2twin.report.html.style import STYLE

ODD = [
    "$\\foo_{$", "<script>alert(1)</script>", "x" * 200, "触覚 ☃ é", "two\nlines\x07\x1b", "a--b",
]  # fmt: skip
MIN_CONTRAST = 4.5
"""Of text to its ground (WCAG 2.1, 1.4.3)."""


def scheme(dark: bool) -> dict[str, str]:
    """The colors by name; what the dark one does not name is as by day."""
    roots = re.findall(r":root \{(.*?)\}", STYLE, re.DOTALL)
    day, night = (dict(re.findall(r"(--\w+): (#\w+)", root)) for root in roots[:2])
    return day | night if dark else day


def luminance(color: str) -> float:
    """Relative luminance of #rgb or #rrggbb (WCAG 2.1)."""
    digits = color[1:] if len(color) == 7 else "".join(2 * digit for digit in color[1:])
    parts = [int(digits[i : i + 2], 16) / 255 for i in (0, 2, 4)]
    linear = [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize("dark", [False, True])
def test_text_is_legible_by_day_and_by_night(dark: bool) -> None:
    colors = scheme(dark)
    ground = luminance(colors["--paper"])
    assert (ground < 0.05) is dark
    for name in ("--ink", "--soft", "--pale", "--link"):
        low, high = sorted((ground, luminance(colors[name])))
        assert (high + 0.05) / (low + 0.05) >= MIN_CONTRAST, name
    assert luminance(colors["--card"]) > 0.8  # pictures are drawn for a light ground


def test_every_color_belongs_to_a_scheme() -> None:
    rest = re.sub(r":root \{.*?\}", "", STYLE, flags=re.DOTALL)
    assert not re.findall(r"#[0-9a-f]{3}", rest)


def test_what_is_wider_than_a_phone_says_so() -> None:
    heads = [[("", 1), ("a", 1), ("b", 1), ("c", 1), ("d", 1)]]
    wide = [markup.embed(b"", "png", "alt"), markup.table(heads, [("", [["row", *"1234"]])])]
    narrow = [
        markup.embed(b"", "png", "alt", width="narrow"),
        markup.table([heads[0][:3]], [("", [["row", "1", "2"]])]),
        markup.facts([("a", "b")]),
    ]
    assert all(f'<p class="sideways">{markup.SIDEWAYS}</p><div class="wide"' in one for one in wide)
    assert not any("sideways" in one for one in narrow)


@pytest.mark.parametrize("name", ODD)
def test_any_name_can_be_shown(name: str) -> None:
    """As text of the page, and in a chart, which stays one whole file of XML."""
    shown = shape_name(name)
    assert 0 < len(shown) <= MAX_NAME and shown.isprintable()
    assert shape_name(shown) == shown
    assert "<script" not in markup.paragraph(name) + markup.embed(b"", "png", name, name)

    def draw(page: Figure) -> None:
        page.subplots().set_yticks([0], [shown])

    chart = figure("svg", 3.0, 2.0, draw)
    assert ET.fromstring(chart).tag.endswith("svg")


def test_long_names_keep_both_ends() -> None:
    assert shape_name("scissors/blade-back") == "scissors/blade-back"
    shown = shape_name("a-very-long-name-of-a-shape-7")
    assert shown.startswith("a-very-long") and shown.endswith("hape-7") and "…" in shown
    assert name_of("resnet18 (my\nrun)") == "ResNet18 (my run)"


def test_powers_are_numbers() -> None:
    """Dollar signs are no formulas in the figures, also not matplotlib's own on such axes."""

    def draw(page: Figure) -> None:
        page.subplots().set(yscale="log", ylim=(1, 1000))

    chart = figure("svg", 3.0, 2.0, draw)
    assert b"<!-- 100 -->" in chart and b"mathdefault" not in chart
