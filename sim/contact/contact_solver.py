"""Solves a press: rigid shapes pushed into an elastomer, each with a force.

Contact is normal and frictionless. Two models act together:

- MuJoCo solves the contact (`t2twin.sim.contact.mujoco_contact`): which pins the shape touches, how
  they share the force, and how deep the shape is. Its pins stand on independent springs.
- The elastic layer couples the pins (`t2twin.sim.contact.layer`): a pressure on one place lowers
  the surface everywhere.

A fixed-point iteration joins them. Each step fits the springs to the layer: their rest deflections
take the part of the layer's response that the springs leave out, w(p) - D p. The contact of these
springs gives the next pressure. The steps are preconditioned and mixed by Anderson acceleration.
Most steps solve MuJoCo's equations in closed form (`t2twin.sim.contact.solver_loops`), which takes
a hundredth of the time. When the pressure no longer changes, MuJoCo solves the step; the press has
settled only if MuJoCo's pressure is the same. Else the iteration goes on from MuJoCo's.

The iteration runs on coarse pins and then on fine ones (`t2twin.sim.contact.pin_layout`), and again
with more pins where the shape penetrates the surface outside them.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, cached_property

import numpy as np

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.jit import compile_time_s
from t2twin.primitives_cad.height_map import REACH_MM
from t2twin.primitives_cad.shape import Shape
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.grid import (
    Window,
    block_max,
    block_means,
    center_values,
    expanded,
    refined,
    relative_window,
    window_shape,
)
from t2twin.sim.contact.heights import heights_at, is_cut, place_of_top
from t2twin.sim.contact.layer import cached_layer
from t2twin.sim.contact.mujoco_contact import borrowed_pins
from t2twin.sim.contact.pin_layout import GUESSES, STAGES, OffPadError, PinLayout, Survey
from t2twin.sim.contact.pins import Pins
from t2twin.sim.contact.solver_loops import (
    FAR_MM,
    iterate,
    penetrated,
    redistribute_force,
    spring_depth,
)
from t2twin.sim.contact.types import (
    FORCE_RANGE_N,
    SMALLEST_CONTACT_MM2,
    Contact,
    PinState,
    PressCommand,
    SurfaceShift,
    check_force,
    read_only,
)

BASE_TOLERANCE_MM = 1e-3  # on the height of the base plate's top when it is tested for contact, mm
FINE_CELLS = 2  # survey cells around the pins in which the surface is computed on the fine grid
DEPTH_TOLERANCE_MM = 1e-3  # of the depth, mm: the change in a converged step
FIRST_N, STEP = 1.0, 4.0  # first force of the search for a depth, N, and factor between its steps
MAX_PRESSES = 60  # of one search
# Distances, mm, over which a pin's step is compared with its neighbors', and the gains on the
# differences (`solver_loops.precondition`). They nearly halve the number of steps of the last
# stage. Reaches below one fine cell are left out. Gains twice as large overshoot.
REACHES_MM, GAINS = (0.125, 0.25, 0.5), (2.0, 2.0, 1.0)
MAX_STEPS = 40  # full steps; of a thousand contacts six need more than 25
# Step sizes that are tried in turn after full steps fail, and the limit on the number of each. Two
# in three presses that oscillate converge three times as fast with the larger one.
DAMPED_STEPS = ((0.3, 60), (0.1, 400))
# Least share of a pin's compliance that stiffening leaves, which keeps the springs finite. The
# second is for presses that do not converge with the first: where the layer is pressed almost
# through, springs so much softer than the layer overshoot back and forth.
MIN_SLOPE, STIFFER_MIN_SLOPE = 0.02, 0.002
# Distance from the shape, mm, above which a pin is left out of MuJoCo's model (assumed: far more
# than a converged step changes the depth).
CLEAR_MM = 0.02


def solve_contact(
    shape: Shape,
    command: PressCommand,
    elastomer: Elastomer,
    pitch_mm: float,
    shift: SurfaceShift | None = None,
) -> Contact:
    """The contact of a shape pressed into an elastomer, on a grid of pitch_mm.

    Uses the command's pose and force, not its shape name. shift: of the surface by shear. Safe to
    call from several threads.
    Raises T2TwinError for a force out of range or too large for a linear layer. Raises OffPadError,
    with a position over the pad, for a shape that does not lie over it.
    """
    try:
        return solve_bodies([(shape, command)], elastomer, pitch_mm, shift)
    except OffPadError as error:
        place = f"{error}; for a shape file, --center puts its highest part there"
        surface = command.tilted(shape).surface
        x_mm, y_mm = place_of_top(surface, command.yaw_rad)
        reach_mm = np.hypot(elastomer.width_mm, elastomer.length_mm) / 2
        # Farther out the pad would reach beyond the height map.
        if np.hypot(x_mm, y_mm) < REACH_MM - reach_mm or not is_cut(surface):
            place += f", as do --x-mm {x_mm:.2f} --y-mm {y_mm:.2f}"
        raise OffPadError(place, error.shape) from None


def solve_bodies(
    bodies: Sequence[tuple[Shape, PressCommand]],
    elastomer: Elastomer,
    pitch_mm: float,
    shift: SurfaceShift | None = None,
    start: Contact | None = None,
    slips_mm: np.ndarray | None = None,
    with_mujoco: bool = True,
) -> Contact:
    """The contact of bodies that are pressed at the same time, each with its own force.

    bodies: shapes of different names, with their poses and forces. Where they overlap, they share
    the pressure. shift: as for solve_contact. start: a contact of the same elastomer on the same
    grid, near to which the solution is expected; it is used if it is of the same bodies. slips_mm:
    (bodies, 2) by which each is expected to have moved since, along x and y; None for no motion.
    with_mujoco: whether MuJoCo solves the last steps; False in the rounds of a slide before the
    last one, see Equilibrium.agrees_with_mujoco.
    The shape and the command of the contact are those of the first body, its depths those of the
    deepest one. Raises T2TwinError as solve_contact does.
    """
    for _, command in bodies:
        check_force(command.force_n)
    check_force(sum(command.force_n for _, command in bodies))
    layer = cached_layer(elastomer, pitch_mm)
    started = time.perf_counter() - compile_time_s()
    surveys = [Survey(shape, command, layer, shift) for shape, command in bodies]
    near = None if start is None else start.equilibrium
    if near is not None and near.names != tuple(shape.name for shape, _ in bodies):
        near = near if len(bodies) == len(near.names) == 1 else None
    found = _solve(surveys, near, slips_mm, with_mujoco)
    if elastomer.law == "linear":
        _check_not_through(found)
    shape, command = bodies[0]
    preparing_s = sum(survey.preparing_s for survey in surveys)
    return Contact(
        shape=shape,
        command=command,
        elastomer=elastomer,
        pressure_kpa=read_only((1e3 * found.grid_mpa).astype(np.float32)),
        x_mm=read_only(layer.x_mm),
        y_mm=read_only(layer.y_mm),
        contact_area_mm2=found.area_mm2,
        depth_mm=found.depth_mm,
        shape_depth_mm=float(found.shape_depths_mm.max()),
        force_n=float(found.grid_mpa.sum() * pitch_mm**2),
        settled=found.converged and found.area_mm2 > SMALLEST_CONTACT_MM2,
        bottomed=_bottomed(found),
        milliseconds=1e3 * (time.perf_counter() - compile_time_s() - started - preparing_s),
        equilibrium=found,
        shift=shift,
    )


def force_at_depth(
    press: Callable[[PressCommand], Contact], command: PressCommand, depth_mm: float
) -> float:
    """The force, N, that presses the command's shape depth_mm beyond its first touch.

    press: solves a press into one sensor. The command's own force is not used. Brent's method on
    the logarithm of the force, with which the depth increases.
    Raises T2TwinError for a depth that no force in FORCE_RANGE_N gives, and as `press` does.
    """
    depth_mm = arguments.real(depth_mm, "depth_mm")
    if not (np.isfinite(depth_mm) and depth_mm > 0):
        raise T2TwinError(f"a depth of {depth_mm:g} mm cannot be pressed; it must be above 0")
    from scipy.optimize import root_scalar  # slow to import

    residuals: dict[float, float] = {}

    def residual(log_n: float) -> float:
        """Depth of a force less the wanted depth, mm."""
        if log_n not in residuals:
            if len(residuals) == MAX_PRESSES:
                raise T2TwinError(
                    f"no force was found that gives a depth of {depth_mm:g} mm; take another depth"
                )
            contact = press(replace(command, force_n=_force(log_n)))
            error = contact.depth_mm - depth_mm
            residuals[log_n] = 0.0 if abs(error) < DEPTH_TOLERANCE_MM else error
        return residuals[log_n]

    found = root_scalar(residual, bracket=_bracket(residual, depth_mm), method="brentq", xtol=1e-6)
    return _force(found.root)


def _force(log_n: float) -> float:
    return float(np.clip(np.exp(log_n), *FORCE_RANGE_N))


def _bracket(residual: Callable[[float], float], depth_mm: float) -> tuple[float, float]:
    """Logarithms of a force that is too small and of one that is too large."""
    low, high = np.log(FORCE_RANGE_N)
    current = np.log(FIRST_N)
    direction = -1.0 if residual(current) > 0 else 1.0
    while True:
        following = float(np.clip(current + direction * np.log(STEP), low, high))
        if residual(following) * direction >= 0:
            return min(current, following), max(current, following)
        if following in (low, high):
            side, (least_n, most_n) = "under" if direction < 0 else "over", FORCE_RANGE_N
            raise T2TwinError(
                f"a depth of {depth_mm:g} mm needs a force {side} {_force(following):g} N; allowed "
                f"are {least_n:g} to {most_n:g} N"
            )
        current = following


class Equilibrium:
    """State of a press on the pins of one stage: of a layout, the rough or the last one.

    near: a result from which the iteration starts, with slips_mm as for solve_bodies; None starts
    from independent springs.

    Attributes:

    - pins, of all bodies; forces_n, (bodies,) their normal forces;
    - pressure_mpa, (n,), on the covered part of each pin's block;
    - depths_mm, (bodies,), each body's travel from its own first touch;
    - active, (n,) bool, the pins that take part: those at the contact and their neighbors;
    - converged, whether the iteration did; grid_mpa, (ny, nx) pressure on the contact's grid.
    """

    def __init__(
        self,
        layout: PinLayout,
        last: bool,
        near: "Equilibrium | None",
        with_mujoco: bool,
        slips_mm: np.ndarray | None = None,
    ) -> None:
        self.layout, self.last, self._with_mujoco = layout, last, with_mujoco
        self.pins = pins = layout.stage(last)
        self.forces_n = np.array([each.command.force_n for each in layout.surveys])
        self._min_slope = MIN_SLOPE
        self._spread: tuple[np.ndarray, np.ndarray] | None = None
        self._local, self._rest = np.empty((2, pins.gap_mm.size))
        self._linear_mm = np.empty(window_shape(pins.window), np.float32)
        if near is None or not self._start_near(near, slips_mm):
            self._start_from_springs()
        self.converged = self._iterate()
        survey = layout.surveys[0]
        self.grid_mpa = np.zeros(survey.layer.rest_mm.shape)
        fine_mpa = self.fine_pressure_mpa()
        self.grid_mpa[self._grid_window] = block_means(fine_mpa, pins.layer.per_side)

    def _start_near(self, near: "Equilibrium", slips_mm: np.ndarray | None) -> bool:
        """Start from another result, each body moved by the nearest number of cells; False where
        the pins of a body do not cover the cells that were loaded."""
        pins, pressures = self.pins, near.body_fine_mpa()
        old, new = near.layout.window, self.layout.window
        before, now = (
            each.shape[1] // (rows.stop - rows.start)
            for each, (rows, _) in ((pressures, old), (pins.cover, new))
        )
        if now < before:
            pressures = np.stack([block_means(each, before // now) for each in pressures])
        first = np.array([a.start - b.start for a, b in zip(old, new, strict=True)])
        moves = np.zeros((len(pressures), 2), int)
        if slips_mm is not None:
            moves = np.rint(slips_mm[:, ::-1] / pins.layer.pitch_mm).astype(int)
        self.pressure_mpa = pins.gather(pressures, max(now // before, 1), now * first + moves)
        self.depths_mm = near.depths_mm
        self.active = pins.with_neighbors(self.pressure_mpa > 0)
        if not all(self.active[part].any() for part in pins.parts):
            return False
        self.compliance = self._springs()
        return True

    def _start_from_springs(self) -> None:
        """Start from independent springs, adapted to their own contact."""
        pins = self.pins
        self.active = np.ones(pins.gap_mm.size, bool)
        self.compliance, before = self._springs(), None
        for _ in range(GUESSES):
            if before is not None and (self.compliance == before).all():
                break  # with the same springs, the contact would be the same
            self.depths_mm = np.array(
                [
                    spring_depth(force, pins.gap_mm[part], pins.covered[part])
                    for force, part in zip(self._forces, pins.parts, strict=True)
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
                pins.layer.spring_mm_per_mpa(pins.window_of(pins.around(body, active)))
                * pins.most_overlapping(body, active)
                for body in range(self.forces_n.size)
            ]
        )

    @property
    def _forces(self) -> np.ndarray:
        """(bodies,) the forces in units of the spring of one fine cell x mm."""
        return self.forces_n * self.compliance / self.pins.cell_mm2

    def _iterate(self) -> bool:
        """Full steps, then damped ones, then on stiffer springs; returns whether it converged."""
        tolerance = STAGES[self.last][1]
        if self._steps(tolerance, 1.0, MAX_STEPS):
            return True
        if any(self._steps(tolerance, step, limit) for step, limit in DAMPED_STEPS):
            return True
        self._min_slope = STIFFER_MIN_SLOPE
        return self._steps(tolerance, 1.0, MAX_STEPS)

    def _steps(self, tolerance: float, step: float, steps_left: int) -> bool:
        """Iterate, adding inactive pins that the shape penetrates, until there are none."""
        while True:
            converged, steps, outside = self._steps_on_active(steps_left, tolerance, step)
            steps_left -= steps
            if outside is None:
                return converged
            if steps_left <= 0:
                return False
            self.active |= self.pins.with_neighbors(outside)
            self.pressure_mpa = np.where(self.active, self.pressure_mpa, 0.0)
            self.compliance = self._springs()

    def _steps_on_active(
        self, max_steps: int, tolerance: float, step: float
    ) -> tuple[bool, int, np.ndarray | None]:
        """Iterate on the active pins, with steps of a size, 1 for full ones, which are accelerated.

        Returns whether it converged; the number of steps; and the pins outside, (n,) bool, that the
        shape penetrates, or None if there are none.
        """
        pins, steps, active = self.pins, 0, np.flatnonzero(self.active)
        around, operator = _around(pins.layer.pitch_mm), pins.layer.operator(pins.window)
        of_active = tuple(each[active] for each in pins.arrays)
        ends = np.searchsorted(of_active[0], np.arange(self.forces_n.size + 1))
        current, found = self.pressure_mpa[active], np.empty((3, active.size))
        while True:
            self.depths_mm = self.depths_mm.copy()
            change, more = iterate(
                tolerance, step, max_steps - steps, self._min_slope, of_active, pins.cover, ends,
                self._forces, self.compliance, pins.stiffens, operator, *around, current, *found,
                self.depths_mm, self._linear_mm,
            )  # fmt: skip
            steps += more
            pressure, before = np.zeros((2, pins.gap_mm.size))
            self._local.fill(1.0)
            self._rest.fill(FAR_MM)
            for values, own in zip(
                (before, pressure, self._local, self._rest), (current, *found), strict=True
            ):
                values[active] = own
            self.pressure_mpa, outside = pressure, self._penetrated()
            if self._with_mujoco and outside is None:
                change = self._solve_with_mujoco(before, pressure)
            if change < tolerance or steps == max_steps:
                return bool(change < tolerance), steps, outside
            current = pressure[active]

    def agrees_with_mujoco(self) -> bool:
        """Whether MuJoCo finds the pressure of the last step, if it was solved without MuJoCo."""
        depths_mm = self.depths_mm
        change = self._solve_with_mujoco(self.pressure_mpa, np.empty_like(self.pressure_mpa))
        self.depths_mm = depths_mm
        return change < STAGES[True][1]

    def _solve_with_mujoco(self, current: np.ndarray, pressure: np.ndarray) -> float:
        """MuJoCo's last step: writes the pressure; returns the largest changed share of a force."""
        pins, rest, change = self.pins, self._rest, 0.0
        # A pin that is clear of the shape stays where its spring carries nothing.
        deflection, depths_mm, forces = rest.copy(), self.depths_mm.copy(), self._forces
        for body, part in enumerate(pins.parts):
            gap, area, local = pins.gap_mm[part], pins.covered[part], self._local[part]
            near = np.flatnonzero(depths_mm[body] - gap > rest[part] - CLEAR_MM)
            stiffness = area[near] * self.compliance[body] / local[near]
            started = time.perf_counter()
            with borrowed_pins(near.size) as model:
                self.layout.surveys[0].preparing_s += time.perf_counter() - started
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

    @property
    def names(self) -> tuple[str, ...]:
        """Of the bodies."""
        return tuple(survey.shape.name for survey in self.layout.surveys)

    @property
    def depth_mm(self) -> float:
        """The deepest body's depth."""
        return float(self.depths_mm.max())

    @property
    def shape_depths_mm(self) -> np.ndarray:
        """(bodies,) depth of each body's highest point below the apex."""
        return self.depths_mm + self.pins.first_touch_mm

    @property
    def area_mm2(self) -> float:
        """Area of the shapes in contact."""
        return float(self.pins.covered[self.pressure_mpa > 0].sum() * self.pins.cell_mm2)

    @property
    def _grid_window(self) -> Window:
        """The pins' window on the contact's grid."""
        return refined(self.layout.window, self.layout.surveys[0].per_side)

    @property
    def touching(self) -> list[np.ndarray]:
        """(rows, columns) of each body: the survey's cells that carry its pressure."""
        per_side = self.layout.surveys[0].per_side
        return [block_max(each, per_side) > 0 for each in self.body_pressures_mpa]

    @cached_property
    def body_pressures_mpa(self) -> np.ndarray:
        """(bodies, ny, nx) the pressure of each body on the contact's grid."""
        if len(self.names) == 1:
            return self.grid_mpa[None]
        found = np.zeros((len(self.names), *self.grid_mpa.shape))
        for body, fine in enumerate(self.body_fine_mpa()):
            found[body, *self._grid_window] = block_means(fine, self.pins.layer.per_side)
        return found

    @cached_property
    def moments_mpa_mm(self) -> np.ndarray:
        """(2, ny, nx) mean of pressure times distance from the cell's center, along x and y."""
        layer, fine = self.pins.layer, self.fine_pressure_mpa()
        per_side = layer.per_side
        # The window's first fine cell is the first of a cell.
        down, across = (
            layer.pitch_mm * (np.arange(size) % per_side - (per_side - 1) / 2)
            for size in fine.shape
        )
        found = np.zeros((2, *self.grid_mpa.shape))
        found[:, *self._grid_window] = [
            block_means(fine * mm, per_side) for mm in (across, down[:, None])
        ]
        return found

    def fine_pressure_mpa(self) -> np.ndarray:
        """Mean pressure on each fine cell of the window, (rows, columns)."""
        if self.forces_n.size == 1:
            return self.body_fine_mpa()[0]
        return self.pins.spread(self.pressure_mpa)

    def body_fine_mpa(self) -> np.ndarray:
        """The same by each body, (bodies, rows, columns)."""
        if self._spread is None or self._spread[0] is not self.pressure_mpa:
            self._spread = self.pressure_mpa, self.pins.spread_each(self.pressure_mpa)
        return self._spread[1]

    def pin_state(self) -> PinState:
        """The active pins after the last step."""
        pins, active = self.pins, self.active
        x, y = pins.centers_mm()
        height = pins.mean_over_cover(pins.layer.rest_mm[pins.window])
        behind_mm = (self.depth_mm - self.depths_mm)[pins.bodies]
        return PinState(
            x_mm=x[active],
            y_mm=y[active],
            rest_mm=height[active],
            gap_mm=(pins.gap_mm + behind_mm)[active],
            # A pin that carries nothing stays where its spring rests.
            deflection_mm=(self._rest + self._local * self.pressure_mpa)[active],
            spring_rest_mm=self._rest[active],
            stiffness_n_per_mm=(pins.covered * pins.cell_mm2 / self._local)[active],
            side_mm=pins.sides[active] * pins.layer.pitch_mm,
        )

    def surface_mm(self) -> np.ndarray:
        """The surface's deflection, (ny, nx), mm, computed on the fine grid around the pins."""
        surveys, fine = self.layout.surveys, self.pins.layer
        survey = surveys[0]
        layer, surface = survey.layer, survey.surface_mm(self.grid_mpa)
        window = expanded(self.layout.window, FINE_CELLS, survey.gap_mm.shape)
        near = refined(window, survey.per_side)
        fine_near = refined(near, fine.per_side)
        pressure = np.zeros(window_shape(fine_near))
        pressure[relative_window(self.pins.window, fine_near)] = self.fine_pressure_mpa()
        deflection = fine.by_law_mm(fine.deflection_mm(pressure, fine_near), fine_near)
        surface[near] = center_values(deflection, fine.per_side)
        if survey.per_side == 1:
            # The surface lies on the shape where that touches. A finer grid resolves this by
            # itself, and heights of the solid would give a slanting edge a beaded outline.
            x_mm, y_mm = layer.x_mm[near[1]], layer.y_mm[near[0]]
            for each, depth in zip(surveys, self.shape_depths_mm, strict=True):
                heights = heights_at(each.shape.surface, each.command, x_mm, y_mm, each.shift)
                surface[near] = np.maximum(surface[near], depth + layer.rest_mm[near] + heights)
        return surface


