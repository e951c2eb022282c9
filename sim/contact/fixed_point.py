"""One press on its pins, until it has settled.

Each step the pins' springs get rest points that take what the springs leave out of the layer's
answer, w(p) - D p. Which of these springs then touch, and how they share the force, has an exact
solution. Springs answer all waves of a pressure alike, and a layer the short ones less, so that
steps are sharpened; Anderson's acceleration mixes them. Where nothing changes any more, MuJoCo
(`t2twin.sim.contact.mujoco_pins`) judges: its contacts have to give the same, or the steps go on
from there.
"""

import time
from dataclasses import dataclass

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.anderson import Anderson
from t2twin.sim.contact.elastomer import neo_hookean_mm
from t2twin.sim.contact.grid import Window, span, within
from t2twin.sim.contact.layer import Layer
from t2twin.sim.contact.mujoco_pins import POOL_SIZES, borrowed_bed
from t2twin.sim.contact.pins import Pins, spread
from t2twin.sim.contact.solver_loops import (
    carried,
    depth_carrying,
    means_over_cover,
    sharpen,
    springs,
)
from t2twin.sim.contact.types import PinState

SPRING_SHARE = 0.8
"""A pin's compliance over the layer's largest. 0.6 to 1 settle equally fast."""

REACHES_MM, GAINS = (0.125, 0.25, 0.5), (2.0, 2.0, 1.0)
"""How far about a pin, mm, its part of a step is compared with its neighbors', and how much of the
difference is added (`t2twin.sim.contact.solver_loops.sharpen`): nearly half as many last steps as
without. Reaches of less than a fine cell are left out. Gains twice as large overshoot."""

MIN_STEPS = 2
"""Steps at least, so that pins which had been missed are felt before all counts as settled."""

MAX_STEPS = 40
"""Steps after which whole ones are given up; of a thousand contacts six need more than 25."""

SMALLER = ((0.3, 60), (0.1, 400))
"""Shares of a step that are then taken one after the other, and the most steps of each: two in
three that run in circles settle three times as fast with the larger one."""

MIN_SLOPE, STIFFER_LEAST_SLOPE = 0.02, 0.002
"""Least share of a pin's compliance that stiffening leaves: keeps the springs finite. The second is
for presses that do not settle with the first: where the layer is pressed almost through, springs
so much softer than it go past their place and back."""

MISSED_MM = 1e-3
"""How far the shape may stand over a pin that is not in use, mm: what a settled step still
changes."""

GUESSES = 3
"""Rounds in which the springs and the contact they expect are made to fit each other."""


@dataclass(frozen=True)
class InitialGuess:
    """Where a press begins. pressure_mpa: (rows, columns) of the window's fine cells."""

    pressure_mpa: np.ndarray
    depth_mm: float


