"""Solves a press: rigid shapes pushed into an elastomer, each with a force.

Contact is normal and frictionless; the surface responds as an elastic layer
(`t2twin.sim.contact.layer`). Pins on springs carry the force (`pin_layout`). A fixed-point
iteration finds their pressure (`fixed_point`), first roughly, then finely. It is repeated with more
pins where the shape penetrates the surface outside them.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.jit import compile_time_s
from t2twin.primitives_cad.height_map import REACH_MM
from t2twin.primitives_cad.shape import Shape
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.fixed_point import FixedPoint, InitialGuess
from t2twin.sim.contact.grid import (
    Window,
    block_max,
    block_means,
    center_values,
    expanded,
    refined,
)
from t2twin.sim.contact.heights import heights_at, is_cut, place_of_top
from t2twin.sim.contact.layer import cached_layer
from t2twin.sim.contact.pin_layout import STAGES, OffPadError, PinLayout, Survey
from t2twin.sim.contact.pins import Pins
from t2twin.sim.contact.types import (
    FORCE_RANGE_N,
    SMALLEST_CONTACT_MM2,
    Contact,
    PressCommand,
    SurfaceShift,
    check_force,
)

BASE_TOLERANCE_MM = 1e-3
"""Tolerance on the height of the base plate's top when it is tested for contact, mm."""

FINE_CELLS = 2
"""Survey cells around the pins in which the surface is computed on the fine grid."""


DEPTH_TOLERANCE_MM = 1e-3
"""Tolerance of the depth, mm: the change in a converged step of the contact solver."""

FIRST_N, STEP = 1.0, 4.0
"""First force of the search, N, and the factor between its steps."""

MAX_PRESSES = 60
"""Limit on the presses of one search."""


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
    verify: bool = True,
) -> Contact:
    """The contact of bodies that are pressed at the same time, each with its own force.

    bodies: shapes of different names, with their poses and forces. Where they overlap, they share
    the pressure. shift: as for solve_contact. start: a contact of the same elastomer on the same
    grid, near to which the solution is expected; it is used if it is of the same bodies. slips_mm:
    (bodies, 2) by which each is expected to have moved since, along x and y; None for no motion.
    verify: whether MuJoCo verifies the result; see also `is_confirmed`.
    The shape and the command of the contact are those of the first body, its depths those of the
    deepest one. Raises T2TwinError as solve_contact does.
    """
    for _, command in bodies:
        check_force(command.force_n)
    check_force(sum(command.force_n for _, command in bodies))
    layer = cached_layer(elastomer, pitch_mm)
    started = time.perf_counter() - compile_time_s()
    surveys = [Survey(shape, command, layer, shift) for shape, command in bodies]
    if start is not None and start.equilibrium.names != tuple(shape.name for shape, _ in bodies):
        start = start if len(bodies) == len(start.equilibrium.names) == 1 else None
    equilibrium = _equilibrium(surveys, start, slips_mm, verify)
    solution, pressure = equilibrium.solution, equilibrium.pressure_mpa
    if elastomer.law == "linear":
        _check_not_through(equilibrium)
    pins, loaded, (shape, command) = solution.pins, solution.pressure_mpa > 0, bodies[0]
    area_mm2 = float(pins.covered[loaded].sum() * pins.cell_mm2)
    preparing_s = sum(survey.preparing_s for survey in surveys)
    return Contact(
        shape=shape,
        command=command,
        elastomer=elastomer,
        pressure_kpa=_read_only((1e3 * pressure).astype(np.float32)),
        x_mm=_read_only(layer.x_mm),
        y_mm=_read_only(layer.y_mm),
        contact_area_mm2=area_mm2,
        depth_mm=solution.depth_mm,
        shape_depth_mm=float(equilibrium.shape_depths_mm.max()),
        force_n=float(pressure.sum() * pitch_mm**2),
        settled=equilibrium.converged and area_mm2 > SMALLEST_CONTACT_MM2,
        bottomed=_bottomed(equilibrium),
        milliseconds=1e3 * (time.perf_counter() - compile_time_s() - started - preparing_s),
        compute_surface=lambda: _read_only(_surface_mm(equilibrium).astype(np.float32)),
        equilibrium=equilibrium,
        shift=shift,
    )


def is_confirmed(contact: Contact) -> bool:
    """Whether MuJoCo confirms a contact that was solved without verification."""
    return contact.equilibrium.solution.is_confirmed(STAGES[True][1])


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

    low, high = _bracket(residual, depth_mm)
    found = root_scalar(residual, bracket=(low, high), method="brentq", xtol=1e-6)
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


