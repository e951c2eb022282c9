"""The real gel as a solid: finite elements of its dome, its free sides and its bonded base.

An independent answer to what `t2twin.sim.contact.layer` takes for a laterally unbounded layer of
the local thickness. Small strain, linear elastic; trilinear hexahedra with mean dilatation (Hughes,
The Finite Element Method, 1987, section 4.5), which do not lock near incompressibility. The base
is bonded, sides and top are free. A rigid shape, given by its gaps over the top's nodes, is
pressed on without friction.

The gel has two mirror planes, so a load is the sum of four that are even or odd about each, and
a quarter of the gel answers each of them: four small factorisations instead of a large one, and
then four small dense matrices say how the whole top answers.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy import linalg, sparse

from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.elastomer import Elastomer

LAYERS_TIMES_PITCH_MM = 3.0
"""Layers of elements times the columns' pitch, mm: 6 layers at 0.5 mm, 12 at 0.25 mm."""

GRADING = 3.0
"""Thickness of the lowest elements over that of the topmost, about."""

COARSEST_MM = 3.0
"""Widest column away from the finely divided middle, mm."""

GROWTH = 1.25
"""Width of a column over its inner neighbor's, away from the middle."""

SLOPE_STEP_MM = 1e-4
"""Distance over which the surface's slope is taken, mm."""

MAX_ROUNDS = 60
"""Changes of the contact after which a press is given up."""

CORNERS = np.array(list(product((-1, 1), (-1, 1), (-1, 1))), dtype=float)[:, ::-1]
"""Reference coordinates of an element's nodes, (8, 3): x runs fastest, then y, then z."""


@dataclass(frozen=True)
class Mesh:
    """nodes_mm: (n, 3). hexahedra: (m, 8) node numbers in the order of CORNERS."""

    nodes_mm: np.ndarray
    hexahedra: np.ndarray


@dataclass(frozen=True)
class Answer:
    """A press at rest: depth_mm of the shape from gap 0; on the gel's nodes (ny, nx): force_n,
    each node's vertical force, and deflection_mm, how far the surface went in."""

    depth_mm: float
    force_n: np.ndarray
    deflection_mm: np.ndarray


def half_axis_mm(extent_mm: float, pitch_mm: float, fine_mm: float) -> np.ndarray:
    """Nodes from 0 to extent_mm, rising, mm: pitch_mm apart up to fine_mm, then ever wider.

    Multiples of the pitch up to fine_mm, so that a shape that moves by some meets the same nodes.
    """
    count = int(min(extent_mm, fine_mm) / pitch_mm + 1e-9)
    nodes = [i * pitch_mm for i in range(count + 1)]
    width = pitch_mm
    while extent_mm - nodes[-1] > 1e-9:
        # The last column takes the rest, so that none is a sliver.
        width = min(width * GROWTH, COARSEST_MM) if nodes[-1] >= fine_mm - 1e-9 else pitch_mm
        rest = extent_mm - nodes[-1]
        nodes.append(nodes[-1] + width if rest > 1.5 * width else extent_mm)
    return np.array(nodes)


def quarter(elastomer: Elastomer, x_mm: np.ndarray, y_mm: np.ndarray, layers: int) -> Mesh:
    """The quarter x, y >= 0 of the gel, columns between the given nodes (both from 0, rising).

    Nodes are numbered z-slowest; z is 0 at the base and the local thickness at the top. Layers
    follow the surface and are thinner towards it.
    """
    down = np.linspace(0.0, 1.0, layers + 1)
    share = (1 - GRADING**-down) / (1 - 1 / GRADING)
    y, x = np.meshgrid(y_mm, x_mm, indexing="ij")
    z = share[:, None, None] * elastomer.thickness_at_mm(x, y)
    nodes = np.stack([np.broadcast_to(x, z.shape), np.broadcast_to(y, z.shape), z], axis=-1)
    number = np.arange(z.size).reshape(z.shape)
    corners = [
        number[a : a + layers, b : b + y_mm.size - 1, c : c + x_mm.size - 1].ravel()
        for a, b, c in product((0, 1), (0, 1), (0, 1))
    ]
    return Mesh(nodes.reshape(-1, 3), np.stack(corners, axis=1))


