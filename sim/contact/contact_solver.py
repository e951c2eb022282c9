"""Solves a press: rigid shapes pushed into an elastomer, each with a force.

Normal and frictionless; docs/explanation/contact.md describes the iteration of MuJoCo's springs and
the elastic layer.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, cached_property

import numpy as np

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.jit import compile_time_s
from t2twin.primitives_cad.catalogue import load
from t2twin.primitives_cad.height_map import REACH_MM
from t2twin.primitives_cad.shape import Shape
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.grid import (
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
from t2twin.sim.contact.solver_loops import (
    FAR_MM,
    iterate,
    iterate_work,
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
)

BASE_TOLERANCE_MM = 1e-3  # on the height of the base plate's top when it is tested for contact, mm
FINE_CELLS = 2  # survey cells around the pins in which the surface is computed on the fine grid
DEPTH_TOLERANCE_MM = 1e-3  # of the depth, mm: the change in a converged step
FIRST_N, STEP = 1.0, 4.0  # first force of the search for a depth, N, and factor between its steps
# Distances, mm, over which a pin's step is compared with its neighbors', and the gains on the
# differences (`solver_loops.precondition`). They nearly halve the number of steps of the last
# stage. Reaches below one fine cell are left out. Gains twice as large overshoot.
REACHES_MM, GAINS = (0.125, 0.25, 0.5), (2.0, 2.0, 1.0)
# Attempts to converge in turn, each with the least share of a pin's compliance that stiffening
# leaves, which keeps the springs finite, with the size of the steps and a limit on their number. Of
# a thousand contacts six need more than 25 full steps. Two in three presses that oscillate converge
# three times as fast with steps of 0.3 as with 0.1. The last springs are for a layer that is
# pressed almost through: springs so much softer than the layer overshoot back and forth.
ATTEMPTS = ((0.02, 1.0, 40), (0.02, 0.3, 60), (0.02, 0.1, 400), (0.002, 1.0, 40))
# Distance from the shape, mm, above which a pin is left out of MuJoCo's model (assumed: far more
# than a converged step changes the depth).
CLEAR_MM = 0.02


@cache
def _around(pitch_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """REACHES_MM in fine cells of a pitch, and their gains."""
    reaches = np.rint(np.array(REACHES_MM) / pitch_mm).astype(int)
    return reaches[reaches > 0], np.array(GAINS)[reaches > 0]


def solve_contact(
    shape: Shape, command: PressCommand, elastomer: Elastomer, pitch_mm: float,
    shift: SurfaceShift | None = None,
) -> Contact:  # fmt: skip
    """The contact of a shape pressed into an elastomer, on a grid of pitch_mm.

    shift: of the surface by shear. Safe to call from several threads.
    Raises T2TwinError for a force out of range or too large for a linear layer. Raises OffPadError,
    with a position over the pad, for a shape that does not lie over it.
    """
    try:
        return solve_bodies([(shape, command)], elastomer, pitch_mm, shift)
    except OffPadError as error:
        place = f"{error}; for a shape file, the option center puts its highest part there"
        surface = command.tilted(shape).surface
        x_mm, y_mm = place_of_top(surface, command.yaw_rad)
        reach_mm = np.hypot(elastomer.width_mm, elastomer.length_mm) / 2
        # Farther out the pad would reach beyond the height map.
        if np.hypot(x_mm, y_mm) < REACH_MM - reach_mm or not is_cut(surface):
            place += f", as do x_mm {x_mm:.2f} and y_mm {y_mm:.2f}"
        raise OffPadError(place, error.shape) from None


def solve_bodies(
    bodies: Sequence[tuple[Shape, PressCommand]], elastomer: Elastomer, pitch_mm: float, shift:
    SurfaceShift | None = None, start: Contact | None = None, slips_mm: np.ndarray | None = None,
    with_mujoco: bool = True,
) -> Contact:  # fmt: skip
    """The contact of bodies that are pressed at the same time, each with its own force.

    bodies: shapes of different names, with their poses and forces. Where they overlap, they share
    the pressure. start: a contact on the same grid near to the solution, used if it is of the same
    bodies. slips_mm: (bodies, 2) by which each is expected to have moved since, along x and y.
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
        through = found.surface_mm() >= layer.thickness_mm
        if through[found.grid_mpa > 0].any():
            raise T2TwinError(
                f"{found.forces_n.sum():g} N push {' and '.join(found.names)} through the "
                f"{elastomer.name} layer of {elastomer.thickness_mm:g} mm; take a smaller force or "
                "a thicker or stiffer layer"
            )
    area_mm2 = float(found.pins.covered[found.pressure_mpa > 0].sum() * found.pins.cell_mm2)
    shape, command = bodies[0]
    preparing_s = sum(survey.preparing_s for survey in surveys)
    return Contact(
        shape=shape,
        command=command,
        elastomer=elastomer,
        pressure_kpa=(1e3 * found.grid_mpa).astype(np.float32),
        x_mm=layer.x_mm,
        y_mm=layer.y_mm,
        contact_area_mm2=area_mm2,
        depth_mm=float(found.depths_mm.max()),
        shape_depth_mm=float(found.shape_depths_mm.max()),
        force_n=float(found.grid_mpa.sum() * pitch_mm**2),
        settled=found.converged and area_mm2 > SMALLEST_CONTACT_MM2,
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

    def force_n(log_n: float) -> float:
        return float(np.clip(np.exp(log_n), *FORCE_RANGE_N))

    @cache
    def residual(log_n: float) -> float:
        """Depth of a force less the wanted depth, mm."""
        error = press(replace(command, force_n=force_n(log_n))).depth_mm - depth_mm
        return 0.0 if abs(error) < DEPTH_TOLERANCE_MM else error

    low, high = np.log(FORCE_RANGE_N)
    current = np.log(FIRST_N)
    direction = -1.0 if residual(current) > 0 else 1.0
    while True:
        following = float(np.clip(current + direction * np.log(STEP), low, high))
        if residual(following) * direction >= 0:
            bracket = min(current, following), max(current, following)
            return force_n(root_scalar(residual, bracket=bracket, method="brentq", xtol=1e-6).root)
        if following in (low, high):
            side, (least_n, most_n) = "under" if direction < 0 else "over", FORCE_RANGE_N
            raise T2TwinError(
                f"a depth of {depth_mm:g} mm needs a force {side} {force_n(following):g} N; "
                f"allowed are {least_n:g} to {most_n:g} N"
            )
        current = following


class Equilibrium:
    """State of a press on the pins of one stage: of a layout, the rough or the last one.

    near: a result from which the iteration starts; None starts from independent springs.
    """

    def __init__(
        self, layout: PinLayout, last: bool, near: "Equilibrium | None", with_mujoco: bool,
        slips_mm: np.ndarray | None = None,
    ) -> None:  # fmt: skip
        self.layout, self.last, self._with_mujoco = layout, last, with_mujoco
        self.pins = pins = layout.stage(last)  # of all bodies
        self.forces_n = np.array([each.command.force_n for each in layout.surveys])
        self.pressure_mpa: np.ndarray  # (n,), on the covered part of each pin's block
        self.depths_mm: np.ndarray  # (bodies,), each body's travel from its own first touch
        self.active: np.ndarray  # (n,) bool, the pins at the contact and their neighbors
        self._local, self._rest = np.empty((2, pins.gap_mm.size))
        self._linear_mm = np.empty(window_shape(pins.window), np.float32)
        if near is None or not self._start_near(near, slips_mm):
            self._start_from_springs()
        self.converged = any(self._iterate(*attempt) for attempt in ATTEMPTS)
        survey = layout.surveys[0]
        self.grid_mpa = np.zeros(survey.layer.rest_mm.shape)  # (ny, nx) on the contact's grid
        self._grid_window = refined(layout.window, survey.per_side)
        self.grid_mpa[self._grid_window] = block_means(self.fine_mpa, pins.layer.per_side)

    def _start_near(self, near: "Equilibrium", slips_mm: np.ndarray | None) -> bool:
        """Start from another result, each body moved by the nearest number of cells; False where
        the pins of a body do not cover the cells that were loaded."""
        pins, pressures = self.pins, near.body_fine_mpa
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
        if not self._with_mujoco:  # most contacts grow in a round of a step
            self.active = pins.with_neighbors(self.active)
        if not all(self.active[part].any() for part in pins.parts):
            return False
        self.compliance = pins.springs(self.active)
        return True

    def _start_from_springs(self) -> None:
        """Start from independent springs, adapted to their own contact."""
        pins = self.pins
        self.active = np.ones(pins.gap_mm.size, bool)
        self.compliance, before = pins.springs(self.active), None
        for _ in range(GUESSES):
            if before is not None and (self.compliance == before).all():
                break  # with the same springs, the contact would be the same
            self.depths_mm = np.array(
                [
                    spring_depth(force, pins.gap_mm[part], pins.covered[part], np.inf)
                    for force, part in zip(self._forces, pins.parts, strict=True)
                ]
            )
            pressed = np.maximum(self.depths_mm[pins.bodies] - pins.gap_mm, 0.0)
            self.active = pins.with_neighbors(pressed > 0)
            self.pressure_mpa = np.where(self.active, pressed, 0.0) / self.compliance[pins.bodies]
            before, self.compliance = self.compliance, pins.springs(self.active)

    @property
    def _forces(self) -> np.ndarray:
        """(bodies,) the forces in units of the spring of one fine cell x mm."""
        return self.forces_n * self.compliance / self.pins.cell_mm2

    def _iterate(self, min_slope: float, step: float, steps_left: int) -> bool:
        """Iterate, adding inactive pins that the shape penetrates; returns whether it converged."""
        pins, tolerance, outside = self.pins, STAGES[self.last][1], np.empty(self.active.size, bool)
        operator, around = pins.layer.operator(pins.window), _around(pins.layer.pitch_mm)
        while True:
            active, is_missed = np.flatnonzero(self.active), False
            of_active = tuple(each.take(active, mode="clip") for each in pins.arrays)
            ends = np.searchsorted(of_active[0], np.arange(self.forces_n.size + 1))
            found = np.empty((3, active.size))
            while not is_missed:
                current, self.depths_mm = self.pressure_mpa[active], self.depths_mm.copy()
                work = iterate_work(operator[-1], active.size)
                change, steps = iterate(
                    tolerance, step, steps_left, min_slope, of_active, pins.cover, ends,
                    self._forces, self.compliance, pins.stiffens, operator, *around, work, current,
                    *found, self.depths_mm, self._linear_mm,
                )  # fmt: skip
                steps_left -= steps
                self.pressure_mpa, before = np.zeros((2, pins.gap_mm.size))
                self._local.fill(1.0)
                self._rest.fill(FAR_MM)
                of_all = before, self.pressure_mpa, self._local, self._rest
                for values, own in zip(of_all, (current, *found), strict=True):
                    values[active] = own
                is_missed = penetrated(
                    self._linear_mm, pins.stiffens, pins.arrays, pins.cover, self.depths_mm,
                    self.active, outside,
                )  # fmt: skip
                if self._with_mujoco and not is_missed:
                    change = self._solve_with_mujoco(before, self.pressure_mpa)
                if change < tolerance and not is_missed:
                    return True
                if steps_left <= 0:
                    return False
            self.active |= pins.with_neighbors(outside)
            self.compliance = pins.springs(self.active)

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

    @property
    def names(self) -> tuple[str, ...]:
        """Of the bodies."""
        return tuple(survey.shape.name for survey in self.layout.surveys)

    @property
    def shape_depths_mm(self) -> np.ndarray:
        """(bodies,) depth of each body's highest point below the apex."""
        return self.depths_mm + self.pins.first_touch_mm

    @property
    def touching(self) -> list[np.ndarray]:
        """(rows, columns) of each body: the survey's cells that carry its pressure."""
        per_side = self.layout.surveys[0].per_side
        return [block_means(each, per_side) > 0 for each in self.body_pressures_mpa]

    @cached_property
    def body_pressures_mpa(self) -> np.ndarray:
        """(bodies, ny, nx) the pressure of each body on the contact's grid."""
        if len(self.names) == 1:
            return self.grid_mpa[None]
        found = np.zeros((len(self.names), *self.grid_mpa.shape))
        for body, fine in enumerate(self.body_fine_mpa):
            found[body, *self._grid_window] = block_means(fine, self.pins.layer.per_side)
        return found

    @cached_property
    def moments_mpa_mm(self) -> np.ndarray:
        """(2, ny, nx) mean of pressure times distance from the cell's center, along x and y."""
        layer, fine = self.pins.layer, self.fine_mpa
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

    @cached_property
    def cover(self) -> np.ndarray:
        """(ny, nx) share of each cell of the contact's grid that is in contact."""
        found, fine = np.zeros_like(self.grid_mpa), self.pins.cover * (self.body_fine_mpa > 0)
        found[self._grid_window] = block_means(fine.max(axis=0), self.pins.layer.per_side)
        return found

    @property
    def fine_mpa(self) -> np.ndarray:
        """Mean pressure on each fine cell of the window, (rows, columns)."""
        if self.forces_n.size == 1:
            return self.body_fine_mpa[0]
        return self.pins.spread(self.pressure_mpa)

    @cached_property
    def body_fine_mpa(self) -> np.ndarray:
        """The same by each body, (bodies, rows, columns)."""
        return self.pins.spread_each(self.pressure_mpa)

    def pin_state(self) -> PinState:
        """The active pins after the last step."""
        pins, active, layer = self.pins, self.active, self.pins.layer
        down, along = pins.window
        half = (pins.sides - 1) / 2 * layer.pitch_mm
        first = np.zeros((self.forces_n.size, 2), int)
        height = pins.gather(layer.rest_mm[pins.window] * pins.cover, 1, first)
        behind_mm = (self.depths_mm.max() - self.depths_mm)[pins.bodies]
        return PinState(
            x_mm=(layer.x_mm[along][pins.columns] + half)[active],
            y_mm=(layer.y_mm[down][pins.rows] + half)[active],
            rest_mm=height[active],
            gap_mm=(pins.gap_mm + behind_mm)[active],
            # A pin that carries nothing stays where its spring rests.
            deflection_mm=(self._rest + self._local * self.pressure_mpa)[active],
            spring_rest_mm=self._rest[active],
            stiffness_n_per_mm=(pins.covered * pins.cell_mm2 / self._local)[active],
            side_mm=pins.sides[active] * layer.pitch_mm,
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
        pressure[relative_window(self.pins.window, fine_near)] = self.fine_mpa
        surface[near] = center_values(fine.deflection_mm(pressure, fine_near), fine.per_side)
        if survey.per_side == 1:
            # The surface lies on the shape where that touches. A finer grid resolves this by
            # itself, and heights of the solid would give a slanting edge a beaded outline.
            x_mm, y_mm = layer.x_mm[near[1]], layer.y_mm[near[0]]
            for each, depth in zip(surveys, self.shape_depths_mm, strict=True):
                heights = heights_at(each.shape.surface, each.command, x_mm, y_mm, each.shift)
                surface[near] = np.maximum(surface[near], depth + layer.rest_mm[near] + heights)
        return surface


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


def _bottomed(found: Equilibrium) -> bool:
    """Whether the base plate of any shape carries pressure."""
    pins, surveys = found.pins, found.layout.surveys
    if all(survey.shape.base_mm is None for survey in surveys):
        return False
    layer, (rows, columns) = pins.layer, pins.window
    for survey, heights_mm, fine_mpa in zip(
        surveys, pins.heights_mm, found.body_fine_mpa, strict=True
    ):
        command, (along_x, along_y) = survey.command, survey.shape.base_slope
        limit_mm = -np.inf if survey.shape.base_mm is None else survey.shape.base_mm
        limit_mm += BASE_TOLERANCE_MM
        if (along_x, along_y) != (0.0, 0.0):
            # A tilted plate's height differs by its slope within a partly covered cell.
            x, y = layer.x_mm[columns] - command.x_mm, layer.y_mm[rows, None] - command.y_mm
            cos, sin = np.cos(command.yaw_rad), np.sin(command.yaw_rad)
            plane = along_x * (cos * x + sin * y) + along_y * (sin * x - cos * y)
            limit_mm = limit_mm + plane + layer.pitch_mm * float(np.hypot(along_x, along_y))
        if ((heights_mm <= limit_mm) & (fine_mpa > 0)).any():
            return True
    return False


def compile_layout(elastomer: Elastomer, pitch_mm: float) -> None:
    """Compile the loops that place the pins of a press."""
    command = PressCommand("hemisphere-4", 0.0, 0.0, 0.0, 1.0)
    survey = Survey(load(command.shape), command, cached_layer(elastomer, pitch_mm))
    PinLayout([survey], [survey.expected_contact(command.force_n)]).stage(True)


def compile_iteration(elastomer: Elastomer, pitch_mm: float) -> None:
    """Compile the loops of the iteration of a press: a step without pins."""
    layer, whole, one = cached_layer(elastomer, pitch_mm), np.zeros(0, int), np.ones(1)
    shape, none = layer.rest_mm.shape, np.zeros(0)
    operator = layer.operator((slice(0, shape[0]), slice(0, shape[1])))
    work = iterate_work(operator[-1], 0)
    pins = whole, whole, whole, whole, none, none, none, none
    iterate(
        0.0, 1.0, 1, 0.0, pins, np.zeros((1, *shape)), np.zeros(2, int), one, one, True, operator,
        *_around(layer.pitch_mm), work, none, none, none, none, one, np.empty(shape, np.float32),
    )  # fmt: skip
