"""Several bodies on one sensor: one height map, and what each body carries.

The height map is the highest of the bodies' maps, each moved into the sensor by its own depth. The
depths are corrected until each body carries its normal force.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from t2twin.primitives_cad.shape import NOTHING_MM, HeightMap, Shape
from t2twin.sim.contact.contact_solver import solve_contact
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.heights import heights_at
from t2twin.sim.contact.loads.prescribed import Load
from t2twin.sim.contact.types import Contact, Motion, PressCommand

FORCE_TOLERANCE, SHARE_TOLERANCE = 5e-3, 2e-4
"""Tolerance of each body's normal force: a share of its force, or of the force of all bodies where
that is more (assumed)."""

HERTZ_EXPONENT = 1.5
"""Exponent of the force of a ball over its depth (Hertz 1882), for a first stiffness."""

MAX_STIFFENING = 4.0
"""Largest factor between two estimates of a body's stiffness (assumed)."""

MAX_SWEEPS, MAX_CORRECTIONS = 8, 20
"""Limits on the sweeps over several bodies, and on the corrections of one in a sweep (assumed)."""

MAX_STEP_MM, MIN_INTERVAL_MM = 0.1, 1e-5
"""Largest first correction of a depth, and length of the interval of the depth below which the
force jumps within it, mm (assumed)."""

MIN_DEPTH_MM = 1e-3
"""Least depth of a body that a stiffness is estimated from, mm (assumed)."""


@dataclass(frozen=True, kw_only=True)
class BodiesMotion(Motion):
    """Motion of a contact under prescribed loads.

    bodies: their names, n. owner: (ny, nx) index of the body over each cell. depths_mm: (n,) depth
    of each body's highest point below the apex of the undeformed surface. stiffness: (n,) change of
    each body's force with its depth, N/mm.
    """

    bodies: tuple[str, ...]
    owner: np.ndarray
    depths_mm: np.ndarray
    stiffness: np.ndarray