@cache
def _around(pitch_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """REACHES_MM in cells, and GAINS; without the reaches below one cell."""
    reaches = np.rint(np.array(REACHES_MM) / pitch_mm).astype(int)
    return reaches[reaches > 0], np.array(GAINS)[reaches > 0]


def _solve(
    surveys: Sequence[Survey],
    near: Equilibrium | None,
    slips_mm: np.ndarray | None,
    with_mujoco: bool,
) -> Equilibrium:
    """Solves the rough stage, unless a result is near, and the last one, adding missed pins."""
    before = None if near is None else near.layout
    if near is None:
        expected = [survey.expected_contact(survey.command.force_n) for survey in surveys]
        layout = PinLayout(surveys, expected)
        found = Equilibrium(layout, False, None, False)
    else:
        expected = list(zip(near.touching, near.depths_mm, strict=True))
        layout = PinLayout(surveys, expected, before)
        found = Equilibrium(layout, True, near, with_mujoco, slips_mm)
    while True:
        depths_mm = found.depths_mm
        missed = [
            survey.missed(active, depth_mm, found.grid_mpa)
            for survey, active, depth_mm in zip(surveys, layout.active, depths_mm, strict=True)
        ]
        if any(each.any() for each in missed):
            wanted = [cells | more for cells, more in zip(found.touching, missed, strict=True)]
            expected = list(zip(wanted, depths_mm, strict=True))
            layout = PinLayout(surveys, expected, before, layout.active)
        elif found.last:
            return found
        found = Equilibrium(layout, True, found, with_mujoco)


def _check_not_through(found: Equilibrium) -> None:
    """Raises T2TwinError where the surface passes the layer's base, as the linear law allows."""
    layer = found.layout.surveys[0].layer
    elastomer, through = layer.elastomer, found.surface_mm() >= layer.thickness_mm
    if through[found.grid_mpa > 0].any():
        raise T2TwinError(
            f"{found.forces_n.sum():g} N push {' and '.join(found.names)} through the "
            f"{elastomer.name} layer of {elastomer.thickness_mm:g} mm; take a smaller force or a "
            "thicker or stiffer layer"
        )


def _bottomed(found: Equilibrium) -> bool:
    """Whether the base plate of any shape carries pressure."""
    pins, surveys = found.pins, found.layout.surveys
    if all(survey.shape.base_mm is None for survey in surveys):
        return False
    # A height above a level one is compared after its lowest loaded place is found.
    limits = [_base_limit_mm(survey, pins) for survey in surveys]
    heights = pins.heights_mm
    if any(np.ndim(limit) for limit in limits):
        heights = np.stack([mm - limit for mm, limit in zip(heights, limits, strict=True)])
        limits = [0.0] * len(surveys)
    lowest = np.where(found.body_fine_mpa() > 0, heights, np.inf).min(axis=(1, 2))
    return bool((lowest <= limits).any())


def _base_limit_mm(survey: Survey, pins: Pins) -> np.ndarray | float:
    """Largest height of a base plate, mm, on the pins' fine cells; -inf without one."""
    base_mm, (along_x, along_y) = survey.shape.base_mm, survey.shape.base_slope
    if base_mm is None:
        return -np.inf
    limit = base_mm + BASE_TOLERANCE_MM
    if along_x == 0.0 == along_y:
        return limit
    # A tilted one is a plane, whose height differs by its slope within a partly covered cell.
    command, layer, (rows, columns) = survey.command, pins.layer, pins.window
    x, y = layer.x_mm[columns] - command.x_mm, layer.y_mm[rows, None] - command.y_mm
    cos, sin = np.cos(command.yaw_rad), np.sin(command.yaw_rad)
    plane = along_x * (cos * x + sin * y) + along_y * (sin * x - cos * y)
    return limit + plane + layer.pitch_mm * float(np.hypot(along_x, along_y))
