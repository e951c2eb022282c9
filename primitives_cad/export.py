"""Writes STEP and STL files of all primitives, tools and the print plate, with a manifest, and the
contact sheet: an image of every primitive and tool.

Tops and plates have one color in pyrender, which has no shading of creases (0.1.45).
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cadquery as cq
import numpy as np
import trimesh
from PIL import Image, ImageDraw, ImageFont
from scipy import ndimage
from scipy.spatial.transform import Rotation

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.files import result_folder, write_json
from t2twin.core.progress import Progress
from t2twin.primitives_cad import catalogue, mesh_files, solids, tools
from t2twin.primitives_cad.catalogue import FAMILIES, PRIMITIVES
from t2twin.primitives_cad.height_map import rasterize_triangles
from t2twin.primitives_cad.shape import NOTHING_MM

MANIFEST = "manifest.json"
MOSAIC = "mosaic"
# Distance of the primitives on the plate along x and y. Assumed, so that no press touches a
# neighbor: half the gel's diagonal, the largest offset and half the neighbor, 15.5 + 8.3 + 6.5 mm
# along x and 15.5 + 20.2 + 20 mm along y. The plate fits a printer's bed of 250 mm.
PLATE_PITCH_MM = (31.0, 56.0)
PLATE_COLUMNS = len(FAMILIES)
PLATE_ROWS = len(PRIMITIVES) // PLATE_COLUMNS

COLUMNS = 8
TILE_PX = (330, 300)
TOOL_PX = (528, 720)  # width and height of a primitive's and of a tool's tile, pixels
OVERSAMPLING = 3  # tiles are rendered this many times larger and averaged, for smooth outlines
MARGIN = 0.88  # largest share of a tile's width or height that a shape fills
LABEL_PX, KEYPOINT_PX = 22, 17  # heights of the text, pixels
PRIMITIVE_VIEW = (28.0, 48.0)  # rotation about the vertical and elevation, degrees
TOOL_VIEWS = {"pliers": (-8.0, 62.0), "clamp": (-18.0, 58.0), "scissors": (-6.0, 66.0),
              "allen-key": (76.0, 56.0), "wrench": (66.0, 60.0)}  # fmt: skip

# Colors of the page, tools, primitives, keypoints and text, 8 bit RGB.
PAPER = np.array([247, 247, 245])
STEEL = np.array([168, 178, 192])
RESIN = np.array([196, 178, 148])
MARK = (208, 32, 40)
INK = (40, 40, 44)

TO_LIGHT = np.array([-0.45, 0.55, 0.70])  # to the right, up, towards the viewer
AMBIENT, DIFFUSE = 0.4, 0.7  # intensities of the ambient light and of the light
# width of the shading of creases, mm, its strength per mm of depth, step of its grid, px
CREASE_MM, CREASE_STRENGTH, CREASE_STEP = 1.6, 0.30, 3


def export_shapes(out_dir: str | Path) -> Path:
    """Write NAME.step and NAME.stl of the primitives, the tools and the plate (`mosaic`), in mm.

    Returns the path of manifest.json, which describes them. Raises T2TwinError where another's file
    has one of the names, or the folder cannot be written.
    """
    folder = arguments.path(out_dir, "out_dir")
    names = (*catalogue.PRIMITIVES, *catalogue.TOOLS, MOSAIC)
    with result_folder(folder, "export of shapes", [MANIFEST]) as temporary:
        shapes = [
            _write_shape(temporary, name)
            for name in Progress(names, desc="primitives and tools", unit="shape")
        ]
        write_json(temporary / MANIFEST, {"units": "mm", "shapes": shapes})
    return folder / MANIFEST


def _write_shape(folder: Path, name: str) -> dict[str, Any]:
    """Write both files of one shape; returns its entry in the manifest."""
    if name == MOSAIC:
        solid = plate_solid()
        mesh = mesh_files.watertight(*mesh_files.triangles_of(solid))
        about = {"places_mm": plate_positions(), "pitch_mm": PLATE_PITCH_MM}
    elif name in catalogue.TOOLS:
        solid, mesh = tools.solid(name), catalogue.tool_mesh(name)
        about = {
            "split": "test",
            "spacing_mm": catalogue.OBJECT_SPACING_MM,
            "keypoints": [
                {"name": at, "point_mm": point_mm, "direction": direction}
                for at, (point_mm, direction) in tools.KEYPOINTS[name].items()
            ],
        }
    else:
        shape = catalogue.load(name)
        solid, mesh = solids.primitive(name), shape.mesh
        about = {
            "family": catalogue.family(name),
            "version": catalogue.version(name),
            "split": catalogue.split(name),
            "parameters_mm": dict(shape.parameters),
            "spacing_mm": shape.spacing_mm,
        }
    bodies = solid.Solids()
    if len(bodies) != 1 or not bodies[0].isValid():
        raise T2TwinError(f"{name} is not one valid solid; its parameters do not make a shape")
    cq.exporters.export(cq.Workplane(bodies[0]), str(folder / f"{name}.step"))
    mesh.export(folder / f"{name}.stl", file_type="stl")
    return {
        "name": name,
        **about,
        "volume_mm3": round(solid.Volume(), 3),
        "bounding_box_mm": [[round(float(x), 4) for x in corner] for corner in mesh.bounds],
        "triangles": len(mesh.faces),
        "chordal_error_mm": tools.CHORDAL_MM.get(name, mesh_files.CHORDAL_MM),
    }


def plate_positions() -> dict[str, tuple[float, float]]:
    """x, y of each primitive's axis on the plate, mm: one column per family, version 1 on top."""
    return {
        name: (
            (index // PLATE_ROWS - (PLATE_COLUMNS - 1) / 2.0) * PLATE_PITCH_MM[0],
            ((PLATE_ROWS - 1) / 2.0 - index % PLATE_ROWS) * PLATE_PITCH_MM[1],
        )
        for index, name in enumerate(PRIMITIVES)
    }


def plate_solid() -> cq.Shape:
    """The plate with all primitives as one solid, tops of the features at z = 0, mm."""
    width_mm, length_mm = PLATE_COLUMNS * PLATE_PITCH_MM[0], PLATE_ROWS * PLATE_PITCH_MM[1]
    ground: cq.Shape = solids.plate(width_mm, length_mm).val()  # pyright: ignore[reportAssignmentType]
    features: list[cq.Shape] = [
        solids.feature(name).translate((*place, 0.0)).val()  # pyright: ignore[reportAssignmentType]
        for name, place in plate_positions().items()
    ]
    return ground.fuse(*features)


def draw_sheet(path: str | Path) -> Path:
    """Write the contact sheet of the 32 primitives and 5 tools as PNG; returns its path."""
    rows = len(catalogue.PRIMITIVES) // COLUMNS
    width = COLUMNS * TILE_PX[0]
    page = Image.new("RGB", (width, rows * TILE_PX[1] + TOOL_PX[1]), tuple(PAPER.tolist()))
    pen = ImageDraw.Draw(page)
    names = (*catalogue.PRIMITIVES, *catalogue.TOOLS)
    for name in Progress(names, desc="contact sheet", unit="shape"):
        points = {}
        if name in catalogue.PRIMITIVES:
            index = catalogue.PRIMITIVES.index(name)
            # One column for each family, one row for each version.
            corner = (index // rows * TILE_PX[0], index % rows * TILE_PX[1])
            mesh, view, size, color = catalogue.load(name).mesh, PRIMITIVE_VIEW, TILE_PX, RESIN
        else:
            column = catalogue.TOOLS.index(name)
            corner = (column * width // len(catalogue.TOOLS), rows * TILE_PX[1])
            mesh, view, size, color = catalogue.tool_mesh(name), TOOL_VIEWS[name], TOOL_PX, STEEL
            points = tools.KEYPOINTS[name]
        tile, places = draw(mesh, view, size, color, [point for point, _ in points.values()])
        page.paste(Image.fromarray(tile), corner)
        at = (corner[0] + size[0] / 2, corner[1] + size[1] - LABEL_PX)
        pen.text(at, name, fill=INK, font=ImageFont.load_default(LABEL_PX), anchor="mm")
        for label, (x, y) in zip(points, places, strict=True):
            # A dot, and its name outwards where there is space.
            font, (at_x, at_y) = ImageFont.load_default(KEYPOINT_PX), np.add(corner, (x, y))
            pen.circle((at_x, at_y), 5, fill=MARK, outline="white")
            wide = font.getlength(label) + 24
            left = x > TOOL_PX[0] - wide or wide < x < TOOL_PX[0] / 2
            place, anchor = (at_x - 10 if left else at_x + 10, at_y), "rm" if left else "lm"
            pen.text(place, label, MARK, font, anchor, stroke_width=3, stroke_fill="white")
    path = Path(path)
    with result_folder(path.parent, path.name, [path.name]) as temporary:
        page.save(temporary / path.name, format="PNG")
    return path


def draw(
    mesh: trimesh.Trimesh,
    view_deg: tuple[float, float],
    size_px: tuple[int, int],
    color: np.ndarray,
    points_mm: Sequence[Sequence[float]] = (),
) -> tuple[np.ndarray, np.ndarray]:
    """Image of a mesh, (height, width, 3) uint8, and places of points_mm (n, 3) in it, (n, 2)."""
    turn, height = np.radians(view_deg[0]), np.radians(90.0 - view_deg[1])
    seen = Rotation.from_euler("zx", (turn, -height)).as_matrix()
    triangles = mesh.triangles @ seen.T
    flat = triangles[:, :, :2].reshape(-1, 2)
    low, high = flat.min(axis=0), flat.max(axis=0)
    middle = (low + high) / 2.0
    pitch = float(((high - low) / (np.array(size_px) * OVERSAMPLING * MARGIN)).max())
    triangles = triangles - (*middle, triangles[:, :, 2].max())
    half_columns, half_rows = (side * OVERSAMPLING // 2 for side in size_px)
    depth = rasterize_triangles(triangles, pitch, half_rows, half_columns)[1:-1, 1:-1][::-1]
    picture = _shade(depth, pitch, color)
    picture = picture[: size_px[1] * OVERSAMPLING, : size_px[0] * OVERSAMPLING]
    blocks = picture.reshape(size_px[1], OVERSAMPLING, size_px[0], OVERSAMPLING, 3)
    coarse = blocks.mean(axis=(1, 3))
    places = (np.reshape(points_mm, (-1, 3)) @ seen.T)[:, :2] - middle
    places = places * (1.0, -1.0) / (pitch * OVERSAMPLING) + np.array(size_px) / 2.0
    return np.clip(coarse, 0.0, 255.0).astype(np.uint8), places


def _shade(depth: np.ndarray, pitch: float, color: np.ndarray) -> np.ndarray:
    """(rows, columns, 3) colors of a depth image, mm, rows downwards."""
    solid = depth != NOTHING_MM
    floor = float(depth[solid].min())
    filled = np.where(solid, depth, floor)
    slope_y, slope_x = np.gradient(filled, pitch)
    normal = np.stack([-slope_x, slope_y, np.ones_like(filled)], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    light = AMBIENT + DIFFUSE * np.clip(normal @ (TO_LIGHT / np.linalg.norm(TO_LIGHT)), 0.0, None)
    # The shading is smooth: a coarser grid suffices, and is many times faster.
    coarse = filled[::CREASE_STEP, ::CREASE_STEP]
    around = ndimage.gaussian_filter(coarse, CREASE_MM / pitch / CREASE_STEP)
    around = around.repeat(CREASE_STEP, 0).repeat(CREASE_STEP, 1)[: len(filled), : filled.shape[1]]
    crease = np.clip(1.0 - CREASE_STRENGTH * np.clip(around - filled, 0.0, None), 0.45, 1.0)
    shaded = (light * crease)[..., None] * color
    return np.where(solid[..., None], shaded, PAPER)