def stiffness(mesh: Mesh, young_mpa: float, poisson: float) -> sparse.csr_matrix:
    """Stiffness of the mesh with nothing held, (3 n, 3 n), N/mm; unknowns x, y, z node by node.

    Raises T2TwinError where an element is inside out.
    """
    places = mesh.nodes_mm[mesh.hexahedra]
    gradients, volumes = [], []
    for point in CORNERS / np.sqrt(3):
        slopes = _slopes(point)
        jacobian = np.einsum("ki,ekj->eij", slopes, places)
        volume = np.linalg.det(jacobian)
        if (volume <= 0).any():
            raise T2TwinError("an element of the mesh is inside out; take flatter elements")
        gradients.append(np.einsum("ki,eji->ekj", slopes, np.linalg.inv(jacobian)))
        volumes.append(volume)
    gradient, volume = np.stack(gradients), np.stack(volumes)
    mean = np.einsum("ge,gekj->ekj", volume, gradient) / volume.sum(axis=0)[:, None, None]

    shear = young_mpa / (2 * (1 + poisson))
    bulk = young_mpa / (3 * (1 - 2 * poisson))
    # 2 G (e : e - tr(e)^2 / 3) from the local strain, K tr^2 from the mean dilatation; with
    # A = gradient x gradient, e : e is half of the diagonal plus the transposed product.
    outer = np.einsum("ge,geki,gelj->ekilj", volume, gradient, gradient, optimize=True)
    diagonal = np.einsum("ekili->ekl", outer)
    local = shear * (
        np.einsum("ekl,ij->ekilj", diagonal, np.eye(3))
        + outer.transpose(0, 1, 4, 3, 2)
        - 2 / 3 * outer
    )
    whole = local + bulk * np.einsum(
        "e,eki,elj->ekilj", volume.sum(axis=0), mean, mean, optimize=True
    )
    unknowns = (3 * mesh.hexahedra[:, :, None] + np.arange(3)).reshape(len(places), 24)
    rows = np.repeat(unknowns, 24, axis=1)
    columns = np.tile(unknowns, (1, 24))
    size = mesh.nodes_mm.size
    return sparse.csr_matrix(
        (whole.reshape(-1), (rows.ravel(), columns.ravel())), shape=(size, size)
    )


def _slopes(point: np.ndarray) -> np.ndarray:
    """Derivatives of the eight shape functions at a reference point, (8, 3)."""
    one = 1 + CORNERS * point
    return (
        np.stack(
            [
                CORNERS[:, 0] * one[:, 1] * one[:, 2],
                CORNERS[:, 1] * one[:, 0] * one[:, 2],
                CORNERS[:, 2] * one[:, 0] * one[:, 1],
            ],
            axis=1,
        )
        / 8
    )


