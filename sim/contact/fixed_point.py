"""Fixed-point iteration for the pressure on the pins of one press.

Each step fits the pins' springs to the layer: their rest points take the part of the layer's
response that the springs leave out, w(p) - D p. Which springs are in contact, and how they share
the force, is then solved exactly. The steps are preconditioned and mixed by Anderson acceleration.
After convergence MuJoCo (`t2twin.sim.contact.mujoco_pins`) solves the same springs as a contact
problem; where its result differs, the iteration goes on from there.
"""

import time
from dataclasses import dataclass
from functools import cache

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.elastomer import neo_hookean_mm
from t2twin.sim.contact.grid import Window, relative_window, window_shape
from t2twin.sim.contact.layer import Layer
from t2twin.sim.contact.mujoco_pins import POOL_SIZES, borrowed_pins
from t2twin.sim.contact.pins import Pins
from t2twin.sim.contact.solver_loops import iterate, penetrated, redistribute_force, spring_depth
from t2twin.sim.contact.types import PinState

SPRING_SHARE = 0.8
"""A pin's compliance over the layer's largest. 0.6 to 1 converge equally fast."""

REACHES_MM, GAINS = (0.125, 0.25, 0.5), (2.0, 2.0, 1.0)
"""Distances, mm, over which a pin's step is compared with its neighbors', and the gains on the
differences (`t2twin.sim.contact.solver_loops.precondition`). They nearly halve the number of steps
of the last stage. Reaches below one fine cell are left out. Gains twice as large overshoot."""

MAX_STEPS = 40
"""Limit on full steps; of a thousand contacts six need more than 25."""

DAMPED_STEPS = ((0.3, 60), (0.1, 400))
"""Step sizes that are tried in turn after full steps fail, and the limit on the number of each. Two
in three presses that oscillate converge three times as fast with the larger one."""

MIN_SLOPE, STIFFER_MIN_SLOPE = 0.02, 0.002
"""Least share of a pin's compliance that stiffening leaves, which keeps the springs finite. The
second is for presses that do not converge with the first: where the layer is pressed almost
through, springs so much softer than the layer overshoot back and forth."""

CLEAR_MM = 0.02
"""Distance from the shape, mm, above which MuJoCo does not verify that a pin stays clear of it
(assumed: far more than a converged step changes the depth)."""

GUESSES = 3
"""Rounds in which the springs and their expected contact are adapted to each other."""


@dataclass(frozen=True)
class InitialGuess:
    """Start of an iteration. pressure_mpa: (n,) on the pins. depths_mm: (bodies,)."""

    pressure_mpa: np.ndarray
    depths_mm: np.ndarray