class Solution:
    """The state of one press while it settles.

    pressure_mpa: (n,) of the pins, on the covered part of each one's block. used: (n,) bool, the
    pins that take part: those about the contact.
    judged: whether MuJoCo has the last word; a rough start does without.
    """

    def __init__(
        self, pins: Pins, force_n: float, start: InitialGuess | None, judged: bool
    ) -> None:
        self.pins = pins
        self.force_n = force_n
        self.compiling_s = 0.0
        self._judged = judged
        self._least_slope = MIN_SLOPE
        if start is not None:
            self.pressure_mpa = pins.gathered(start.pressure_mpa)
            self.depth_mm = start.depth_mm
            self.used = pins.beside(self.pressure_mpa > 0)
            if self.used.any():  # else all was carried where finer pins find nothing to stand on
                self._soften()
                return
        self.used = np.ones(pins.gap_mm.size, bool)
        for _ in range(GUESSES):
            self._soften()
            self.depth_mm = depth_carrying(self.force, pins.gap_mm, pins.covered)
            self.used = pins.beside(pins.gap_mm < self.depth_mm)
        # What the springs carry by themselves.
        pressed = np.maximum(self.depth_mm - pins.gap_mm, 0.0)
        self.pressure_mpa = np.where(self.used, pressed, 0.0) / self.compliance
        self._soften()

    def _soften(self) -> None:
        """Choose the springs' compliance D, mm/MPa, for the pins in use."""
        self.compliance = spring_compliance(self.pins.layer, self.pins.window_of(self.used))

    @property
    def force(self) -> float:
        """The commanded force in springs of a fine cell x mm."""
        return self.force_n * self.compliance / self.pins.cell_mm2

    def fine_pressure_mpa(self) -> np.ndarray:
        """Mean pressure of each fine cell of the window."""
        return self.pins.spread(self.pressure_mpa)

    def solve(self, tolerance: float) -> bool:
        """Iterate until the press has settled; False where it had not after all steps.

        Where whole steps run in circles, as they may about a place that is pressed almost through,
        it goes on in smaller ones, and then with stiffer springs.
        """
        if self._solve(tolerance, 1.0, MAX_STEPS):
            return True
        if any(self._solve(tolerance, step, most) for step, most in SMALLER):
            return True
        self._least_slope = STIFFER_LEAST_SLOPE
        return self._solve(tolerance, 1.0, MAX_STEPS)

    def _solve(self, tolerance: float, step: float, steps_left: int) -> bool:
        while True:
            settled, steps = self._settle(steps_left, tolerance, step)
            steps_left -= steps
            missed = self._missed()
            if not missed.any():
                return settled
            if steps_left <= 0:
                return False
            self.used |= self.pins.beside(missed)
            self.pressure_mpa[~self.used] = 0.0
            self._soften()

    def _settle(self, most_steps: int, tolerance: float, step: float) -> tuple[bool, int]:
        """Iterate on the pins in use: whether it settled, and the steps it took.

        step: how much of each step is taken; whole ones are accelerated.
        """
        pins, used = self.pins, self.used
        places = tuple(of[used] for of in pins.places)
        gap, area, edge = pins.gap_mm[used], pins.covered[used], pins.edge_mm_per_mpa[used]
        surface, slope, local, rest = np.empty((4, gap.size))
        fine = np.empty(span(pins.window), np.float32)
        acceleration = Anderson(gap.size)
        reaches = np.rint(np.array(REACHES_MM) / pins.layer.pitch_mm).astype(int)
        about = reaches[reaches > 0], np.array(GAINS)[reaches > 0]
        sums = np.zeros((fine.shape[0] + 1, fine.shape[1] + 1, 2))
        ahead = self.pressure_mpa[used]
        steps = 0
        while True:
            steps += 1
            spread(ahead, *places, pins.cover, fine)
            self._answers = pins.layer.answers(fine)
            self._feel(places, area, surface, slope)
            self.depth_mm = springs(
                self.force, self.compliance, self._least_slope,
                gap, edge, area, surface, slope, ahead, local, rest,
            )  # fmt: skip
            deflection, pressure = self.depth_mm - gap, np.empty(gap.size)
            change = carried(deflection, rest, local, area, ahead, pressure)
            if steps < MIN_STEPS:  # pins that were missed have not been felt yet
                change = np.inf
            last = change < tolerance or steps == most_steps
            if last and self._judged and not self._missed().any():  # else it goes on with more pins
                deflection = self._judge(gap, rest, area * self.compliance / local)
                change = carried(deflection, rest, local, area, ahead, pressure)
            if change < tolerance or steps == most_steps:
                break
            if step < 1.0:
                ahead = ahead + step * (pressure - ahead)
            else:
                sharpen(pressure, ahead, *places, *about, sums)
                ahead = np.maximum(acceleration.next(ahead, pressure), 0.0)
        self.pressure_mpa[used] = pressure
        self._rest, self._deflection, self._local = rest, deflection, local
        return change < tolerance, steps

    def _feel(
        self,
        places: tuple[np.ndarray, ...],
        covered: np.ndarray,
        surface: np.ndarray,
        slope: np.ndarray,
    ) -> None:
        """Where the surface lies at some pins, (n,), mm, and the law's slope there."""
        pins = self.pins
        means_over_cover(
            self._answers, pins.weights, pins.thickness_mm, pins.stiffens,
            *places, pins.cover, covered, surface, slope,
        )  # fmt: skip

    def _judge(self, gap: np.ndarray, rest: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
        """MuJoCo's word on which pins touch and how far each is pressed, (n,), mm."""
        if gap.size > POOL_SIZES[-1]:
            raise T2TwinError(
                f"the contact covers more than {POOL_SIZES[-1]} grid cells; take a coarser grid"
            )
        asked = time.perf_counter()
        with borrowed_bed(gap.size) as bed:
            self.compiling_s += time.perf_counter() - asked
            bed.lay(gap, self.depth_mm)
            self.depth_mm, deflection = bed.push(self.force, rest, stiffness)
        return deflection

    def _missed(self) -> np.ndarray:
        """Over which pins that are not in use the shape stands in the surface, (n,) bool."""
        pins, missed = self.pins, ~self.used
        surface, slope = np.empty((2, int(missed.sum())))
        self._feel(tuple(of[missed] for of in pins.places), pins.covered[missed], surface, slope)
        missed[missed] = self.depth_mm - pins.gap_mm[missed] > surface + MISSED_MM
        return missed

    def pin_state(self) -> PinState:
        """The pins in use, as the press left them."""
        pins, used = self.pins, self.used
        x, y = pins.places_mm()
        height = pins.mean_over_cover(pins.layer.rest_mm[pins.window])
        stiffness = pins.covered[used] * pins.cell_mm2 / self._local
        return PinState(
            x[used],
            y[used],
            height[used],
            pins.gap_mm[used],
            self._deflection,
            self._rest,
            stiffness,
            pins.sides[used] * pins.layer.pitch_mm,
        )

    def fine_surface_mm(self, window: Window) -> np.ndarray:
        """Mean deflection of each fine cell of a window that holds the pins', mm."""
        layer = self.pins.layer
        pressure = np.zeros(span(window))
        pressure[within(self.pins.window, window)] = self.fine_pressure_mpa()
        return by_law(layer, layer.deflection_mm(pressure, window), window)[0]


def by_law(layer: Layer, linear_mm: np.ndarray, window: Window) -> tuple[np.ndarray, np.ndarray]:
    """Deflection by the elastomer's law from the linear layer's, and its slope."""
    if layer.elastomer.law == "linear":
        return linear_mm, np.ones_like(linear_mm)
    return neo_hookean_mm(linear_mm, layer.thickness_mm[window])


def spring_compliance(layer: Layer, pressed: Window) -> float:
    """The springs' compliance for a pressed part of a layer's grid, mm/MPa."""
    return SPRING_SHARE * layer.largest_compliance_mm_per_mpa(span(pressed))


def winkler_depth_mm(gap_mm: np.ndarray, force: float) -> float:
    """Depth at which independent unit springs under the gaps carry the force (springs x mm)."""
    gaps = np.ascontiguousarray(gap_mm, np.float64).ravel()
    return depth_carrying(force, gaps, np.ones(gaps.size))
