"""How figures look."""

from matplotlib.figure import Figure

from t2twin.core.draw import figure


def test_powers_are_numbers() -> None:
    """Dollar signs are no formulas in the figures, also not matplotlib's own on such axes."""

    def draw(page: Figure) -> None:
        page.subplots().set(yscale="log", ylim=(1, 1000))

    chart = figure("svg", 3.0, 2.0, draw)
    assert b"<!-- 100 -->" in chart and b"mathdefault" not in chart