class FixedPoint:
    """State of one press during the iteration.

    pins: of all bodies. forces_n: (bodies,) their normal forces. start: None starts from
    independent springs. verify: whether MuJoCo verifies the converged state; a rough first stage
    does without.

    Attributes:

    - pressure_mpa, (n,), on the covered part of each pin's block;
    - depths_mm, (bodies,), each body's travel from its own first touch;
    - active, (n,) bool, the pins that take part: those at the contact and their neighbors;
    - compiling_s, time spent on compiling MuJoCo models.
    """

    def __init__(
        self, pins: Pins, forces_n: np.ndarray, start: InitialGuess | None, verify: bool
    ) -> None:
        self.pins = pins
        self.forces_n = forces_n
        self.compiling_s = 0.0
        self._verify = verify
        self._min_slope = MIN_SLOPE
        self._spread: tuple[np.ndarray, np.ndarray] | None = None
        self._local, self._rest = np.empty((2, pins.gap_mm.size))
        self._linear_mm = np.empty(window_shape(pins.window), np.float32)
        if start is not None:
            self.pressure_mpa = start.pressure_mpa
            self.depths_mm = start.depths_mm
            self.active = pins.with_neighbors(self.pressure_mpa > 0)
            # else the finer pins of a body do not cover the cells that were loaded
            if all(self.active[part].any() for part in pins.parts):
                self.compliance = self._springs()
                return
        self.active = np.ones(pins.gap_mm.size, bool)
        self.compliance, before = self._springs(), None
        for _ in range(GUESSES):
            if before is not None and (self.compliance == before).all():
                break  # with the same springs, the contact would be the same
            self.depths_mm = np.array(
                [
                    spring_depth(force, pins.gap_mm[part], pins.covered[part])
                    for force, part in zip(self.forces, pins.parts, strict=True)
                ]
            )
            pressed = np.maximum(self.depths_mm[pins.bodies] - pins.gap_mm, 0.0)
            self.active = pins.with_neighbors(pressed > 0)
            self.pressure_mpa = np.where(self.active, pressed, 0.0) / self.compliance[pins.bodies]
            before, self.compliance = self.compliance, self._springs()

    def _springs(self) -> np.ndarray:
        """The springs' compliance D of each body, (bodies,), mm/MPa, for the active pins."""
        pins, active = self.pins, self.active
        return np.array(
            [
                spring_compliance(pins.layer, pins.window_of(pins.around(body, active)))
                * pins.most_overlapping(body, active)
                for body in range(self.forces_n.size)
            ]
        )

    @property
    def depth_mm(self) -> float:
        """The deepest body's depth."""
        return float(self.depths_mm.max())

    @property
    def forces(self) -> np.ndarray:
        """(bodies,) the forces in units of the spring of one fine cell x mm."""
        return self.forces_n * self.compliance / self.pins.cell_mm2

    def fine_pressure_mpa(self) -> np.ndarray:
        """Mean pressure on each fine cell of the window, (rows, columns)."""
        if self.forces_n.size == 1:
            return self.body_pressures_mpa()[0]
        return self.pins.spread(self.pressure_mpa)

    def body_pressures_mpa(self) -> np.ndarray:
        """The same by each body, (bodies, rows, columns)."""
        if self._spread is None or self._spread[0] is not self.pressure_mpa:
            self._spread = self.pressure_mpa, self.pins.spread_each(self.pressure_mpa)
        return self._spread[1]

    def solve(self, tolerance: float) -> bool:
        """Iterate until the pressure changes by less than a tolerance, a share of the force.

        Where full steps oscillate, as in places that are pressed almost through, goes on with
        damped steps and then with stiffer springs. Returns whether the iteration converged.
        """
        if self._solve(tolerance, 1.0, MAX_STEPS):
            return True
        if any(self._solve(tolerance, step, limit) for step, limit in DAMPED_STEPS):
            return True
        self._min_slope = STIFFER_MIN_SLOPE
        return self._solve(tolerance, 1.0, MAX_STEPS)

    def _solve(self, tolerance: float, step: float, steps_left: int) -> bool:
        """Iterate, adding inactive pins that the shape penetrates, until there are none."""
        while True:
            converged, steps, outside = self._iterate(steps_left, tolerance, step)
            steps_left -= steps
            if outside is None:
                return converged
            if steps_left <= 0:
                return False
            self.active |= self.pins.with_neighbors(outside)
            self.pressure_mpa = np.where(self.active, self.pressure_mpa, 0.0)
            self.compliance = self._springs()

    def _iterate(
        self, max_steps: int, tolerance: float, step: float
    ) -> tuple[bool, int, np.ndarray | None]:
        """Iterate on the active pins.

        step: size of the steps, 1 for full ones, which are accelerated. Returns whether it
        converged; the number of steps; and the pins outside, (n,) bool, that the shape penetrates,
        or None if there are none.
        """
        pins, steps = self.pins, 0
        around, operator = _around(pins.layer.pitch_mm), pins.layer.operator(pins.window)
        current, pressure = self.pressure_mpa, np.empty(pins.gap_mm.size)
        while True:
            current, self.depths_mm = current.copy(), self.depths_mm.copy()
            change, more = iterate(
                tolerance, step, max_steps - steps, self._min_slope, pins.arrays, pins.cover,
                self.active, self.forces, self.compliance, pins.stiffens, operator, *around,
                current, pressure, self._local, self._rest, self.depths_mm, self._linear_mm,
            )  # fmt: skip
            steps += more
            self.pressure_mpa, outside = pressure, self._penetrated()
            if self._verify and outside is None:
                change = self._verify_with_mujoco(current, pressure)
            if change < tolerance or steps == max_steps:
                return bool(change < tolerance), steps, outside
            current = pressure

    def is_confirmed(self, tolerance: float) -> bool:
        """Whether MuJoCo finds the pressure of the last step, within a share of the force."""
        depths_mm = self.depths_mm
        change = self._verify_with_mujoco(self.pressure_mpa, np.empty_like(self.pressure_mpa))
        self.depths_mm = depths_mm
        return change < tolerance

    def _verify_with_mujoco(self, current: np.ndarray, pressure: np.ndarray) -> float:
        """Write the pins' pressure by MuJoCo's contact solver, (n,), MPa; set depths_mm.

        Each body is a model of its own. Returns the largest share of a body's force that differs
        from the current pressure, (n,). Raises T2TwinError for more pins than the largest model
        has.
        """
        pins, rest, change = self.pins, self._rest, 0.0
        # A pin that is clear of the shape stays where its spring carries nothing.
        deflection, depths_mm, forces = rest.copy(), self.depths_mm.copy(), self.forces
        for body, part in enumerate(pins.parts):
            gap, area, local = pins.gap_mm[part], pins.covered[part], self._local[part]
            near = np.flatnonzero(depths_mm[body] - gap > rest[part] - CLEAR_MM)
            if near.size > POOL_SIZES[-1]:
                raise T2TwinError(
                    f"the contact covers more than {POOL_SIZES[-1]} grid cells; take a coarser grid"
                )
            stiffness = area[near] * self.compliance[body] / local[near]
            started = time.perf_counter()
            with borrowed_pins(near.size) as model:
                self.compiling_s += time.perf_counter() - started
                depths_mm[body], deflection[part][near] = model.step(
                    gap[near], depths_mm[body], forces[body], rest[part][near], stiffness
                )
            own = redistribute_force(
                deflection[part], rest[part], local, area, current[part], pressure[part]
            )
            change = max(change, own)
        self.depths_mm = depths_mm
        return change

    def _penetrated(self) -> np.ndarray | None:
        """(n,) bool: the inactive pins at which the shape stands above the surface, if any."""
        pins, found = self.pins, np.empty(self.active.size, bool)
        some = penetrated(
            self._linear_mm, pins.stiffens, pins.arrays, pins.cover, self.depths_mm, self.active,
            found,
        )  # fmt: skip
        return found if some else None

    def pin_state(self) -> PinState:
        """The active pins after the last step."""
        pins, active = self.pins, self.active
        x, y = pins.centers_mm()
        height = pins.mean_over_cover(pins.layer.rest_mm[pins.window])
        stiffness = pins.covered * pins.cell_mm2 / self._local
        behind_mm = (self.depth_mm - self.depths_mm)[pins.bodies]
        # A pin that carries nothing stays where its spring rests.
        deflection = self._rest + self._local * self.pressure_mpa
        return PinState(
            x[active],
            y[active],
            height[active],
            (pins.gap_mm + behind_mm)[active],
            deflection[active],
            self._rest[active],
            stiffness[active],
            pins.sides[active] * pins.layer.pitch_mm,
        )

    def fine_surface_mm(self, window: Window) -> np.ndarray:
        """Mean deflection of each fine cell of a window that contains the pins' window, mm."""
        layer = self.pins.layer
        pressure = np.zeros(window_shape(window))
        pressure[relative_window(self.pins.window, window)] = self.fine_pressure_mpa()
        return apply_law(layer, layer.deflection_mm(pressure, window), window)