class Gel:
    """Compliance of the top of a domed, bounded gel.

    x_mm (nx,), y_mm (ny,): the nodes' axes over the whole gel. area_mm2 (ny, nx): the part of the
    top, seen from above, that is nearest to each node.
    along_normal: forces are normal to the unloaded surface, and deflection is the change of its
    height at a fixed place, as in frictionless contact with small slopes. Otherwise forces and
    deflection are vertical.
    """

    def __init__(
        self,
        elastomer: Elastomer,
        pitch_mm: float,
        fine_mm: float = np.inf,
        along_normal: bool = False,
    ) -> None:
        half_x = half_axis_mm(elastomer.width_mm / 2, pitch_mm, fine_mm)
        half_y = half_axis_mm(elastomer.length_mm / 2, pitch_mm, fine_mm)
        # A rough guess of the pressure it answers with: springs of half a free column's compliance.
        self.foundation_mm_per_mpa = elastomer.thickness_mm / elastomer.young_mpa / 2
        mesh = quarter(elastomer, half_x, half_y, round(LAYERS_TIMES_PITCH_MM / pitch_mm))
        whole = stiffness(mesh, elastomer.young_mpa, elastomer.poisson)
        self.x_mm = np.concatenate([-half_x[:0:-1], half_x])
        self.y_mm = np.concatenate([-half_y[:0:-1], half_y])
        x, y = np.meshgrid(self.x_mm, self.y_mm)
        self.rest_mm = elastomer.rest_surface_mm(x, y)
        self.area_mm2 = np.outer(_tributary(self.y_mm), _tributary(self.x_mm))

        # Where in the quarter each node's mirror image is, and on which sides it lies.
        column = np.abs(np.arange(self.x_mm.size) - half_x.size + 1)
        row = np.abs(np.arange(self.y_mm.size) - half_y.size + 1)
        self._image = (row[:, None] * half_x.size + column[None, :]).ravel()
        self._sides = np.stack([np.sign(x).ravel(), np.sign(y).ravel()])

        if along_normal:
            turn = _along_normal(mesh, elastomer, half_x.size * half_y.size)
            whole = (turn.T @ whole @ turn).tocsr()
        self._blocks = {
            parity: _compliance(mesh, whole, half_x, half_y, parity)
            for parity in product((1, -1), (1, -1))
        }

    def deflection_mm(self, force_n: np.ndarray) -> np.ndarray:
        """Deflection of the top's nodes under downward forces on them, both (ny, nx)."""
        sunk_mm = np.zeros(self._image.size)
        for parity, block in self._blocks.items():
            signs = self._signs(parity)
            load = np.bincount(self._image, signs * force_n.ravel(), minlength=len(block))
            sunk_mm += signs * (block @ load)[self._image]
        return sunk_mm.reshape(force_n.shape)

    def compliance(self, nodes: np.ndarray) -> np.ndarray:
        """Deflections of some nodes per force on each, mm/N, (n, n); nodes: flat numbers (n,)."""
        answers = np.zeros((nodes.size, nodes.size))
        image = np.ix_(self._image[nodes], self._image[nodes])
        for parity, block in self._blocks.items():
            signs = self._signs(parity)[nodes]
            answers += signs[:, None] * signs[None, :] * block[image]
        return answers

    def _signs(self, parity: tuple[int, int]) -> np.ndarray:
        """+1 or -1 where a load that is even or odd about the planes is the quarter's or its
        negative, (nodes,); 0 on a plane that it is odd about."""
        by_axis = [
            np.ones(self._image.size) if even == 1 else side
            for even, side in zip(parity, self._sides, strict=True)
        ]
        return by_axis[0] * by_axis[1]


def _compliance(
    mesh: Mesh,
    whole: sparse.csr_matrix,
    half_x: np.ndarray,
    half_y: np.ndarray,
    parity: tuple[int, int],
) -> np.ndarray:
    """How the top's last unknowns answer an even or odd load, mm/N, (nodes of the top,) * 2.

    A load on the whole gel is the mean of its four parities, of which the quarter feels a fourth.
    Slices of nodes along y are condensed one after the other onto the top (static condensation),
    so that no more than one slice and the top are ever dense.
    """
    held = np.zeros((len(mesh.nodes_mm), 3), bool)
    held[mesh.nodes_mm[:, 2] == 0] = True
    for axis, even in enumerate(parity):
        across = np.arange(3) == axis
        held[mesh.nodes_mm[:, axis] == 0] |= across if even == 1 else ~across
    lie = np.arange(len(mesh.nodes_mm)).reshape(-1, half_y.size, half_x.size)
    kept = np.zeros_like(held)
    kept[lie[-1], 2] = True
    top = np.zeros(0, int)
    inner = np.zeros(0, int)
    dense = np.zeros((0, 0))
    for row in range(half_y.size + 1):
        nodes = lie[:, row].ravel() if row < half_y.size else np.zeros(0, int)
        unknowns = (3 * nodes[:, None] + np.arange(3)).ravel()
        unknowns = unknowns[~held.ravel()[unknowns]]
        rising = kept.ravel()[unknowns]
        new = np.concatenate([unknowns[rising], unknowns[~rising]])
        # The slice before: its inner unknowns go, the top's stay and meet the new slice.
        n, m = top.size, inner.size
        meets_top, meets_inner = (whole[part][:, new].toarray() for part in (top, inner))
        if m:
            lower = linalg.cholesky(dense[n:, n:], lower=True, check_finite=False)
            taken = linalg.solve_triangular(
                lower, np.hstack([dense[n:, :n], meets_inner]), lower=True, check_finite=False
            )
        else:
            taken = np.zeros((0, n + new.size))
        after = -(taken.T @ taken)
        after[:n, :n] += dense[:n, :n]
        after[:n, n:] += meets_top
        after[n:, :n] += meets_top.T
        after[n:, n:] += whole[new][:, new].toarray()
        dense = after
        top = np.concatenate([top, unknowns[rising]])
        inner = unknowns[~rising]
    answers = np.zeros((half_x.size * half_y.size,) * 2)
    places = top // 3 - int(lie[-1, 0, 0])
    answers[np.ix_(places, places)] = np.linalg.inv(dense) / 4
    return (answers + answers.T) / 2


