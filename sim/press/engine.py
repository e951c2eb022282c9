"""The press: a shape pushed into an elastomer until pressure and surface are at rest.

Contact is normal and frictionless, the layer's answer is that of `sim.press.layer`, and MuJoCo
(`sim.press.bed`) finds which pins touch and how they share the force. A pin's own spring D is
local; the layer is not. So each step the springs' rest points take what the springs leave out,
w(p) - D p, from the last pressure p: a majorise-minimise step on the elastic energy. Nesterov's
extrapolation with restart (O'Donoghue and Candes, 2015) brings it to rest in about ten steps.
"""

import time

import numpy as np
from scipy import ndimage

from primitives_cad.errors import T2TwinError
from primitives_cad.shape import NOTHING_MM, Shape
from sim.press.bed import POOL_SIZES, Bed, bed
from sim.press.elastomer import Elastomer, neo_hookean_mm
from sim.press.footprint import LEAST_COVER, footprint
from sim.press.layer import WHOLE, Layer, layer
from sim.records import Contact, Press

DIGIT_PITCH_MM = 0.25
"""Grid of the DIGIT's gel, mm: fine enough for features of 1 mm seen at 0.05 mm a pixel."""

CYSKIN_PITCH_MM = 0.5
"""Grid of the CySkin's cover, mm: an eighth of a taxel's pad."""

FORCE_RANGE_N = (0.01, 100.0)
"""Forces that may be commanded, N."""

SPRING_SHARE = 0.85
"""A pin's compliance over the layer's largest. Above 3/4 the extrapolated iteration is stable."""

AT_REST = 2e-3
"""Relative change of the pressure in a step below which the press has settled."""

MOST_STEPS = 80
"""Steps after which a press is given up as not settled."""

BASE_TOLERANCE_MM = 1e-3
"""A touched height so near the base plate's top counts as the base plate, mm."""

LEAST_SLOPE = 0.02
"""Least share of a pin's compliance that stiffening leaves: keeps the springs finite."""

SQUARE_MEAN = 0.946
"""Mean deflection of a uniformly loaded square of side s on a half-space, over (1 - nu^2) p s / E
(Johnson, Contact Mechanics, 1985, section 3.3)."""

EDGE_SHARE, EDGE_RISE = 1.0, 1.15
"""Fitted so that the depth of flat punches 1 to 8 mm wide does not depend on how their edges fall
on the grid; the truth was the same layer on finer grids, extrapolated."""

MISSED_MM = 1e-4
"""How far the shape may stand in a cell without a pin, mm."""

GUESSES = 3
"""Rounds in which the springs and the contact they expect are made to fit each other."""

WINDOW_CELLS = 8
"""Step of the window's size, cells."""

MARGIN_CELLS = 2
"""Cells around the expected contact that get a pin from the start."""


def press(shape: Shape, command: Press, elastomer: Elastomer, pitch_mm: float) -> Contact:
    """Press a shape into an elastomer.

    The command's shape name is not looked at; its pose and force are. Raises T2TwinError where
    the force is out of range, the shape is beside the pad, or a linear layer cannot carry the
    force.
    """
    check_force(command.force_n)
    ground = layer(elastomer, pitch_mm)
    started = time.perf_counter()
    heights, shares = footprint(shape.surface, command, ground.x_mm, ground.y_mm)
    gap, first_touch = _gap_mm(shape, command, ground, heights)
    solution = _Solution(ground, gap, shares, command.force_n)
    settled = solution.solve()
    surface, touched = solution.surface_mm(), solution.pressure_mpa > 0
    if elastomer.law == "linear" and (surface >= ground.thickness_mm)[touched].any():
        raise T2TwinError(
            f"{command.force_n:g} N push {shape.name} through the {elastomer.name} layer of "
            f"{elastomer.thickness_mm:g} mm; take a smaller force or a thicker or stiffer layer"
        )
    base = shape.base_mm
    return Contact(
        surface_mm=surface.astype(np.float32),
        pressure_kpa=(1e3 * solution.pressure_mpa).astype(np.float32),
        x_mm=ground.x_mm,
        y_mm=ground.y_mm,
        contact_area_mm2=float(shares[touched].sum() * pitch_mm**2),
        depth_mm=solution.depth_mm,
        shape_depth_mm=solution.depth_mm + first_touch,
        force_n=float(solution.pressure_mpa.sum() * pitch_mm**2),
        settled=settled,
        bottomed=base is not None and bool((heights[touched] <= base + BASE_TOLERANCE_MM).any()),
        milliseconds=1e3 * (time.perf_counter() - started - solution.compiling_s),
    )


