"""How the pages look: names that come from outside, narrow screens."""

from matplotlib.figure import Figure

from t2twin.core.draw import figure
from t2twin.core.tables import Table
from t2twin.core.templates import environment
from t2twin.report.page import name_of, shape_name

MACROS = '{% import "report/templates/macros.html" as ui %}'


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


def test_long_names_keep_both_ends() -> None:
    shown = shape_name("a-very-long-name-of-a-shape-7")
    assert shown.startswith("a-very-long") and shown.endswith("hape-7") and "…" in shown
    assert name_of("resnet18 (my\nrun)") == "ResNet18 (my run)"


def test_powers_are_numbers() -> None:
    """Dollar signs are no formulas in the figures, also not matplotlib's own on such axes."""

    def draw(page: Figure) -> None:
        page.subplots().set(yscale="log", ylim=(1, 1000))

    chart = figure("svg", 3.0, 2.0, draw)
    assert b"<!-- 100 -->" in chart and b"mathdefault" not in chart
