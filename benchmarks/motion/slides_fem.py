"""A rigid shape that slides on a bonded block, as finite elements in CalculiX.

An independent answer to `t2twin.sim.contact.friction`: small strain, linear elastic, hexahedra
with incompatible modes (C3D8I), surface-to-surface penalty contact with Coulomb friction. The shape
is the master surface: with its normals, the force of gross sliding is the limit of friction. The
block is bonded at its base and wide enough to be unbounded. All slides are along x, so half the
block, y >= 0, is enough. The shape is rigid: all its nodes have a prescribed motion.

The shape is first pressed to a depth without friction, then slides at this depth.
"""

import re
import shutil
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from t2twin.core.errors import T2TwinError

PROGRAM = "ccx"
"""CalculiX's solver, of Debian's package calculix-ccx."""

LAYERS = 6
"""Layers of elements through the block."""

GRADING = 10.0
"""Thickness of the lowest elements over that of the topmost, about."""

GROWTH, INWARD, WIDEST_MM = 1.6, 1.4, 2.5
"""Width of a column over that of its neighbor, away from the contact and inward from an edge, and
the largest, mm."""

PENALTY, STICK = 200.0, 40.0
"""Stiffness of the contact, pressure per overlap and shear per sliding where it sticks, times the
Young's modulus a millimetre."""

FACE_MM = 0.2
"""Width of the shape's faces, mm."""

PRESS_STEP, SLIDE_STEP = 0.5, 0.2
"""Largest increments, as shares of the press and of the slide."""

FACES = ((4, 3, 2, 1), (5, 6, 7, 8))
"""Nodes of a hexahedron's lower and upper faces S1 and S2."""


@dataclass(frozen=True)
class Slide:
    """A slide along x of a rigid shape on a block.

    heights_mm: of the shape's pressing surface above its lowest point, mm, of x and y, each >= 0.
    reach_mm: half the width of the square in which the shape may touch. depth_mm: of the press.
    slide_mm: length of the slide. side_mm: half the block's width. pitch_mm: of the elements at the
    contact. markers_mm: (n, 2) places on the surface, y >= 0. has_edge: whether the shape has an
    edge all around at reach_mm.
    """

    heights_mm: Callable[[np.ndarray, np.ndarray], np.ndarray]
    reach_mm: float
    depth_mm: float
    slide_mm: float
    friction: float
    thickness_mm: float
    young_mpa: float
    poisson: float
    side_mm: float
    pitch_mm: float
    markers_mm: np.ndarray
    has_edge: bool = False


