"""An Allen key: a bar of hexagon section bent into an L, the bend at the origin's corner.

The long arm lies along +x, the short one along +y; flats of the hexagon face +-z.
"""

from math import sqrt

import cadquery as cq

from t2twin.primitives_cad.shape import Keypoint

ACROSS_FLATS_MM = 6.0
LONG_ARM_MM = 96.0
SHORT_ARM_MM = 38.0
BEND_RADIUS_MM = 11.0
"""Radius of the bend, to the center line of the bar, mm."""
END_CHAMFER_MM = 0.4

CORNER_MM = ACROSS_FLATS_MM / sqrt(3.0)
"""Distance of the hexagon's corners from its center, mm."""
FLAT_MM = ACROSS_FLATS_MM / 2.0
BEND_MIDDLE_MM = BEND_RADIUS_MM * (1.0 - sqrt(0.5))
"""x and y of the center of the bend, mm."""

KEYPOINTS = (
    Keypoint("long-arm", (62.0, 0.0, FLAT_MM), (0.0, 0.0, 1.0)),
    Keypoint("bend", (BEND_MIDDLE_MM, BEND_MIDDLE_MM, FLAT_MM), (0.0, 0.0, 1.0)),
    Keypoint("short-end", (0.0, SHORT_ARM_MM, 0.0), (0.0, 1.0, 0.0)),
    Keypoint("ridge", (56.0, -CORNER_MM, 0.0), (0.0, -1.0, 0.0)),
)


def solid() -> cq.Shape:
    """The key, one solid."""
    path = (
        cq.Workplane("XY")
        .moveTo(LONG_ARM_MM, 0.0)
        .lineTo(BEND_RADIUS_MM, 0.0)
        .threePointArc((BEND_MIDDLE_MM, BEND_MIDDLE_MM), (0.0, BEND_RADIUS_MM))
        .lineTo(0.0, SHORT_ARM_MM)
    )
    section = cq.Workplane("YZ", origin=(LONG_ARM_MM, 0.0, 0.0)).polygon(6, 2.0 * CORNER_MM)
    bar = section.sweep(path)
    bar = bar.faces(">X").chamfer(END_CHAMFER_MM).faces(">Y").chamfer(END_CHAMFER_MM)
    return bar.val()  # pyright: ignore[reportReturnType]
