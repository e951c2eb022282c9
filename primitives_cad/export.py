"""Writes STEP and STL files of all primitives, tools and the print plate, with a manifest, and the
ball for the optics of a gel camera."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write, locked, write_json
from t2twin.core.progress import Progress
from t2twin.primitives_cad import catalogue, primitive_parameters
from t2twin.primitives_cad.primitive_parameters import FAMILIES, PRIMITIVES
from t2twin.primitives_cad.shape import Shape

if TYPE_CHECKING:
    import cadquery as cq  # takes seconds
    import trimesh

MANIFEST = "manifest.json"
MOSAIC = "mosaic"

# Distance of the primitives on the plate along x and y. Assumed, so that no press touches a
# neighbor: half the gel's diagonal, the largest offset and half the neighbor, 15.5 + 8.3 + 6.5 mm
# along x and 15.5 + 20.2 + 20 mm along y. The plate fits a printer's bed of 250 mm.
PLATE_PITCH_MM = (31.0, 56.0)
# length of the ball's stem from its center (assumed: more than an elastomer's thickness)
STEM_MM = 5.0
PLATE_COLUMNS = len(FAMILIES)
PLATE_ROWS = len(PRIMITIVES) // PLATE_COLUMNS


def export_shapes(out_dir: str | Path) -> Path:
    """Write NAME.step and NAME.stl of the primitives, the tools and the plate (`mosaic`), in mm.

    Returns the path of manifest.json, which describes them. Raises T2TwinError where the folder
    cannot be written.
    """
    folder = arguments.path(out_dir, "out_dir")
    names = (*catalogue.PRIMITIVES, *catalogue.TOOLS, MOSAIC)
    with locked(folder):
        shapes = [
            _write_shape(folder, name)
            for name in Progress(names, desc="primitives and tools", unit="shape")
        ]
        write_json(folder / MANIFEST, {"units": "mm", "shapes": shapes})
    return folder / MANIFEST


def _write_shape(folder: Path, name: str) -> dict[str, Any]:
    """Write both files of one shape; returns its entry in the manifest."""
    import cadquery as cq

    from t2twin.primitives_cad import solids, tools

    mesh: trimesh.Trimesh
    if name == MOSAIC:
        solid = plate_solid()
        mesh = solids.tessellate(solid)
        about = {"places_mm": plate_positions(), "pitch_mm": PLATE_PITCH_MM}
    elif name in catalogue.TOOLS:
        solid = tools.solid(name)
        mesh = catalogue.tool_mesh(name)
        about = {
            "split": "test",
            "spacing_mm": catalogue.OBJECT_SPACING_MM,
            "keypoints": [asdict(keypoint) for keypoint in tools.keypoints(name)],
        }
    else:
        solid = solids.primitive(name)
        shape = catalogue.load(name)
        mesh = shape.mesh
        about = {
            "family": primitive_parameters.family(name),
            "version": primitive_parameters.version(name),
            "split": catalogue.split(name),
            "parameters_mm": shape.parameters,
            "spacing_mm": shape.spacing_mm,
        }
    bodies = solid.Solids()
    if len(bodies) != 1 or not bodies[0].isValid():
        raise T2TwinError(f"{name} is not one valid solid; its parameters do not make a shape")
    with atomic_write(folder / f"{name}.step") as temporary:
        cq.exporters.export(cq.Workplane(bodies[0]), str(temporary))
    with atomic_write(folder / f"{name}.stl") as temporary:
        mesh.export(temporary, file_type="stl")
    return {
        "name": name,
        **about,
        "volume_mm3": round(solid.Volume(), 3),
        "bounding_box_mm": [[round(float(x), 4) for x in corner] for corner in mesh.bounds],
        "triangles": len(mesh.faces),
        "chordal_error_mm": tools.CHORDAL_MM.get(name, solids.CHORDAL_MM),
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


def plate_solid() -> "cq.Shape":
    """The plate with all primitives as one solid, tops of the features at z = 0, mm."""
    from t2twin.primitives_cad.solids import feature, plate

    width_mm, length_mm = PLATE_COLUMNS * PLATE_PITCH_MM[0], PLATE_ROWS * PLATE_PITCH_MM[1]
    ground: cq.Shape = plate(width_mm, length_mm).val()  # pyright: ignore[reportAssignmentType]
    features: list[cq.Shape] = [
        feature(name).translate((*place, 0.0)).val()  # pyright: ignore[reportAssignmentType]
        for name, place in plate_positions().items()
    ]
    return ground.fuse(*features)


def write_ball(path: Path, diameter_mm: float) -> Shape:
    """Write a ball on a stem of its diameter as STEP, pressing side up; returns the shape."""
    import cadquery as cq

    stem = cq.Workplane().circle(diameter_mm / 2).extrude(-STEM_MM)
    ball = stem.union(cq.Workplane().sphere(diameter_mm / 2))
    with atomic_write(path) as temporary:
        cq.exporters.export(ball, str(temporary), cq.exporters.ExportTypes.STEP)
    return catalogue.load(path)
