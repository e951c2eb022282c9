"""Reads STEP with the CAD kernel: solids with curved faces, converted to mm."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import trimesh


def read(path: Path) -> tuple["trimesh.Trimesh", float]:
    """The solids of a STEP file as one mesh, and 1 mm; see this package."""
    import cadquery as cq
    import trimesh

    from t2twin.primitives_cad.solids import tessellate

    try:
        with _quiet_kernel():
            solids = cq.importers.importStep(str(path)).solids().vals()
    except Exception as error:  # the CAD kernel raises many unrelated types
        raise ValueError("it is damaged or not STEP") from error
    if not solids:
        raise ValueError("it holds no solid body; surfaces alone cannot be pressed")
    mesh = trimesh.util.concatenate([tessellate(solid) for solid in solids])  # pyright: ignore[reportArgumentType]
    return mesh, 1.0  # pyright: ignore[reportReturnType]


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
