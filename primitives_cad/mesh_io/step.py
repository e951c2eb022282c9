"""Reads STEP with the CAD kernel: solids with curved faces, converted to mm."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import cadquery as cq
    import trimesh


def read(path: Path) -> tuple["trimesh.Trimesh", float]:
    """The solids of a STEP file, or its surfaces without solids, as one mesh, and 1 mm; see this
    package."""
    import cadquery as cq
    import trimesh

    try:
        with _quiet_kernel():
            content = cq.importers.importStep(str(path))
    except Exception as error:  # the CAD kernel raises many unrelated types
        raise ValueError("it is damaged or not STEP") from error
    solids = content.solids().vals()
    meshes = [_mesh(shape) for shape in solids or content.faces().vals()]  # pyright: ignore[reportArgumentType]
    if not any(len(mesh.faces) for mesh in meshes):
        raise ValueError("it holds no solid and no surface")
    mesh: trimesh.Trimesh = trimesh.util.concatenate(meshes)  # pyright: ignore[reportArgumentType, reportAssignmentType]
    if len(solids) > 1:
        mesh.metadata["note"] = f"contains {len(solids)} solids, which are pressed as one shape"
    return mesh, 1.0


def _mesh(shape: "cq.Shape") -> "trimesh.Trimesh":
    """The mesh of a solid or a surface. The triangles of a solid may leave gaps between its faces,
    which `repair` closes."""
    import trimesh

    from t2twin.core.errors import T2TwinError
    from t2twin.primitives_cad.solids import CHORDAL_MM, triangles_of, watertight

    points, triangles = triangles_of(shape, CHORDAL_MM)
    try:
        return watertight(points, triangles)
    except T2TwinError:
        return trimesh.Trimesh(points, triangles, process=False)


@contextmanager
def _quiet_kernel() -> Iterator[None]:
    """Suppress the kernel's messages on standard output."""
    from OCP.Message import Message  # pyright: ignore[reportAttributeAccessIssue]

    messenger = Message.DefaultMessenger_s()
    printers = list(messenger.Printers())
    for printer in printers:
        messenger.RemovePrinter(printer)
    try:
        yield
    finally:
        for printer in printers:
            messenger.AddPrinter(printer)