def _tributary(axis_mm: np.ndarray) -> np.ndarray:
    """Length nearest to each node of an axis, mm."""
    widths = np.diff(axis_mm)
    return (np.append(widths, 0.0) + np.insert(widths, 0, 0.0)) / 2


def _along_normal(mesh: Mesh, elastomer: Elastomer, on_top: int) -> sparse.csr_matrix:
    """Displacements from unknowns of which the top's z is the rise of the surface at a fixed
    place, u_z - s_x u_x - s_y u_y with the surface's slopes s; what works on it is the vertical
    part of a force along the normal."""
    top = np.arange(len(mesh.nodes_mm) - on_top, len(mesh.nodes_mm))
    x, y = mesh.nodes_mm[top, 0], mesh.nodes_mm[top, 1]
    rest = elastomer.rest_surface_mm(x, y)
    # Differences to the inside, for the surface ends at the rim.
    inner_x, inner_y = np.abs(x - SLOPE_STEP_MM), np.abs(y - SLOPE_STEP_MM)
    along_x = (rest - elastomer.rest_surface_mm(inner_x, y)) / SLOPE_STEP_MM
    along_y = (rest - elastomer.rest_surface_mm(x, inner_y)) / SLOPE_STEP_MM
    size = mesh.nodes_mm.size
    every = np.arange(size)
    return sparse.csr_matrix(
        (
            np.concatenate([np.ones(size), along_x, along_y]),
            (
                np.concatenate([every, 3 * top + 2, 3 * top + 2]),
                np.concatenate([every, 3 * top, 3 * top + 1]),
            ),
        ),
        shape=(size, size),
    )


def solve(gel: Gel, gap_mm: np.ndarray, force_n: float) -> Answer:
    """A rigid shape on the gel under a force.

    gap_mm: (ny, nx) height of the shape above each node, from any datum. The iteration starts with
    the contact nodes of independent springs. Nodes with tension leave the contact, and nodes inside
    the shape enter. The forces are solved exactly. Raises T2TwinError without convergence.
    """
    gaps = gap_mm.ravel()
    touching = gaps < _foundation_depth_mm(gel, gaps, force_n)
    for _ in range(MAX_ROUNDS):
        nodes = np.flatnonzero(touching)
        factor = linalg.cho_factor(gel.compliance(nodes))
        unit = linalg.cho_solve(factor, np.stack([np.ones(nodes.size), gaps[nodes]], axis=1))
        depth = (force_n + unit[:, 1].sum()) / unit[:, 0].sum()
        forces = np.zeros(gaps.size)
        forces[nodes] = depth * unit[:, 0] - unit[:, 1]
        deflection = gel.deflection_mm(forces.reshape(gap_mm.shape)).ravel()
        through = ~touching & (depth - gaps > deflection + 1e-9)
        pulled = forces < 0
        if not (through.any() or pulled.any()):
            shape = gap_mm.shape
            return Answer(float(depth), forces.reshape(shape), deflection.reshape(shape))
        touching = (touching | through) & ~pulled
    raise T2TwinError(f"the contact did not come to rest within {MAX_ROUNDS} rounds")


def _foundation_depth_mm(gel: Gel, gaps_mm: np.ndarray, force_n: float) -> float:
    """Depth at which independent springs under the gaps carry the force."""
    order = np.argsort(gaps_mm)
    gaps, area = gaps_mm[order], np.cumsum(gel.area_mm2.ravel()[order])
    moment = np.cumsum(gel.area_mm2.ravel()[order] * gaps)
    depths = (force_n * gel.foundation_mm_per_mpa + moment) / area
    return float(depths[np.argmax(depths <= np.append(gaps[1:], np.inf))])
