"""How the pages look: names that come from outside, two schemes of colors, narrow screens."""

import re
import xml.etree.ElementTree as ET

import pytest
from matplotlib.figure import Figure

from t2twin.core.draw import figure
from t2twin.core.tables import Table
from t2twin.core.templates import PACKAGE, environment, render
from t2twin.report.page import MAX_NAME, name_of, shape_name

ODD = [
    "$\\foo_{$", "<script>alert(1)</script>", "x" * 200, "触覚 ☃ é", "two\nlines\x07\x1b", "a--b",
]  # fmt: skip
STYLE = (PACKAGE / "report/templates/style.css").read_text()
MACROS = '{% import "report/templates/macros.html" as ui %}'
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


def element(call: str, **values: object) -> str:
    """HTML of a call of a macro."""
    return environment().from_string(f"{MACROS}{{{{ ui.{call} }}}}").render(values)


def test_what_is_wider_than_a_phone_says_so() -> None:
    png = b"\x89PNG"
    wide = [
        element("figure(png, 'alt')", png=png),
        element("table(table)", table=Table(["", *"abcd"], {"": [["row", *"1234"]]})),
    ]
    narrow = [
        element("figure(png, 'alt', width='narrow')", png=png),
        element("table(table)", table=Table(["", *"ab"], {"": [["row", *"12"]]})),
    ]
    assert all('<p class="sideways">Wider than this screen' in one for one in wide)
    assert all('<div class="wide" tabindex="0">' in one for one in wide)
    assert not any("sideways" in one or "tabindex" in one for one in narrow)


@pytest.mark.parametrize("name", ODD)
def test_any_name_can_be_shown(name: str) -> None:
    """As text of the page, and in a chart, which stays one whole file of XML."""
    shown = shape_name(name)
    assert 0 < len(shown) <= MAX_NAME and shown.isprintable()
    assert shape_name(shown) == shown
    assert "<script" not in element("figure(png, name, name)", png=b"\x89PNG", name=name)
    page = render("report/templates/page.html", title=name, links={name: name}, sections={name: ""})
    assert "<script" not in page

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
