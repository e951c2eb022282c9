"""Solves a press: a rigid shape pushed into an elastomer with a force.

Contact is normal and frictionless; the surface responds as an elastic layer
(`t2twin.sim.contact.layer`). Pins on springs carry the force (`pin_layout`). A fixed-point
iteration finds their pressure (`fixed_point`), first roughly, then finely. It is repeated with more
pins where the shape penetrates the surface outside them.
"""

import time
from dataclasses import dataclass

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.core.jit import compile_time_s
from t2twin.primitives_cad.shape import Shape
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.fixed_point import FixedPoint, InitialGuess
from t2twin.sim.contact.grid import (
    Window,
    block_max,
    block_means,
    center_values,
    expanded,
    intersection,
    moved_by,
    refined,
    relative_window,
    repeated,
    window_shape,
)
from t2twin.sim.contact.heights import heights_at
from t2twin.sim.contact.layer import cached_layer
from t2twin.sim.contact.pin_layout import STAGES, OffPadError, PinLayout, Survey
from t2twin.sim.contact.types import Contact, PressCommand, SurfaceShift, check_force

DIGIT_PITCH_MM = 0.25
"""Grid of the DIGIT's gel, mm: fine enough for features of 1 mm seen at 0.05 mm a pixel."""

CYSKIN_PITCH_MM = 0.5
"""Grid of the CySkin's cover, mm: an eighth of a taxel's pad."""

BASE_TOLERANCE_MM = 1e-3
"""Tolerance on the height of the base plate's top when it is tested for contact, mm."""

FINE_CELLS = 2
"""Survey cells around the pins in which the surface is computed on the fine grid."""


def solve_contact(
    shape: Shape,
    command: PressCommand,
    elastomer: Elastomer,
    pitch_mm: float,
    shift: SurfaceShift | None = None,
    start: Contact | None = None,
    slip_mm: tuple[float, float] = (0.0, 0.0),
    verify: bool = True,
) -> Contact:
    """The contact of a shape pressed into an elastomer, on a grid of pitch_mm.

    Uses the command's pose and force, not its shape name. shift: of the surface by shear. start: a
    contact of the same elastomer on the same grid, near to which the solution is expected. slip_mm:
    by which the contact is expected to have moved since, along x and y. verify: whether MuJoCo
    verifies the result; see also `is_confirmed`. Safe to call from several threads.
    Raises T2TwinError for a force out of range or too large for a linear layer, and its OffPadError
    for a shape that does not lie over the pad.
    """
    check_force(command.force_n)
    layer = cached_layer(elastomer, pitch_mm)
    started = time.perf_counter() - compile_time_s()
    survey = Survey(shape, command, layer, shift)
    equilibrium = _equilibrium(survey, start, slip_mm, verify)
    solution, pressure = equilibrium.solution, equilibrium.pressure_mpa
    if elastomer.law == "linear":
        _check_not_through(survey, pressure, _surface_mm(survey, equilibrium))
    pins, loaded = solution.pins, solution.pressure_mpa > 0
    base = shape.base_mm
    return Contact(
        shape=shape,
        command=command,
        elastomer=elastomer,
        pressure_kpa=_read_only((1e3 * pressure).astype(np.float32)),
        x_mm=_read_only(layer.x_mm),
        y_mm=_read_only(layer.y_mm),
        contact_area_mm2=float(pins.covered[loaded].sum() * pins.cell_mm2),
        depth_mm=solution.depth_mm,
        shape_depth_mm=solution.depth_mm + pins.first_touch_mm,
        force_n=float(pressure.sum() * pitch_mm**2),
        settled=equilibrium.converged,
        bottomed=base is not None and _touches(solution, base + BASE_TOLERANCE_MM),
        pins=solution.pin_state(),
        milliseconds=1e3 * (time.perf_counter() - compile_time_s() - started - survey.preparing_s),
        compute_surface=lambda: _read_only(_surface_mm(survey, equilibrium).astype(np.float32)),
        equilibrium=equilibrium,
        shift=shift,
    )


def is_confirmed(contact: Contact) -> bool:
    """Whether MuJoCo confirms a contact that was solved without verification."""
    return contact.equilibrium.solution.is_confirmed(STAGES[True][1])


@dataclass(frozen=True)
class _Equilibrium:
    """The result of one stage. last: whether it is the last stage's. pressure_mpa: (ny, nx) on the
    contact's grid."""

    layout: PinLayout
    last: bool
    solution: FixedPoint
    pressure_mpa: np.ndarray
    converged: bool


