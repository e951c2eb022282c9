"""All primitives side by side on one printable plate."""

import cadquery as cq

from primitives_cad.families import FAMILIES, PRIMITIVES
from primitives_cad.solids import feature, plate

PITCH_MM = 31.0
"""Distance from one primitive to the next, mm (assumed: half the diagonal of a DIGIT's gel,
15.5 mm, the protocol's largest offset, 4.8 mm, and half the longest feature, 10 mm, so that no
neighbour is touched; and eight of them fit a printer's bed of 250 mm)."""

COLUMNS = len(FAMILIES)
ROWS = len(PRIMITIVES) // COLUMNS


def places() -> dict[str, tuple[float, float]]:
    """x, y of each primitive's axis on the plate, mm: a column a family, version 1 at the top."""
    return {
        name: (
            (index // ROWS - (COLUMNS - 1) / 2.0) * PITCH_MM,
            ((ROWS - 1) / 2.0 - index % ROWS) * PITCH_MM,
        )
        for index, name in enumerate(PRIMITIVES)
    }


def solid() -> cq.Shape:
    """The plate with all primitives, one solid, tops of the features at z = 0, mm."""
    ground: cq.Shape = plate(COLUMNS * PITCH_MM, ROWS * PITCH_MM).val()  # pyright: ignore[reportAssignmentType]
    features: list[cq.Shape] = [
        feature(name).translate((*place, 0.0)).val()  # pyright: ignore[reportAssignmentType]
        for name, place in places().items()
    ]
    return ground.fuse(*features)