@dataclass(frozen=True)
class Solved:
    """The states from the end of the press on, n of them.

    moved_mm: (n,) of the shape. normal_n, tangential_n: (n,) force of the whole shape.
    markers_mm: (n, m, 2) displacement of the markers along x and y.
    """

    moved_mm: np.ndarray
    normal_n: np.ndarray
    tangential_n: np.ndarray
    markers_mm: np.ndarray

    def after_press(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Forces and markers of the states after the first."""
        return self.normal_n[1:], self.tangential_n[1:], self.markers_mm[1:]


def require_calculix() -> None:
    """Raises T2TwinError if CalculiX is not installed."""
    if shutil.which(PROGRAM) is None:
        raise T2TwinError(f"CalculiX ({PROGRAM}) is not installed; apt-get install calculix-ccx")


def solve(slide: Slide, folder: Path) -> Solved:
    """Write the deck of a slide into a folder, run CalculiX, and read its results.

    Raises T2TwinError if CalculiX fails.
    """
    axes = _axes(slide)
    (folder / "slide.inp").write_text("\n".join(_deck(slide, axes)))
    environment = {"OMP_NUM_THREADS": "1", "PATH": "/usr/bin:/bin"}
    done = subprocess.run(
        ["nice", "-n", "19", PROGRAM, "slide"],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode or "*ERROR" in done.stdout or "Job finished" not in done.stdout:
        raise T2TwinError(f"CalculiX failed:\n{done.stdout[-2000:]}")
    return _read(slide, axes, (folder / "slide.dat").read_text())


def _axes(slide: Slide) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes of the block along x, y and z."""
    right = _half_axis(slide, slide.reach_mm + slide.slide_mm)
    left = _half_axis(slide, slide.reach_mm)
    down = np.linspace(0.0, 1.0, LAYERS + 1)
    z = slide.thickness_mm * (1 - GRADING**-down) / (1 - 1 / GRADING)
    return np.concatenate([-left[:0:-1], right]), left, z


def _half_axis(slide: Slide, fine_mm: float) -> np.ndarray:
    """Nodes from 0 to the block's side: pitch_mm apart up to fine_mm, then ever wider; for a shape
    with an edge pitch_mm apart at the edge, and wider on both sides."""
    nodes, width = np.arange(0.0, fine_mm + slide.pitch_mm / 2, slide.pitch_mm), slide.pitch_mm
    if slide.has_edge:
        inward = np.cumsum(width * INWARD ** np.arange(20))
        inward = inward[: np.searchsorted(inward, slide.reach_mm) + 1]
        nodes = slide.reach_mm * (1 - np.concatenate([[0.0], inward]) / inward[-1])[::-1]
    while nodes[-1] < slide.side_mm:
        width = min(GROWTH * width, WIDEST_MM)
        nodes = np.append(nodes, nodes[-1] + width)
    return nodes


def _deck(slide: Slide, axes: tuple[np.ndarray, np.ndarray, np.ndarray]) -> Iterator[str]:
    """The lines of an input file."""
    x, y, z = axes
    block_nodes, block = _bricks(x, y, z)
    half = np.arange(round(slide.reach_mm / FACE_MM) + 1) * FACE_MM
    shape_nodes, shape = _bricks(np.concatenate([-half[:0:-1], half]), half, np.array([0.0, 1.0]))
    shape_nodes[:, 2] += slide.thickness_mm + slide.heights_mm(*shape_nodes[:, :2].T)
    first_node, first_element = len(block_nodes) + 1, len(block) + 1
    yield from _table("*NODE, NSET=ALL", 1, block_nodes)
    yield from _table("*NODE, NSET=SHAPE", first_node, shape_nodes)
    yield from _table("*ELEMENT, TYPE=C3D8I, ELSET=BLOCK", 1, block + 1)
    yield from _table("*ELEMENT, TYPE=C3D8, ELSET=RIGID", first_element, shape + first_node)
    number = np.arange(len(block_nodes)).reshape(z.size, y.size, x.size) + 1
    yield from _set("*NSET, NSET=BASE", number[0].ravel())
    yield from _set("*NSET, NSET=MIDDLE", number[1:, 0].ravel())
    yield from _set("*NSET, NSET=TOP", number[-1].ravel())
    top = np.arange(len(block)).reshape(z.size - 1, y.size - 1, x.size - 1)[-1] + 1
    near = np.abs((x[1:] + x[:-1]) / 2 - slide.slide_mm / 2) < slide.reach_mm + slide.slide_mm / 2
    near = near & ((y[1:] + y[:-1]) / 2 < slide.reach_mm)[:, None]
    yield from _set("*ELSET, ELSET=UPPER", top[near])
    yield from ("*SURFACE, NAME=BLOCK", "UPPER, S2", "*SURFACE, NAME=SHAPE", "RIGID, S1")
    penalty, stick = PENALTY * slide.young_mpa, STICK * slide.young_mpa
    yield f"""*MATERIAL, NAME=SOFT
*ELASTIC
{slide.young_mpa}, {slide.poisson}
*SOLID SECTION, ELSET=BLOCK, MATERIAL=SOFT
*SOLID SECTION, ELSET=RIGID, MATERIAL=SOFT
*SURFACE INTERACTION, NAME=TOUCH
*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR
{penalty}
*FRICTION
1e-6, {stick}
*CONTACT PAIR, INTERACTION=TOUCH, TYPE=SURFACE TO SURFACE
BLOCK, SHAPE
*BOUNDARY
BASE, 1, 3
MIDDLE, 2, 2
SHAPE, 1, 2
*STEP, INC=200
*STATIC
{PRESS_STEP}, 1., 1e-4, {PRESS_STEP}
*BOUNDARY
SHAPE, 3, 3, {-slide.depth_mm}
*NODE PRINT, NSET=SHAPE, TOTALS=ONLY
RF
*NODE PRINT, NSET=TOP
U
*END STEP
*STEP, INC=200
*CHANGE FRICTION, INTERACTION=TOUCH
*FRICTION
{slide.friction}, {stick}
*STATIC
{SLIDE_STEP}, 1., 1e-4, {SLIDE_STEP}
*BOUNDARY
SHAPE, 1, 1, {slide.slide_mm}
*END STEP"""


def _bricks(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (n, 3) and hexahedra (m, 8) of a box; x runs fastest."""
    places = np.stack(np.meshgrid(z, y, x, indexing="ij")[::-1], axis=-1)
    number = np.arange(places.size // 3).reshape(places.shape[:3])
    lower = [number[:, :-1, :-1], number[:, :-1, 1:], number[:, 1:, 1:], number[:, 1:, :-1]]
    corners = [each[:-1] for each in lower] + [each[1:] for each in lower]
    return places.reshape(-1, 3), np.stack(corners, axis=-1).reshape(-1, 8)


def _table(head: str, first: int, rows: np.ndarray) -> Iterator[str]:
    """A keyword, and numbered rows."""
    yield head
    for number, row in enumerate(rows.tolist(), start=first):
        yield ", ".join([str(number), *(f"{value:.9g}" for value in row)])


def _set(head: str, numbers: np.ndarray) -> Iterator[str]:
    yield head
    yield from (f"{number}," for number in numbers)


def _read(slide: Slide, axes: tuple[np.ndarray, np.ndarray, np.ndarray], text: str) -> Solved:
    """The results in a .dat file."""
    x, y, _ = axes
    parts = re.split(r"\n *(total force|displacements)[^\n]* time +(\S+)\n", text)[1:]
    forces = np.array([part.split() for part in parts[2::6]], float)
    times = np.array(parts[1::6], float)
    moved = [np.array(part.split(), float).reshape(-1, 4)[:, 1:3] for part in parts[5::6]]
    fields = RegularGridInterpolator((y, x), np.stack(moved, axis=1).reshape(y.size, x.size, -1, 2))
    kept = times >= 1 - 1e-9
    markers = fields(slide.markers_mm[:, ::-1]).swapaxes(0, 1)[kept]
    tangential_n, _, normal_n = 2 * np.abs(forces[kept].T)  # of both halves
    return Solved((times[kept] - 1) * slide.slide_mm, normal_n, tangential_n, markers)
