"""The press: a shape pushed into an elastomer until pressure and surface have settled.

Contact is normal and frictionless, and the layer's answer is that of `t2twin.sim.contact.layer`.
Pins on springs stand for it: a pin's own spring D is local, the layer is not, so each step the
springs' rest points take what the springs leave out, w(p) - D p, from the last pressure p. Which of
the springs touch and how they share the force is exact at each step
(`t2twin.sim.contact.solver_loops`), and Anderson's acceleration lets the steps settle in about
four. Then MuJoCo (`t2twin.sim.contact.mujoco_pins`) judges: its contacts have to find the same pins
and the same shares. The pins are the finer the smaller the contact.
"""

import time
from dataclasses import dataclass

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.core.jit import preparing_s
from t2twin.primitives_cad.shape import NOTHING_MM, Shape
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.fixed_point import (
    GUESSES,
    InitialGuess,
    Solution,
    by_law,
    spring_compliance,
    winkler_depth_mm,
)
from t2twin.sim.contact.footprint import footprint, heights_at
from t2twin.sim.contact.grid import (
    Window,
    common,
    grown,
    means,
    middles,
    repeated,
    scaled,
    span,
    widened,
    window_around,
    within,
)
from t2twin.sim.contact.layer import WHOLE, Layer, cached_layer
from t2twin.sim.contact.mujoco_pins import POOL_SIZES
from t2twin.sim.contact.pins import Pins, pins_under
from t2twin.sim.contact.types import Contact, PressCommand, check_force

DIGIT_PITCH_MM = 0.25
"""Grid of the DIGIT's gel, mm: fine enough for features of 1 mm seen at 0.05 mm a pixel."""

CYSKIN_PITCH_MM = 0.5
"""Grid of the CySkin's cover, mm: an eighth of a taxel's pad."""

SURVEY_MM = 0.5
"""Largest cells on which a press looks for its contact, and largest cell of a pin, mm."""

FINER = (1, 2, 4)
"""Numbers of pins along a survey's cell that a press chooses from: one where the shape is even,
and the largest at its edges and where it is not."""

MIN_PINS = 200
"""Pins that the contact is expected to cover, at least, where they can be made so fine."""

AT_EDGES = 2
"""Times as many pins along a survey's cell at the shape's edges."""

UNEVEN = 0.1
"""How far a cell's highest point stands out of its mean, over the expected depth, from which on it
gets the smallest pins."""

STAGES = ((0.25, 2e-2), (0.125, 5e-3))
"""Coarsest grid on which a layer's answer is worked out, mm, and the relative change of the
pressure in a step below which it has settled: first roughly, then from there finely."""

BASE_TOLERANCE_MM = 1e-3
"""A touched height so near the base plate's top counts as the base plate, mm."""

MISSED_OUTSIDE_MM, MISSED_OUTSIDE_SHARE = 0.01, 0.2
"""How far the shape's highest points may stand in the surface where no pins are, mm, or over the
depth where that is less."""

MARGIN_CELLS = 1
"""Cells of the survey around the expected contact that get pins too."""

FIELD_CELLS = 2
"""Cells of the survey around the window in which the surface still is worked out finely."""


class BesidePadError(T2TwinError):
    """Nothing of the shape lies over the pad."""


def solve_contact(
    shape: Shape, command: PressCommand, elastomer: Elastomer, pitch_mm: float
) -> Contact:
    """The contact of a shape pressed into an elastomer, on a grid of pitch_mm.

    The command's shape name is not looked at; its pose and force are. Calls from several threads at
    once do not disturb each other. Raises T2TwinError where the force is out of range or a linear
    layer cannot carry it, and its BesidePadError where the shape lies beside the pad.
    """
    check_force(command.force_n)
    layer = cached_layer(elastomer, pitch_mm)
    started = time.perf_counter() - preparing_s()
    survey = _Survey(shape, command, layer)
    equilibrium = _equilibrium(survey)
    solution, pressure = equilibrium.solution, equilibrium.pressure_mpa
    if elastomer.law == "linear":
        _check_carried(survey, pressure, _fine_surface(survey, equilibrium))
    pins, touched = solution.pins, solution.pressure_mpa > 0
    base = shape.base_mm
    return Contact(
        shape=shape,
        command=command,
        elastomer=elastomer,
        pressure_kpa=_read_only((1e3 * pressure).astype(np.float32)),
        x_mm=_read_only(layer.x_mm),
        y_mm=_read_only(layer.y_mm),
        contact_area_mm2=float(pins.covered[touched].sum() * pins.cell_mm2),
        depth_mm=solution.depth_mm,
        shape_depth_mm=solution.depth_mm + pins.first_touch_mm,
        force_n=float(pressure.sum() * pitch_mm**2),
        settled=equilibrium.settled,
        bottomed=base is not None and _touches(solution, base + BASE_TOLERANCE_MM),
        pins=solution.pin_state(),
        milliseconds=1e3 * (time.perf_counter() - preparing_s() - started - survey.preparing_s),
        find_surface=lambda: _read_only(_fine_surface(survey, equilibrium).astype(np.float32)),
    )


