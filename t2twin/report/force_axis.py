"""A logarithmic axis of forces, marked at doublings of a newton."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, NullLocator

BEYOND = 1.15
"""Room at either end, a factor."""


def force_axis(axes: Axes, low_n: float, high_n: float) -> None:
    """Makes x such an axis. low_n, high_n: the outermost forces, above 0 N."""
    axes.set_xscale("log")
    axes.set_xlim(low_n / BEYOND, high_n * BEYOND)
    marks = 2.0 ** np.arange(np.ceil(np.log2(low_n / BEYOND)), np.log2(high_n * BEYOND) + 1e-9)
    axes.xaxis.set_major_locator(FixedLocator(marks.tolist() or [low_n]))
    axes.xaxis.set_minor_locator(NullLocator())