def _equilibrium(
    survey: Survey, start: Contact | None, slip_mm: tuple[float, float], verify: bool
) -> _Equilibrium:
    """Solves the rough and the last stage, adding pins where the shape touches outside them.

    start: a contact near the solution, which makes the rough stage unnecessary. slip_mm: by which
    the contact has moved since. verify: whether MuJoCo verifies the last stage.
    """
    before = None if start is None else start.equilibrium.layout
    if start is None:
        layout = PinLayout(survey, *survey.expected_contact(survey.command.force_n))
        found = _solve_stage(layout, None, False)
    else:
        touching = block_max(start.pressure_kpa, survey.per_side) > 0
        layout = PinLayout(survey, touching, start.depth_mm, before)
        found = _solve_stage(layout, start.equilibrium, verify, slip_mm)
    while True:
        depth_mm = found.solution.depth_mm
        missed = survey.missed(layout.active, depth_mm, found.pressure_mpa)
        if missed.any():
            layout = PinLayout(survey, layout.active | missed, depth_mm, before)
        elif found.last:
            return found
        found = _solve_stage(layout, found, verify)


def _solve_stage(
    layout: PinLayout,
    earlier: _Equilibrium | None,
    verify: bool,
    slip_mm: tuple[float, float] = (0.0, 0.0),
) -> _Equilibrium:
    """Solves the rough stage, or the last one starting from an earlier result."""
    survey, window, last = layout.survey, layout.window, earlier is not None
    pins, tolerance = layout.stage(last)
    if not pins.gap_mm.size:
        raise OffPadError(
            f"no part of {survey.shape.name} lies over the surface, which shear has displaced; "
            "take a smaller force or a smaller friction"
        )
    start = None if earlier is None else _transferred(earlier, window, len(pins.cover), slip_mm)
    solution = FixedPoint(pins, survey.command.force_n, start, verify)
    converged = solution.solve(tolerance)
    survey.preparing_s += solution.compiling_s
    pressure = np.zeros(survey.layer.rest_mm.shape)
    fine = solution.fine_pressure_mpa()
    pressure[refined(window, survey.per_side)] = block_means(fine, pins.layer.per_side)
    return _Equilibrium(layout, last, solution, pressure, converged)


def _transferred(
    earlier: _Equilibrium, window: Window, rows: int, slip_mm: tuple[float, float]
) -> InitialGuess:
    """An earlier result as start in another window with this number of rows of fine cells, moved by
    the nearest number of cells."""
    pressure = earlier.solution.fine_pressure_mpa()
    old_window = earlier.layout.window
    before, now = len(pressure) // window_shape(old_window)[0], rows // window_shape(window)[0]
    if now < before:
        pressure = block_means(pressure, before // now)
    else:
        pressure = repeated(pressure, now // before)
    survey = earlier.layout.survey
    cell_mm = survey.layer.pitch_mm * survey.per_side / now
    along_x, along_y = (round(slip / cell_mm) for slip in slip_mm)
    old, new = refined(old_window, now), refined(window, now)
    old = moved_by(old[0], along_y), moved_by(old[1], along_x)
    both = intersection(old, new)
    guess = np.zeros(window_shape(new))
    guess[relative_window(both, new)] = pressure[relative_window(both, old)]
    return InitialGuess(guess, earlier.solution.depth_mm)


def _surface_mm(survey: Survey, equilibrium: _Equilibrium) -> np.ndarray:
    """The surface's deflection, (ny, nx), mm, computed on the fine grid around the pins."""
    layer, solution = survey.layer, equilibrium.solution
    surface, fine = survey.surface_mm(equilibrium.pressure_mpa), solution.pins.layer.per_side
    window = expanded(equilibrium.layout.window, FINE_CELLS, survey.gap_mm.shape)
    near = refined(window, survey.per_side)
    surface[near] = center_values(solution.fine_surface_mm(refined(near, fine)), fine)
    if survey.per_side == 1:
        # The surface lies on the shape where that touches. A finer grid resolves this by itself,
        # and heights of the solid would give a slanting edge a beaded outline.
        x_mm, y_mm = layer.x_mm[near[1]], layer.y_mm[near[0]]
        heights = heights_at(survey.shape.surface, survey.command, x_mm, y_mm, survey.shift)
        shape_depth = solution.depth_mm + solution.pins.first_touch_mm
        surface[near] = np.maximum(surface[near], shape_depth + layer.rest_mm[near] + heights)
    return surface


def _check_not_through(survey: Survey, pressure_mpa: np.ndarray, surface_mm: np.ndarray) -> None:
    """Raises T2TwinError where the surface passes the layer's base, as the linear law allows."""
    layer, elastomer = survey.layer, survey.layer.elastomer
    if (surface_mm >= layer.thickness_mm)[pressure_mpa > 0].any():
        raise T2TwinError(
            f"{survey.command.force_n:g} N push {survey.shape.name} through the {elastomer.name} "
            f"layer of {elastomer.thickness_mm:g} mm; take a smaller force or a thicker or stiffer "
            "layer"
        )


def _touches(solution: FixedPoint, height_mm: float) -> bool:
    """Whether any part of the shape up to a height carries pressure."""
    loaded = solution.pins.spread((solution.pressure_mpa > 0).astype(float)) > 0
    return bool((solution.pins.heights_mm[loaded] <= height_mm).any())


def _read_only(values: np.ndarray) -> np.ndarray:
    view = values.view()
    view.setflags(write=False)
    return view