def check_force(force_n: float) -> None:
    low, high = FORCE_RANGE_N
    if not low <= force_n <= high:
        raise T2TwinError(
            f"a force of {force_n:g} N cannot be pressed; allowed are {low:g} to {high:g} N"
        )


def _gap_mm(
    shape: Shape, command: Press, ground: Layer, heights: np.ndarray
) -> tuple[np.ndarray, float]:
    """How far each cell's surface is from the shape at first touch, (rows, columns), mm, >= 0.

    And how far the shape's highest point lies below the apex then, mm.
    """
    distance = -ground.rest_mm - heights
    nearest = float(distance.min())
    if nearest > -NOTHING_MM / 2:
        raise T2TwinError(
            f"{shape.name} at x {command.x_mm:g} mm, y {command.y_mm:g} mm lies beside the "
            f"{ground.elastomer.name} pad, which reaches {ground.elastomer.width_mm / 2:g} mm in x "
            f"and {ground.elastomer.length_mm / 2:g} mm in y from its middle"
        )
    return distance - nearest, nearest


class _Solution:
    """The state of one press while it comes to rest, worked out in a window around the contact.

    pressure_mpa: on the layer's whole grid.
    """

    def __init__(
        self, ground: Layer, gap_mm: np.ndarray, shares: np.ndarray, force_n: float
    ) -> None:
        self.ground = ground
        self.gap_mm = gap_mm
        self.edge_compliance = _edge_compliance(ground, shares)
        self.force_n = force_n
        self.compiling_s = 0.0
        self.pressure_mpa = np.zeros(gap_mm.shape)
        # The springs' compliance D, mm/MPa, for the contact that they themselves expect.
        self.compliance = SPRING_SHARE * ground.largest_compliance_mm_per_mpa(gap_mm.shape)
        for _ in range(GUESSES):
            self.depth_mm = winkler_depth_mm(gap_mm, self.force)
            self.pins = _grown(gap_mm < self.depth_mm)
            span = tuple(part.stop - part.start for part in _window(self.pins))
            self.compliance = SPRING_SHARE * ground.largest_compliance_mm_per_mpa(span)

    @property
    def force(self) -> float:
        """The commanded force in pin springs x mm."""
        return self.force_n * self.compliance / self.ground.pitch_mm**2

    def surface_mm(self) -> np.ndarray:
        """The deflection of the whole surface, mm."""
        return self._by_law(self.ground.deflection_mm(self.pressure_mpa), WHOLE)[0]

    def solve(self) -> bool:
        """Bring the press to rest; False where it had not settled after MOST_STEPS."""
        steps_left = MOST_STEPS
        while True:
            settled, steps = self._settle(steps_left)
            steps_left -= steps
            missed = (self.depth_mm - self.gap_mm > self.surface_mm() + MISSED_MM) & ~self.pins
            if not missed.any():
                return settled
            if steps_left <= 0:
                return False
            self.pins |= _grown(missed)
            span = tuple(part.stop - part.start for part in _window(self.pins))
            self.compliance = SPRING_SHARE * self.ground.largest_compliance_mm_per_mpa(span)

    def _by_law(
        self, linear_mm: np.ndarray, window: tuple[slice, slice]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Deflection by the elastomer's law from the linear layer's, and its slope."""
        if self.ground.elastomer.law == "linear":
            return linear_mm, np.ones_like(linear_mm)
        return neo_hookean_mm(linear_mm, self.ground.thickness_mm[window])

    def _settle(self, most_steps: int) -> tuple[bool, int]:
        """Iterate on the pins as they are: whether it came to rest, and the steps it took."""
        window = _window(self.pins)
        here = self.pins[window]
        edge = self.edge_compliance[window]
        bed_of_pins = self._lay()
        last = self.pressure_mpa[window]
        ahead, momentum = last, 1.0
        for step in range(1, most_steps + 1):
            linear = self.ground.deflection_mm(ahead, window) + edge * ahead
            surface, slope = self._by_law(linear, window)
            # A stiffened place is stiffer in its pin's spring too.
            local = (self.compliance + edge) * np.maximum(slope, LEAST_SLOPE)
            rest = (surface - local * ahead)[here]
            pin_compliance = local[here]
            self.depth_mm, deflection = bed_of_pins.push(
                self.force, rest, self.compliance / pin_compliance
            )
            pressure = np.zeros(here.shape)
            pressure[here] = np.maximum(deflection - rest, 0.0) / pin_compliance
            change = pressure - last
            if ((ahead - pressure) * change).sum() > 0:
                ahead, momentum = pressure, 1.0
            else:
                grown = (1 + np.sqrt(1 + 4 * momentum**2)) / 2
                ahead, momentum = pressure + (momentum - 1) / grown * change, grown
            last = pressure
            self.pressure_mpa[window] = pressure
            if np.abs(change).sum() < AT_REST * pressure.sum():
                return True, step
        return False, most_steps

    def _lay(self) -> Bed:
        pins = int(np.count_nonzero(self.pins))
        if pins > POOL_SIZES[-1]:
            raise T2TwinError(
                f"the contact covers more than {POOL_SIZES[-1]} grid cells; take a coarser grid"
            )
        here = self.pins
        x, y = np.meshgrid(self.ground.x_mm, self.ground.y_mm)
        asked = time.perf_counter()
        laid = bed(pins)
        self.compiling_s += time.perf_counter() - asked
        laid.lay(x[here], y[here], self.ground.rest_mm[here], self.gap_mm[here], self.depth_mm)
        return laid


def _edge_compliance(ground: Layer, shares: np.ndarray) -> np.ndarray:
    """What a cell at a shape's edge gives way more than one within it, mm/MPa.

    A cell covered by a share c carries its force on that share, and a punch's pressure rises
    towards its edge, which a pressure constant on cells cannot: both matter only in edge cells,
    and are put right by EDGE_SHARE / c - EDGE_RISE times the cell's own compliance.
    """
    elastomer = ground.elastomer
    own = SQUARE_MEAN * (1 - elastomer.poisson**2) / elastomer.young_mpa * ground.pitch_mm
    covered = shares > 0
    inner = np.asarray(ndimage.binary_erosion(covered, border_value=1), dtype=bool)
    within = inner & (shares >= 1.0)
    wanted = own * (EDGE_SHARE / np.maximum(shares, LEAST_COVER) - EDGE_RISE)
    return np.where(covered & ~within, wanted, 0.0)


def _grown(mask: np.ndarray) -> np.ndarray:
    """The mask and MARGIN_CELLS around it."""
    square = np.ones((2 * MARGIN_CELLS + 1, 2 * MARGIN_CELLS + 1), bool)
    return np.asarray(ndimage.binary_dilation(mask, square), dtype=bool)


def _window(mask: np.ndarray) -> tuple[slice, slice]:
    """Rows and columns that hold the mask, in steps of WINDOW_CELLS so that few sizes occur."""
    spans = []
    for axis in (1, 0):
        found = np.flatnonzero(mask.any(axis=axis))
        length = mask.shape[1 - axis]
        size = min(-(-(found[-1] + 1 - found[0]) // WINDOW_CELLS) * WINDOW_CELLS, length)
        start = min(found[0], length - size)
        spans.append(slice(start, start + size))
    return spans[0], spans[1]


def winkler_depth_mm(gap_mm: np.ndarray, force: float) -> float:
    """Depth at which independent unit springs under the gaps carry the force (springs x mm)."""
    gaps = np.sort(gap_mm.ravel())
    depths = (force + np.cumsum(gaps)) / np.arange(1, gaps.size + 1)
    return float(depths[np.argmax(depths <= np.append(gaps[1:], np.inf))])
