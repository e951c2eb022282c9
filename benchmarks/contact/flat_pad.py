"""The oracle's solutions on a sensor's flat pad, restricted to the pad of the contact solver.

A shape that is longer than the pad presses on the pad only: the contact solver has pins only there,
and continues the layer without load. The oracle's cells therefore cover the same pad. Outside the
pad both have no pressure, and the deflections are those of an unbounded layer.
"""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import RectBivariateSpline
from scipy.special import j1

from benchmarks.contact import oracle
from benchmarks.contact.oracle import Answer, Waves, deflection_under, kernel
from t2twin.core.cache_dir import cached_array
from t2twin.primitives_cad.shape import Shape
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.types import PressCommand
from t2twin.sim.taxels.layout import Layout

DEEPEST_MM = 10.0
"""How far below a shape's top it is still looked at, mm: deeper than every layer."""

BASE_REACH_MM = 40.0
"""Half the square on which the stress at the base is worked out, mm: it repeats itself beyond, so
the pad's ends are kept far from each other's."""

TOLERANCE = 1e-5
"""Change of the pressure in an iteration, as a share of it, below which the oracle has ended."""


@dataclass(frozen=True)
class FlatPad:
    """A flat, linear layer on square cells of pitch_mm that cover width_mm x length_mm."""

    elastomer: Elastomer
    width_mm: float
    length_mm: float
    pitch_mm: float

    @property
    def x_mm(self) -> np.ndarray:
        return _centers(self.width_mm, self.pitch_mm)

    @property
    def y_mm(self) -> np.ndarray:
        return _centers(self.length_mm, self.pitch_mm)

    @cached_property
    def answer_of_cell(self) -> np.ndarray:
        """What `oracle.kernel` gives for the pad's cells."""
        layer = self.elastomer
        return kernel(
            self.y_mm.size,
            self.x_mm.size,
            self.pitch_mm,
            layer.thickness_mm,
            layer.young_mpa,
            layer.poisson,
        )

    @cached_property
    def deflection(self) -> Callable[[np.ndarray], np.ndarray]:
        """`oracle.deflection_under` of the whole pad."""
        return deflection_under(self.answer_of_cell)

    def press(self, shape: Shape, command: PressCommand, start: Answer | None = None) -> Answer:
        """The oracle's answer to a press at the pad's middle, on the pad's cells.

        start: the answer on cells of twice this pitch.
        """
        x, y = np.meshgrid(self.x_mm, self.y_mm)
        cos, sin = np.cos(command.yaw_rad), np.sin(command.yaw_rad)
        heights = shape.surface.sample(cos * x + sin * y, sin * x - cos * y)
        gap_mm = np.minimum(heights.max() - heights, DEEPEST_MM)
        pressure = self.pressure_mpa(
            gap_mm, command.force_n, None if start is None else start.pressure_mpa
        )
        return self.answer(gap_mm, pressure)

    def answer(self, gap_mm: np.ndarray, pressure_mpa: np.ndarray) -> Answer:
        """Depth and deflections under a pressure. gap_mm: distance of the shape from each cell at
        first touch."""
        deflection_mm = self.deflection(pressure_mpa)
        depth_mm = float((deflection_mm + gap_mm)[pressure_mpa > 0].mean())
        return Answer(depth_mm, pressure_mpa, deflection_mm)

    def pressure_mpa(
        self, gap_mm: np.ndarray, force_n: float, start_mpa: np.ndarray | None = None
    ) -> np.ndarray:
        """The oracle's pressure on the pad's cells, cached on disk.

        start_mpa: a pressure near it, on cells of twice this pitch.
        """
        window = self.touchable(gap_mm)
        down, across = gap_mm[window].shape
        row, column = self.y_mm.size - 1, self.x_mm.size - 1
        near = self.answer_of_cell[
            row - down + 1 : row + down, column - across + 1 : column + across
        ]

        def solve() -> np.ndarray:
            start = None if start_mpa is None else np.kron(start_mpa, np.ones((2, 2)))[window]
            return oracle.solve(
                gap_mm[window], force_n, self.pitch_mm, near, TOLERANCE, start=start
            ).pressure_mpa

        pressure, key = np.zeros(gap_mm.shape), self.key(gap_mm[window], force_n)
        name = f"references-{self.pitch_mm:.4f}"
        pressure[window] = cached_array(name, key, oracle.__file__, solve)
        return pressure

    def touchable(self, gap_mm: np.ndarray) -> tuple[slice, slice]:
        """The window of cells that a shape can touch before it meets the base."""
        rows, columns = np.nonzero(gap_mm <= self.elastomer.thickness_mm)
        return slice(rows.min(), rows.max() + 1), slice(columns.min(), columns.max() + 1)

    def key(self, gap_mm: np.ndarray, force_n: float) -> str:
        """Key of a cached solution."""
        content = hashlib.sha256(np.ascontiguousarray(gap_mm).tobytes()).hexdigest()
        return repr((content, force_n, self.pitch_mm, self.elastomer, TOLERANCE))

    def pad_pressure_mpa(self, pressure_mpa: np.ndarray, layout: Layout) -> np.ndarray:
        """Mean stress at the base on each taxel's pad, (n,) MPa, under a pressure on the cells."""
        axis = _centers(2 * BASE_REACH_MM, self.pitch_mm)
        wide = np.zeros((axis.size, axis.size))
        rows, columns = ((axis.size - side) // 2 for side in pressure_mpa.shape)
        height, width = pressure_mpa.shape
        wide[rows : rows + height, columns : columns + width] = pressure_mpa
        base = 2 * np.pi * np.fft.fftfreq(axis.size, self.pitch_mm)
        wavenumber = np.hypot(base[None, :], base[:, None])
        reach = np.maximum(wavenumber * float(layout.pad_diameter_mm[0]) / 2, 1e-9)
        layer = self.elastomer
        waves = Waves(layer.thickness_mm, layer.young_mpa, layer.poisson)
        through = waves.base_stress(wavenumber) * 2 * j1(reach) / reach
        means = np.fft.ifft2(np.fft.fft2(wide) * through).real
        return RectBivariateSpline(axis, axis, means)(layout.y_mm, layout.x_mm, grid=False)


def _centers(length_mm: float, pitch_mm: float) -> np.ndarray:
    """Centres of the cells that cover a length about zero, mm."""
    cells = round(length_mm / pitch_mm)
    return (np.arange(cells) - (cells - 1) / 2) * pitch_mm