@dataclass(frozen=True)
class _Equilibrium:
    """The result of one stage. last: whether it is the last stage's. pressure_mpa: (ny, nx) on the
    contact's grid."""

    layout: PinLayout
    last: bool
    solution: FixedPoint
    pressure_mpa: np.ndarray
    converged: bool

    @property
    def names(self) -> tuple[str, ...]:
        """Of the bodies."""
        return tuple(survey.shape.name for survey in self.layout.surveys)

    @property
    def shape_depths_mm(self) -> np.ndarray:
        """(bodies,) depth of each body's highest point below the apex."""
        return self.solution.depths_mm + self.solution.pins.first_touch_mm

    @cached_property
    def moments_mpa_mm(self) -> np.ndarray:
        """(2, ny, nx) mean of pressure times distance from the cell's center, along x and y."""
        survey, layer = self.layout.surveys[0], self.solution.pins.layer
        fine, per_side = self.solution.fine_pressure_mpa(), layer.per_side
        # The window's first fine cell is the first of a cell.
        down, across = (
            layer.pitch_mm * (np.arange(size) % per_side - (per_side - 1) / 2)
            for size in fine.shape
        )
        means = [block_means(fine * mm, per_side) for mm in (across, down[:, None])]
        found = np.zeros((2, *self.pressure_mpa.shape))
        found[:, *refined(self.layout.window, survey.per_side)] = means
        return found

    @property
    def touching(self) -> list[np.ndarray]:
        """(rows, columns) of each body: the cells of its footprint that carry pressure."""
        per_side = self.layout.surveys[0].per_side
        return [block_max(each, per_side) > 0 for each in self.body_pressures_mpa]

    @cached_property
    def body_pressures_mpa(self) -> np.ndarray:
        """(bodies, ny, nx) the pressure of each body on the contact's grid."""
        if len(self.names) == 1:
            return self.pressure_mpa[None]
        survey, per_side = self.layout.surveys[0], self.solution.pins.layer.per_side
        found = np.zeros((len(self.names), *self.pressure_mpa.shape))
        window = refined(self.layout.window, survey.per_side)
        for body, fine in enumerate(self.solution.body_pressures_mpa()):
            found[body, *window] = block_means(fine, per_side)
        return found


def _equilibrium(
    surveys: Sequence[Survey], start: Contact | None, slips_mm: np.ndarray | None, verify: bool
) -> _Equilibrium:
    """Solves the rough and the last stage, adding pins where a shape touches outside them.

    start: a contact near the solution, which makes the rough stage unnecessary. slips_mm:
    by which the bodies have moved since. verify: whether MuJoCo verifies the last stage.
    """
    before = None if start is None else start.equilibrium.layout
    if start is None:
        expected = [survey.expected_contact(survey.command.force_n) for survey in surveys]
        layout = PinLayout(surveys, expected)
        found = _solve_stage(layout, None, False)
    else:
        earlier = start.equilibrium
        expected = list(zip(earlier.touching, earlier.solution.depths_mm, strict=True))
        layout = PinLayout(surveys, expected, before)
        found = _solve_stage(layout, earlier, verify, slips_mm)
    while True:
        depths_mm = found.solution.depths_mm
        missed = [
            survey.missed(active, depth_mm, found.pressure_mpa)
            for survey, active, depth_mm in zip(surveys, layout.active, depths_mm, strict=True)
        ]
        if any(each.any() for each in missed):
            wanted = [cells | more for cells, more in zip(found.touching, missed, strict=True)]
            expected = list(zip(wanted, depths_mm, strict=True))
            layout = PinLayout(surveys, expected, before, layout.active)
        elif found.last:
            return found
        found = _solve_stage(layout, found, verify)


def _solve_stage(
    layout: PinLayout,
    earlier: _Equilibrium | None,
    verify: bool,
    slips_mm: np.ndarray | None = None,
) -> _Equilibrium:
    """Solves the rough stage, or the last one starting from an earlier result."""
    survey, window, last = layout.surveys[0], layout.window, earlier is not None
    pins, tolerance = layout.stage(last)
    start = None if earlier is None else _transferred(earlier, pins, window, slips_mm)
    forces_n = np.array([each.command.force_n for each in layout.surveys])
    solution = FixedPoint(pins, forces_n, start, verify)
    converged = solution.solve(tolerance)
    survey.preparing_s += solution.compiling_s
    pressure = np.zeros(survey.layer.rest_mm.shape)
    fine = solution.fine_pressure_mpa()
    pressure[refined(window, survey.per_side)] = block_means(fine, pins.layer.per_side)
    return _Equilibrium(layout, last, solution, pressure, converged)


