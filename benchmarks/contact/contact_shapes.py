"""Difficult shapes for the contact solver, made by code from a seed.

Each shape has flat faces or needle tips with vertical walls, and is tilted by up to TILT_DEG. All
faces lie within REACH_MM of the press axis, so that no sensor's pad cuts a shape.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import trimesh

from t2twin.primitives_cad.height_map import FILE_PITCH_MM, rounded_outline
from t2twin.primitives_cad.shape import NOTHING_MM, HeightMap, Shape

REACH_MM = 8.4
"""Largest distance of a face from the press axis, mm: the DIGIT's flat layer less an offset."""

TILT_DEG = 3.0
"""Largest tilt, degrees."""

NEEDLE_APART_MM = 0.6
"""Least free distance between needles, mm."""

ACROSS_MM = 0.02
"""Distance across the press axis between the points of a line of sight at which the solid of a
tilted case is tested, mm: less than any of its parts."""

SEEN_MM = 6.0
"""Depth below the press axis' origin to which the solid of a tilted case is seen, mm: more than a
layer and a tilt."""

BISECTIONS = 12
"""Halvings of the last distance between two of these points."""

Heights = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Heights at points x, y before the tilt, mm: 0 on faces, NOTHING_MM next to them."""


@dataclass(frozen=True)
class Case:
    """A shape, by its family and seed. parameters: its dimensions, mm, and tilt, degrees."""

    family: str
    seed: int
    heights: Heights
    parameters: dict[str, float]
    slope: tuple[float, float]

    @property
    def name(self) -> str:
        return f"{self.family}-{self.seed}"

    def tilted_mm(self, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
        """Exact heights at points of the shape frame, mm; NOTHING_MM next to the faces."""
        heights = self.heights(x_mm, y_mm)
        tilted = heights + self.slope[0] * x_mm + self.slope[1] * y_mm
        return np.where(heights > NOTHING_MM / 2, tilted, NOTHING_MM)

    def turned_mm(
        self, x_mm: np.ndarray, y_mm: np.ndarray, top_mm: float, rotation: np.ndarray
    ) -> np.ndarray:
        """Exact heights of the solid below the faces, turned about (0, 0, top_mm), above it.

        rotation: (3, 3), of a tilt. The sides of the solid are parallel to its axis. A point lies
        on the solid where the line of sight from above first meets it.
        """
        angle = np.arccos(rotation[2, 2])
        near = np.hypot(x_mm, y_mm) <= REACH_MM + SEEN_MM * np.sin(angle)
        points = x_mm[near, None] * rotation[0] + y_mm[near, None] * rotation[1]

        def is_solid(which: np.ndarray | slice, z_mm: np.ndarray | float) -> np.ndarray:
            x, y, z = (points[which] + np.multiply.outer(z_mm, rotation[2])).T
            return z <= self.tilted_mm(x, y) - top_mm

        step = ACROSS_MM / np.tan(angle)
        found, left = np.full(len(points), NOTHING_MM), np.arange(len(points))
        highest = REACH_MM * np.sin(angle) + ACROSS_MM
        for z_mm in np.arange(highest, -SEEN_MM, -step):
            met = is_solid(left, z_mm)
            found[left[met]], left = z_mm, left[~met]
        hits = np.flatnonzero(found > NOTHING_MM / 2)
        low, high = found[hits], found[hits] + step
        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            solid = is_solid(hits, middle)
            low, high = np.where(solid, middle, low), np.where(solid, high, middle)
        found[hits] = low
        heights = np.full(x_mm.shape, NOTHING_MM)
        heights[near] = found
        return heights

    def shape(self, pitch_mm: float = FILE_PITCH_MM) -> tuple[Shape, float]:
        """The shape with a height map of a pitch, mm, made as for shapes from files, and its top,
        mm: the height before it was moved to 0. Its mesh is not used."""
        half = int(np.ceil(REACH_MM / pitch_mm)) + 2
        axis = pitch_mm * np.arange(-half, half + 1)
        x, y = np.meshgrid(axis, axis)
        heights = rounded_outline(lambda dx, dy: self.tilted_mm(x + dx, y + dy), pitch_mm)
        top = float(heights.max())
        surface = np.where(heights > NOTHING_MM / 2, heights - top, NOTHING_MM).astype(np.float32)
        shape = Shape(self.name, trimesh.Trimesh(), HeightMap(surface, axis, axis), (1.4, 1.4))
        return shape, top


def make_case(number: int) -> Case:
    """The case of a number: the families take turns."""
    family = tuple(FAMILIES)[number % len(FAMILIES)]
    seed = number // len(FAMILIES)
    rng = np.random.default_rng((number, seed))
    heights, parameters = FAMILIES[family](rng)
    tilt_deg, towards = rng.uniform(0.0, TILT_DEG), rng.uniform(0.0, 2 * np.pi)
    steep = np.tan(np.radians(tilt_deg))
    slope = float(steep * np.cos(towards)), float(steep * np.sin(towards))
    return Case(family, seed, heights, parameters | {"tilt_deg": float(tilt_deg)}, slope)


def _faces(inside: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> Heights:
    """Heights of the flat faces on which `inside` is true."""
    return lambda x, y: np.where(inside(x, y), 0.0, NOTHING_MM)


def _longest(half_width_mm: float) -> float:
    """Length of the longest bar within REACH_MM whose long sides are this far off the axis, mm."""
    return 2 * float(np.sqrt(REACH_MM**2 - half_width_mm**2))


def _feet(rng: np.random.Generator) -> tuple[Heights, dict[str, float]]:
    gap, side, is_round = rng.uniform(1.0, 8.0), rng.uniform(1.0, 4.0), bool(rng.integers(2))
    middle = (gap + side) / 2

    def inside(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        across = np.abs(np.abs(x) - middle)
        if is_round:
            return np.hypot(across, y) <= side / 2
        return (across <= side / 2) & (np.abs(y) <= side / 2)

    return _faces(inside), {"gap": gap, "side": side, "round": float(is_round)}


def _rails(rng: np.random.Generator) -> tuple[Heights, dict[str, float]]:
    gap, width = rng.uniform(1.0, 8.0), rng.uniform(0.8, 3.0)
    length = rng.uniform(4.0, _longest(gap / 2 + width))

    def inside(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        across = np.abs(np.abs(x) - (gap + width) / 2)
        return (across <= width / 2) & (np.abs(y) <= length / 2)

    return _faces(inside), {"gap": gap, "width": width, "length": length}


def _comb(rng: np.random.Generator) -> tuple[Heights, dict[str, float]]:
    teeth, width, gap = int(rng.integers(3, 7)), rng.uniform(0.6, 1.5), rng.uniform(0.8, 2.0)
    half, has_back = (teeth * width + (teeth - 1) * gap) / 2, bool(rng.integers(2))
    scale = min(1.0, 7.5 / half)
    width, gap, half = width * scale, gap * scale, half * scale
    length = rng.uniform(2.0, _longest(half))

    def inside(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        within = (np.abs(x) <= half) & (np.abs(y) <= length / 2)
        tooth = np.mod(x + half, width + gap) <= width
        return within & (tooth | (has_back & (y >= length / 2 - width)))

    sizes = {"teeth": teeth, "width": width, "gap": gap, "length": length, "back": has_back}
    return _faces(inside), {name: float(size) for name, size in sizes.items()}


def _cross(rng: np.random.Generator) -> tuple[Heights, dict[str, float]]:
    widths, lengths = rng.uniform(0.6, 2.5, 2), rng.uniform(4.0, 14.0, 2)

    def inside(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        one = (np.abs(x) <= lengths[0] / 2) & (np.abs(y) <= widths[0] / 2)
        return one | ((np.abs(y) <= lengths[1] / 2) & (np.abs(x) <= widths[1] / 2))

    sizes = {"width": widths[0], "width_2": widths[1], "length": lengths[0], "length_2": lengths[1]}
    return _faces(inside), {name: float(size) for name, size in sizes.items()}


def _rings(rng: np.random.Generator) -> tuple[Heights, dict[str, float]]:
    inner, gap, walls = rng.uniform(0.6, 2.5), rng.uniform(0.8, 2.5), rng.uniform(0.6, 1.5, 2)
    outer = inner + walls[0] + gap

    def inside(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        radius = np.hypot(x, y)
        one = (radius >= inner) & (radius <= inner + walls[0])
        return one | ((radius >= outer) & (radius <= outer + walls[1]))

    sizes = {"inner": inner, "gap": gap, "wall": walls[0], "wall_2": walls[1]}
    return _faces(inside), {name: float(size) for name, size in sizes.items()}


def _wall(rng: np.random.Generator) -> tuple[Heights, dict[str, float]]:
    width, length = rng.uniform(0.6, 1.5), rng.uniform(3.0, 14.0)

    def inside(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return (np.abs(x) <= length / 2) & (np.abs(y) <= width / 2)

    return _faces(inside), {"width": width, "length": length}


def _needles(rng: np.random.Generator) -> tuple[Heights, dict[str, float]]:
    radius, is_round = rng.uniform(0.3, 0.8), bool(rng.integers(2))
    wanted = int(rng.integers(1, 7))
    centers: list[np.ndarray] = []
    while len(centers) < wanted:
        center = rng.uniform(-4.0, 4.0, 2)
        apart = (float(np.linalg.norm(center - other)) for other in centers)
        if all(each >= 2 * radius + NEEDLE_APART_MM for each in apart):
            centers.append(center)

    def heights(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        distance = np.min([np.hypot(x - at_x, y - at_y) for at_x, at_y in centers], axis=0)
        tip = np.sqrt(np.maximum(radius**2 - distance**2, 0.0)) - radius if is_round else 0.0
        return np.where(distance <= radius, tip, NOTHING_MM)

    return heights, {"radius": radius, "needles": float(wanted), "round": float(is_round)}


def _disc(rng: np.random.Generator) -> tuple[Heights, dict[str, float]]:
    radius = rng.uniform(4.0, 8.0)
    return _faces(lambda x, y: np.hypot(x, y) <= radius), {"radius": radius}


FAMILIES = {
    "feet": _feet,
    "rails": _rails,
    "comb": _comb,
    "cross": _cross,
    "rings": _rings,
    "wall": _wall,
    "needles": _needles,
    "disc": _disc,
}
"""The families of shapes."""
