"""All primitives side by side on one printable plate."""

import cadquery as cq

from t2twin.primitives_cad.primitive_parameters import FAMILIES, PRIMITIVES
from t2twin.primitives_cad.solids import feature, plate

PITCH_MM = (31.0, 56.0)
"""Distance from one primitive to the next along x and y, mm (assumed, so that no press touches a
neighbor: the sum of half the diagonal of a DIGIT's gel, the protocol's largest offset and half the
neighbor. Along x, where the largest square and circle stand beside the largest empty circle, that
is 15.5 + 8.3 + 6.5 mm; along y, where lines follow lines, 15.5 + 20.2 + 20 mm. The plate still
fits a printer's bed of 250 mm)."""

COLUMNS = len(FAMILIES)
ROWS = len(PRIMITIVES) // COLUMNS


def places() -> dict[str, tuple[float, float]]:
    """x, y of each primitive's axis on the plate, mm: a column a family, version 1 at the top."""
    return {
        name: (
            (index // ROWS - (COLUMNS - 1) / 2.0) * PITCH_MM[0],
            ((ROWS - 1) / 2.0 - index % ROWS) * PITCH_MM[1],
        )
        for index, name in enumerate(PRIMITIVES)
    }


def solid() -> cq.Shape:
    """The plate with all primitives, one solid, tops of the features at z = 0, mm."""
    ground: cq.Shape = plate(COLUMNS * PITCH_MM[0], ROWS * PITCH_MM[1]).val()  # pyright: ignore[reportAssignmentType]
    features: list[cq.Shape] = [
        feature(name).translate((*place, 0.0)).val()  # pyright: ignore[reportAssignmentType]
        for name, place in places().items()
    ]
    return ground.fuse(*features)