def _transferred(
    earlier: _Equilibrium, pins: Pins, window: Window, slips_mm: np.ndarray | None
) -> InitialGuess:
    """An earlier result as start on other pins in another window of the survey, each body moved by
    the nearest number of cells."""
    pressures, old_window = earlier.solution.body_pressures_mpa(), earlier.layout.window
    before, now = (
        each.shape[1] // (rows.stop - rows.start)
        for each, (rows, _) in ((pressures, old_window), (pins.cover, window))
    )
    if now < before:
        pressures = np.stack([block_means(each, before // now) for each in pressures])
    first = np.array([old.start - new.start for old, new in zip(old_window, window, strict=True)])
    moves = np.zeros((len(pressures), 2), int)
    if slips_mm is not None:
        moves = np.rint(slips_mm[:, ::-1] / pins.layer.pitch_mm).astype(int)
    found = pins.gather(pressures, max(now // before, 1), now * first + moves)
    return InitialGuess(found, earlier.solution.depths_mm)


def _surface_mm(equilibrium: _Equilibrium) -> np.ndarray:
    """The surface's deflection, (ny, nx), mm, computed on the fine grid around the pins."""
    layout, solution = equilibrium.layout, equilibrium.solution
    survey, fine = layout.surveys[0], solution.pins.layer.per_side
    layer, surface = survey.layer, survey.surface_mm(equilibrium.pressure_mpa)
    window = expanded(layout.window, FINE_CELLS, survey.gap_mm.shape)
    near = refined(window, survey.per_side)
    surface[near] = center_values(solution.fine_surface_mm(refined(near, fine)), fine)
    if survey.per_side == 1:
        # The surface lies on the shape where that touches. A finer grid resolves this by itself,
        # and heights of the solid would give a slanting edge a beaded outline.
        x_mm, y_mm = layer.x_mm[near[1]], layer.y_mm[near[0]]
        for each, depth in zip(layout.surveys, equilibrium.shape_depths_mm, strict=True):
            heights = heights_at(each.shape.surface, each.command, x_mm, y_mm, each.shift)
            surface[near] = np.maximum(surface[near], depth + layer.rest_mm[near] + heights)
    return surface


def _check_not_through(equilibrium: _Equilibrium) -> None:
    """Raises T2TwinError where the surface passes the layer's base, as the linear law allows."""
    surveys = equilibrium.layout.surveys
    layer, elastomer = surveys[0].layer, surveys[0].layer.elastomer
    through = _surface_mm(equilibrium) >= layer.thickness_mm
    if through[equilibrium.pressure_mpa > 0].any():
        force_n = sum(survey.command.force_n for survey in surveys)
        raise T2TwinError(
            f"{force_n:g} N push {' and '.join(equilibrium.names)} through the {elastomer.name} "
            f"layer of {elastomer.thickness_mm:g} mm; take a smaller force or a thicker or stiffer "
            "layer"
        )


def _bottomed(equilibrium: _Equilibrium) -> bool:
    """Whether the base plate of any shape carries pressure."""
    solution, surveys = equilibrium.solution, equilibrium.layout.surveys
    if all(survey.shape.base_mm is None for survey in surveys):
        return False
    # A height above a level one is compared after its lowest loaded place is found.
    limits = [_base_limit_mm(survey, solution.pins) for survey in surveys]
    heights = solution.pins.heights_mm
    if any(np.ndim(limit) for limit in limits):
        heights = np.stack([mm - limit for mm, limit in zip(heights, limits, strict=True)])
        limits = [0.0] * len(surveys)
    lowest = solution.pins.lowest_loaded(solution.pressure_mpa, heights)
    return bool((lowest <= limits).any())


def _base_limit_mm(survey: Survey, pins: Pins) -> np.ndarray | float:
    """Largest height of a base plate, mm, on the pins' fine cells.

    A tilted one is a plane, whose height may differ by its slope within a partly covered cell.
    -inf for a shape without one.
    """
    base_mm, (along_x, along_y) = survey.shape.base_mm, survey.shape.base_slope
    if base_mm is None:
        return -np.inf
    limit = base_mm + BASE_TOLERANCE_MM
    if along_x == 0.0 == along_y:
        return limit
    command, layer, (rows, columns) = survey.command, pins.layer, pins.window
    x, y = layer.x_mm[columns] - command.x_mm, layer.y_mm[rows, None] - command.y_mm
    cos, sin = np.cos(command.yaw_rad), np.sin(command.yaw_rad)
    plane = along_x * (cos * x + sin * y) + along_y * (sin * x - cos * y)
    return limit + plane + layer.pitch_mm * float(np.hypot(along_x, along_y))


def _read_only(values: np.ndarray) -> np.ndarray:
    view = values.view()
    view.setflags(write=False)
    return view