def _touches(solution: Solution, height_mm: float) -> bool:
    """Whether something of the shape that is no higher carries pressure."""
    carrying = solution.pins.spread((solution.pressure_mpa > 0).astype(float)) > 0
    return bool((solution.pins.heights_mm[carrying] <= height_mm).any())


def _read_only(values: np.ndarray) -> np.ndarray:
    view = values.view()
    view.setflags(write=False)
    return view


@dataclass(frozen=True)
class _Equilibrium:
    """Where the pins of a stage have settled.

    last: whether of the last stage. pressure_mpa: (ny, nx) on the contact's grid.
    """

    stages: "_Stages"
    last: bool
    solution: Solution
    pressure_mpa: np.ndarray
    settled: bool


def _equilibrium(survey: "_Survey") -> _Equilibrium:
    """The rough stage and then the last, with more pins where the shape came down outside them."""
    expected, depth_mm = survey.expected_contact(survey.command.force_n)
    stages = _Stages(survey, expected, depth_mm)
    found = _settled(stages, None)
    while True:
        missed = survey.missed(found)
        if missed.any():
            stages = _Stages(survey, found.stages.looked_at | missed, found.solution.depth_mm)
        elif found.last:
            return found
        found = _settled(stages, found)


def _settled(stages: "_Stages", earlier: _Equilibrium | None) -> _Equilibrium:
    """The rough stage's pins, or the last one's from where an earlier stage has left its own."""
    survey, window, last = stages.survey, stages.window, earlier is not None
    pins, tolerance = stages.stage(last)
    start = None if earlier is None else _moved(earlier, window, len(pins.cover))
    solution = Solution(pins, survey.command.force_n, start, judged=last)
    settled = solution.solve(tolerance)
    survey.preparing_s += solution.compiling_s
    pressure = np.zeros(survey.layer.rest_mm.shape)
    fine = solution.fine_pressure_mpa()
    pressure[scaled(window, survey.per_side)] = means(fine, pins.layer.per_side)
    return _Equilibrium(stages, last, solution, pressure, settled)


