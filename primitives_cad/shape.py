"""Shapes: solids with the height map of their pressing surface.

Frames of the whole project, lengths in mm:

- Shape frame: the solid stands as printed, its pressing side up (+z), the press axis through
  x = y = 0. Heights are measured from the highest point of the pressing side, so they are
  <= 0.
- Sensor frame: x to the right of the image (columns), y down the image (rows), z out of
  the sensor towards the shape. Right-handed.
- A press turns the shape over about x, tilts it about x and then y, rotates it by yaw about +z, and
  moves its origin to (x, y). All rotations are right-handed:
  p_sensor = Rz(yaw) Ry(tilt_y) Rx(tilt_x) diag(1, -1, -1) p_shape + (x, y, .).
  At yaw 0 the image shows the shape as seen from above with y up; a positive yaw rotates it
  clockwise in the image. A positive tilt_x lowers the shape's +y side into the sensor, a positive
  tilt_y its +x side: at yaw 0 the upper and the right side of the image. The tilt turns with the
  yaw.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from t2twin.core.arguments import MAX_SEED
from t2twin.core.arrays import Record, kept_property
from t2twin.core.errors import T2TwinError

if TYPE_CHECKING:
    import trimesh

Solid = tuple[np.ndarray, np.ndarray]  # vertices (n, 3), mm, and faces (m, 3)
NOTHING_MM = -1.0e3  # height where the solid has no surface, mm: far below any layer's thickness
SUFFIXES = (".stl", ".obj", ".ply", ".3mf", ".glb", ".step", ".stp")  # of solids' files
PLATE_THICKNESS_MM = 3.0  # thickness of base plates, mm (assumed)
RANDOM_PREFIX = "random-"  # start of the names of random shapes, before their seed
STL_HEADER_BYTES = 84  # of binary STL: 80 of text, then the number of triangles
# one triangle of binary STL
STL_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
BALL_PITCH_MM = 0.05  # default pitch of a ball's height map: at most a fifth of a contact's grid


@dataclass(frozen=True, eq=False)
class HeightMap(Record):
    """Heights of a pressing surface on a regular grid, seen from above.

    heights_mm: (ny, nx) float32, 0 at the highest point, NOTHING_MM where there is no solid.
    x_mm: (nx,) and y_mm: (ny,), both rising by pitch_mm.
    """

    heights_mm: np.ndarray
    x_mm: np.ndarray
    y_mm: np.ndarray

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.heights_mm.shape != (self.y_mm.size, self.x_mm.size):
            raise T2TwinError(
                f"heights of shape {self.heights_mm.shape} do not fit axes of "
                f"{self.y_mm.size} rows and {self.x_mm.size} columns"
            )

    @property
    def pitch_mm(self) -> float:
        return float(self.x_mm[1] - self.x_mm[0])

    def sample(self, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
        """Heights at points of the shape frame, bilinear, shape of x_mm; NOTHING_MM outside."""
        from scipy import ndimage  # slow to import

        rows = (y_mm - self.y_mm[0]) / self.pitch_mm
        columns = (x_mm - self.x_mm[0]) / self.pitch_mm
        return ndimage.map_coordinates(
            self.heights_mm, [rows, columns], order=1, mode="constant", cval=NOTHING_MM
        )


@dataclass(frozen=True, eq=False)
class Shape(Record):
    """A named solid with its pressing surface, in the shape frame, mm.

    name: as in the catalogue (`square-2`, `pliers/jaw-tip`) or a file's stem.
    solid: the solid, closed around a volume: a mesh, its vertices (n, 3) and faces (m, 3), or a
        function that returns these at their first use. Of a file that is not closed, its surface.
    surface: its pressing surface.
    spacing_mm: pitch of the protocol's grid of press points for this shape, along x and y.
    parameters: of a primitive, by name, mm.
    base_mm: height of the base plate's top (negative), or None; of a shape from a file the lowest
        flat face below other parts.
    notes: repairs of a shape from a file, and what stays open or is not pressed, each a sentence.
    base_slope: rise of the base plate along x and y, mm per mm, of a tilted shape; base_mm is then
        its height on the press axis.
    rise_mm: height of the highest point above the shape's origin; not 0 of a tilted shape only.
    is_under_surface: whether the solid is what lies under the surface by definition.
    """

    name: str
    solid: "trimesh.Trimesh | Solid | Callable[[], Solid]"
    surface: HeightMap
    spacing_mm: tuple[float, float]
    parameters: Mapping[str, float] = field(default_factory=dict)
    base_mm: float | None = None
    notes: tuple[str, ...] = ()
    base_slope: tuple[float, float] = (0.0, 0.0)
    rise_mm: float = 0.0
    is_under_surface: bool = False

    def __repr__(self) -> str:
        return f"Shape({self.name!r})"

    def __post_init__(self) -> None:
        if not isinstance(self.solid, tuple) and not callable(self.solid):
            vars(self)["solid"] = self.solid.vertices, self.solid.faces
        super().__post_init__()

    @kept_property
    def triangles(self) -> Solid:
        """Vertices (n, 3), mm, and faces (m, 3) of the solid."""
        found: Any = self.solid() if callable(self.solid) else self.solid
        return found

    @property
    def mesh(self) -> "trimesh.Trimesh":
        """The solid as a new mesh, mm."""
        import trimesh

        vertices, faces = (np.array(each) for each in self.triangles)
        return trimesh.Trimesh(vertices, faces, process=False)

    @cached_property
    def prepared(self) -> dict[str, Any]:
        """What has been computed from the shape for further presses."""
        return {}


def seed_of(name: str) -> int | None:
    """The seed in a name such as `random-17`; None for names of other shapes."""
    if not name.startswith(RANDOM_PREFIX) or "." in name or "/" in name:
        return None
    digits = name.removeprefix(RANDOM_PREFIX)
    is_number = digits.isascii() and digits.isdigit() and len(digits) <= len(str(MAX_SEED))
    if not (is_number and digits == str(int(digits)) and int(digits) <= MAX_SEED):
        raise T2TwinError(
            f"{name} is not a random shape; their names are {RANDOM_PREFIX}0, {RANDOM_PREFIX}1 and "
            f"so on to {RANDOM_PREFIX}{MAX_SEED}"
        )
    return int(digits)


def ball(radius_mm: float, pitch_mm: float = BALL_PITCH_MM) -> Shape:
    """A ball in closed form. pitch_mm: of its height map."""
    from trimesh.creation import icosphere  # slow to import

    steps = np.ceil(radius_mm / pitch_mm)
    axis = pitch_mm * np.arange(-steps, steps + 1)
    below = radius_mm**2 - axis**2 - axis[:, None] ** 2
    heights = np.where(below >= 0, np.sqrt(np.maximum(below, 0.0)) - radius_mm, NOTHING_MM)
    mesh = icosphere(subdivisions=4, radius=radius_mm)
    mesh.apply_translation((0.0, 0.0, -radius_mm))
    return Shape("ball", mesh, HeightMap(heights.astype(np.float32), axis, axis), (1.0, 1.0))


def binary_stl(vertices: np.ndarray, faces: np.ndarray) -> bytes:
    """A binary STL file. vertices: (n, 3), mm. faces: (m, 3), counterclockwise from outside."""
    corners = np.asarray(vertices)[np.asarray(faces)]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    records = np.zeros(len(corners), STL_RECORD)
    records["normal"] = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
    records["corners"] = corners
    return bytes(STL_HEADER_BYTES - 4) + np.uint32(len(corners)).tobytes() + records.tobytes()