@cache
def _around(pitch_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """REACHES_MM in cells, and GAINS; without the reaches below one cell."""
    reaches = np.rint(np.array(REACHES_MM) / pitch_mm).astype(int)
    return reaches[reaches > 0], np.array(GAINS)[reaches > 0]


def apply_law(layer: Layer, linear_mm: np.ndarray, window: Window | None = None) -> np.ndarray:
    """Deflection by the elastomer's law from the linear layer's, (rows, columns), mm.

    window: of the layer's grid; None is the whole grid.
    """
    if layer.elastomer.law == "linear":
        return linear_mm
    thickness_mm = layer.thickness_mm if window is None else layer.thickness_mm[window]
    return neo_hookean_mm(linear_mm, thickness_mm)


def spring_compliance(layer: Layer, loaded: Window) -> float:
    """The springs' compliance for a loaded window of a layer's grid, mm/MPa."""
    return SPRING_SHARE * layer.compliance_bound_mm_per_mpa(window_shape(loaded))


def winkler_depth_mm(gap_mm: np.ndarray, force: float) -> float:
    """Depth at which independent unit springs under the gaps carry a force (springs x mm)."""
    gaps = np.ascontiguousarray(gap_mm, np.float64).ravel()
    return spring_depth(force, gaps, np.ones(gaps.size))