def _moved(earlier: _Equilibrium, window: Window, rows: int) -> InitialGuess:
    """What an equilibrium gives to begin with in another window, of so many rows of fine cells."""
    pressure = earlier.solution.fine_pressure_mpa()
    before, now = len(pressure) // span(earlier.stages.window)[0], rows // span(window)[0]
    pressure = means(pressure, before // now) if now < before else repeated(pressure, now // before)
    old, new = scaled(earlier.stages.window, now), scaled(window, now)
    both = common(old, new)
    moved = np.zeros(span(new))
    moved[within(both, new)] = pressure[within(both, old)]
    return InitialGuess(moved, earlier.solution.depth_mm)


def _fine_surface(survey: "_Survey", equilibrium: _Equilibrium) -> np.ndarray:
    """The surface, (ny, nx), mm, worked out finely around the pins."""
    layer, solution = survey.layer, equilibrium.solution
    surface, fine = survey.surface_mm(equilibrium.pressure_mpa), solution.pins.layer.per_side
    window = widened(equilibrium.stages.window, FIELD_CELLS, survey.gap_mm.shape)
    near = scaled(window, survey.per_side)
    surface[near] = middles(solution.fine_surface_mm(scaled(near, fine)), fine)
    if survey.per_side == 1:
        # Where the shape stands, the surface lies on it. A finer grid sees that by itself, and
        # points taken from the solid would make a slanting edge look like a string of beads.
        x_mm, y_mm = layer.x_mm[near[1]], layer.y_mm[near[0]]
        heights = heights_at(survey.shape.surface, survey.command, x_mm, y_mm)
        shape_depth = solution.depth_mm + solution.pins.first_touch_mm
        surface[near] = np.maximum(surface[near], shape_depth + layer.rest_mm[near] + heights)
    return surface


def _check_carried(survey: "_Survey", pressure_mpa: np.ndarray, surface_mm: np.ndarray) -> None:
    """Nothing in the linear law keeps a surface from passing the layer's base."""
    layer, elastomer = survey.layer, survey.layer.elastomer
    if (surface_mm >= layer.thickness_mm)[pressure_mpa > 0].any():
        raise T2TwinError(
            f"{survey.command.force_n:g} N push {survey.shape.name} through the {elastomer.name} "
            f"layer of {elastomer.thickness_mm:g} mm; take a smaller force or a thicker or stiffer "
            "layer"
        )


class _Survey:
    """The whole pad and the shape over it, on cells of at most SURVEY_MM.

    per_side: cells of the contact's grid along one of the survey's. seen: the shape over them.
    gap_mm: (rows, columns) how far the surface is from the shape at first touch, mm, >= 0.
    peak_gap_mm: the same of the shape's highest point over each cell, instead of its mean height.
    preparing_s: time spent on what is kept for the next press.
    """

    def __init__(self, shape: Shape, command: PressCommand, layer: Layer) -> None:
        self.shape, self.command, self.layer = shape, command, layer
        self.per_side = 2 if 2 * layer.pitch_mm <= SURVEY_MM + 1e-9 else 1
        x = layer.x_mm.reshape(-1, self.per_side).mean(axis=1)
        y = layer.y_mm.reshape(-1, self.per_side).mean(axis=1)
        self.seen = footprint(shape.surface, command, x, y)
        surface = -means(layer.rest_mm, self.per_side)
        distance = surface - self.seen.heights_mm
        nearest = float(distance.min())
        if nearest > -NOTHING_MM / 2:
            raise BesidePadError(
                f"{shape.name} at x {command.x_mm:g} mm, y {command.y_mm:g} mm lies beside the "
                f"{layer.elastomer.name} pad, which reaches {layer.elastomer.width_mm / 2:g} mm "
                f"in x and {layer.elastomer.length_mm / 2:g} mm in y from its middle"
            )
        self.gap_mm = distance - nearest
        above = surface - self.seen.peaks_mm
        self.peak_gap_mm = above - above.min()
        self.preparing_s = 0.0

    def surface_mm(self, pressure_mpa: np.ndarray) -> np.ndarray:
        """The surface under a pressure, both on the contact's grid, (ny, nx), mm."""
        layer = self.layer
        return middles(by_law(layer, layer.deflection_mm(pressure_mpa), WHOLE)[0], 1)

    def missed(self, found: _Equilibrium) -> np.ndarray:
        """Where the shape stands in the surface but no pins are, (rows, columns) bool."""
        depth_mm = found.solution.depth_mm
        standing_mm = depth_mm - self.peak_gap_mm
        standing_mm -= min(MISSED_OUTSIDE_MM, MISSED_OUTSIDE_SHARE * depth_mm)
        missed = standing_mm > 0
        missed[found.stages.looked_at] = False
        if missed.any():
            missed &= standing_mm > means(self.surface_mm(found.pressure_mpa), self.per_side)
        return missed

    def divided(self, per_side: int) -> Layer:
        """The elastomer's layer on the contact's cells cut into parts."""
        asked = time.perf_counter()
        layer = cached_layer(self.layer.elastomer, self.layer.pitch_mm, per_side)
        self.preparing_s += time.perf_counter() - asked
        return layer

    def expected_contact(self, force_n: float) -> tuple[np.ndarray, float]:
        """Where independent springs as soft as the layer would touch, (rows, columns), and how
        deep, mm."""
        depth, touching = 0.0, np.ones(self.gap_mm.shape, bool)
        for _ in range(GUESSES):
            pressed = scaled(window_around(touching), self.per_side)
            springs = spring_compliance(self.layer, pressed)
            force = force_n * springs / (self.per_side * self.layer.pitch_mm) ** 2
            depth = winkler_depth_mm(self.gap_mm, force)
            touching = self.gap_mm < depth
        return touching, depth


def _finer(cells_in_contact: float) -> int:
    """How many pins along a survey's cell make the contact cover enough of them."""
    enough = (finer for finer in FINER if cells_in_contact * finer**2 >= MIN_PINS)
    return next(enough, FINER[-1])


class _Stages:
    """The pins of both stages of a press, under the expected contact and MARGIN_CELLS around it.

    looked_at: the survey's cells that have pins. window: what holds those.
    """

    def __init__(self, survey: _Survey, expected: np.ndarray, depth_mm: float) -> None:
        """depth_mm: how deep the shape is expected to go."""
        self.survey = survey
        self.looked_at = grown(expected, MARGIN_CELLS)
        self.window = window_around(self.looked_at)
        cells = float(survey.seen.shares[expected].sum())
        self._even = _finer(cells)
        self._finest = self._per_side(FINER[-1], STAGES[-1][0])
        fine = survey.divided(self._finest)
        rows, columns = scaled(self.window, survey.per_side * self._finest)
        self._seen = footprint(
            survey.shape.surface,
            survey.command,
            fine.x_mm[columns],
            fine.y_mm[rows],
            self.looked_at[self.window],
        )
        self._first_touch_mm = float((-fine.rest_mm[rows, columns] - self._seen.peaks_mm).min())
        self._along = self._pins_along(depth_mm)

    def _per_side(self, pins: int, layer_mm: float) -> int:
        """Fine cells along one of the contact's: no fewer than pins along one of the survey's."""
        survey = self.survey
        return max(1, round(pins / survey.per_side), round(survey.layer.pitch_mm / layer_mm))

    def _pins_along(self, depth_mm: float) -> np.ndarray:
        """(rows, columns) how many pins stand along each of the window's cells."""
        cells = self._seen.coarsened(self.survey.per_side * self._finest)
        there = self.looked_at[self.window] & (cells.shares > 0)
        uneven = cells.peaks_mm - cells.heights_mm > UNEVEN * depth_mm
        wanted = np.where(self._at_edges(cells.shares), AT_EDGES * self._even, self._even)
        wanted[uneven] = FINER[-1]
        most = len(FINER)
        while True:
            along = np.take(FINER[:most], np.searchsorted(FINER[: most - 1], wanted)) * there
            if (along**2).sum() <= POOL_SIZES[-1] or most == 1:
                return along
            most -= 1  # a rim was expected, and a face behind it came down too

    def _at_edges(self, shares: np.ndarray) -> np.ndarray:
        """(rows, columns) the cells of the window that the shape does not wholly cover, and those
        beside one of which it covers less than half; the pad's rim ends every shape."""
        open_ = np.zeros([side + 2 for side in shares.shape], bool)
        open_[1:-1, 1:-1] = self.looked_at[self.window] & (shares < 0.5)
        lengths = self.survey.gap_mm.shape
        for axis, (side, length) in enumerate(zip(self.window, lengths, strict=True)):
            ends = np.moveaxis(open_, axis, 0)
            ends[0], ends[-1] = side.start == 0, side.stop == length
        return grown(open_, 1)[1:-1, 1:-1] | (shares < 1.0)

    def stage(self, last: bool) -> tuple[Pins, float]:
        """The pins of the rough stage or of the last, and the tolerance within which it has
        settled."""
        layer_mm, tolerance = STAGES[last]
        along = self._along
        if not last:
            along = np.where(along > 0, np.maximum(along // 2, 1), 0)
        per_side = self._per_side(int(along.max()), layer_mm)
        per_cell = self.survey.per_side * per_side
        return pins_under(
            self.survey.divided(per_side),
            scaled(self.window, per_cell),
            per_cell,
            along,
            self._seen.coarsened(self._finest // per_side),
            self._first_touch_mm,
        ), tolerance