class Bodies:
    """The bodies of one contact, at depths that are to be found.

    loads: of the bodies. elastomer, pitch_mm: of the contact's grid. last: the last contact's
    motion. Attributes: depths_mm, stiffness, as in BodiesMotion.
    Raises OffPadError where a body that was not in the last contact is not over the pad.
    """

    def __init__(
        self, loads: Sequence[Load], elastomer: Elastomer, pitch_mm: float, last: Motion | None
    ) -> None:
        self.loads = loads
        self.forces = np.array([load.force_n for load in loads])
        self.names = tuple(load.shape.name for load in loads)
        self.command = PressCommand(self.names[0], 0.0, 0.0, 0.0, float(self.forces.sum()))
        self.depths_mm, self.stiffness = np.zeros((2, len(loads)))
        if len(loads) == 1:
            return
        self.command = replace(self.command, shape=" and ".join(self.names))
        self._maps = _on_one_grid([load.shape.surface for load in loads])
        several = last if isinstance(last, BodiesMotion) and len(last.bodies) > 1 else None
        for body, load in enumerate(loads):
            if several is not None and self.names[body] in several.bodies:
                known = several.bodies.index(self.names[body])
                self.depths_mm[body] = several.depths_mm[known]
                self.stiffness[body] = several.stiffness[known]
                continue
            command = PressCommand(self.names[body], 0.0, 0.0, 0.0, load.force_n)
            alone = solve_contact(load.shape, command, elastomer, pitch_mm)
            self.depths_mm[body] = alone.shape_depth_mm
            depth_mm = max(alone.depth_mm, MIN_DEPTH_MM)
            self.stiffness[body] = HERTZ_EXPONENT * load.force_n / depth_mm
        self._top_mm = 0.0

    def shape(self) -> Shape:
        """The bodies at their depths as one shape."""
        first = self.loads[0].shape
        if len(self.loads) == 1:
            return first
        offsets = self.depths_mm - self.depths_mm.max()
        heights = [
            each.heights_mm + np.float32(offset)
            for each, offset in zip(self._maps, offsets, strict=True)
        ]
        highest = np.maximum.reduce(heights)
        self._top_mm = float(highest.max())
        highest = np.maximum(highest - highest.max(), np.float32(NOTHING_MM))
        surface = HeightMap(highest, self._maps[0].x_mm, self._maps[0].y_mm)
        return Shape(self.command.shape, first.mesh, surface, first.spacing_mm)

    def owner(self, contact: Contact) -> np.ndarray:
        """(ny, nx) index of the body over each cell of a contact, or of the nearest body."""
        if len(self.loads) == 1:
            return np.zeros(contact.pressure_kpa.shape, int)
        x, y = contact.x_mm.copy(), contact.y_mm.copy()
        shift = contact.shift
        heights = np.stack(
            [
                heights_at(each, self.command, x, y, shift) + depth
                for each, depth in zip(self._maps, self.depths_mm, strict=True)
            ]
        )
        nothing = heights.max(axis=0) < NOTHING_MM / 2
        nearest = ndimage.distance_transform_edt(
            nothing, return_distances=False, return_indices=True
        )
        rows, columns = np.asarray(nearest)
        return heights.argmax(axis=0)[rows, columns]

    def balance(self, press: Callable[[Shape], Contact]) -> None:
        """Correct the depths until each body carries its force in a press of all.

        press: the contact of a shape without a change of the shear.
        """
        heaviest = int(self.forces.argmax())
        others = [body for body in range(len(self.loads)) if body != heaviest]
        contact = press(self.shape())
        for _ in range(MAX_SWEEPS):
            if self.carries(contact):
                return
            for body in others:
                contact = self._balance_one(body, press, contact)

    def _balance_one(
        self, body: int, press: Callable[[Shape], Contact], contact: Contact
    ) -> Contact:
        """Correct the depth of a body relative to the others; returns the contact at the depths.

        Secant steps on its share of the force, which rises with the depth; halves the interval
        where a step leaves it. contact: at the present depths.
        """
        low, high, last, step_mm = -np.inf, np.inf, None, 0.0
        for _ in range(MAX_CORRECTIONS):
            depth, missing = self.depths_mm[body], self._missing(contact)[body]
            if abs(missing) <= self._allowed()[body] or high - low < MIN_INTERVAL_MM:
                break
            low, high = (depth, high) if missing > 0 else (low, depth)
            if last is not None and last[1] != missing:
                secant = -(missing - last[1]) / (depth - last[0])
                near = self.stiffness[body] / MAX_STIFFENING, self.stiffness[body] * MAX_STIFFENING
                self.stiffness[body] = np.clip(secant, *near)
            last = depth, missing
            longest = 2 * abs(step_mm) if step_mm else MAX_STEP_MM
            step_mm = float(np.clip(missing / self.stiffness[body], -longest, longest))
            if not low < depth + step_mm < high:
                step_mm = float((low + high) / 2 - depth)
            self.depths_mm[body] = depth + step_mm
            contact = press(self.shape())
        return contact

    def carries(self, contact: Contact, share: float = SHARE_TOLERANCE) -> bool:
        """Whether each body carries its force in a contact; sets the depths to the contact's.

        share: of the force of all bodies by which the force of one may differ.
        """
        if len(self.loads) == 1:
            self.depths_mm = np.array([contact.shape_depth_mm])
            return True
        missing = self._missing(contact)
        self.depths_mm += contact.shape_depth_mm - self.depths_mm.max() - self._top_mm
        return bool((np.abs(missing) <= self._allowed(share)).all())

    def _allowed(self, share: float = SHARE_TOLERANCE) -> np.ndarray:
        """(n,) tolerance of the force of each body, N. share: as for `carries`."""
        return np.maximum(FORCE_TOLERANCE * self.forces, share * self.forces.sum())

    def _missing(self, contact: Contact) -> np.ndarray:
        """(n,) what the force of each body is below its load's, N."""
        owner = self.owner(contact)
        cells = 1e-3 * contact.pressure_kpa.astype(float) * contact.pitch_mm**2
        forces = np.bincount(owner.ravel(), cells.ravel(), len(self.loads))
        return self.forces * (forces.sum() / self.forces.sum()) - forces

    def motion(self, motion: Motion, owner: np.ndarray) -> BodiesMotion:
        """A motion with the bodies."""
        plain = {name: getattr(motion, name) for name in Motion.__dataclass_fields__}
        return BodiesMotion(
            **plain,
            bodies=self.names,
            owner=owner,
            depths_mm=self.depths_mm,
            stiffness=self.stiffness,
        )


def kept_traction(motion: Motion, name: str, names: tuple[str, ...], owner: np.ndarray) -> Motion:
    """A motion whose traction is zero where another body is over a cell than before.

    name: of the body of a motion that is not a BodiesMotion. names, owner: the bodies now.
    """
    before, indices = (name,), np.zeros(owner.shape, int)
    if isinstance(motion, BodiesMotion):
        before, indices = motion.bodies, motion.owner
    if before == names and len(names) == 1:
        return motion
    same = np.array(before)[indices] == np.array(names)[owner]
    return replace(motion, shear_mpa=motion.shear_mpa * same, response=None)


def _on_one_grid(maps: Sequence[HeightMap]) -> list[HeightMap]:
    """Height maps on the same axes: those of the finest pitch that reach as far as all maps."""
    first = maps[0]
    if all(
        np.array_equal(each.x_mm, first.x_mm) and np.array_equal(each.y_mm, first.y_mm)
        for each in maps
    ):
        return list(maps)
    pitch = min(each.pitch_mm for each in maps)
    x, y = (
        np.arange(
            min(getattr(each, axis)[0] for each in maps),
            max(getattr(each, axis)[-1] for each in maps) + pitch / 2,
            pitch,
        )
        for axis in ("x_mm", "y_mm")
    )
    across, down = np.meshgrid(x, y)
    return [HeightMap(each.sample(across, down), x, y) for each in maps]
