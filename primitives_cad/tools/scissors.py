"""Scissors, a little open: the pivot at the origin, blades towards +y, ring handles below.

Each half is drawn closed, its blade straight up, then turned about the pivot.
"""

from math import cos, hypot, radians, sin

import cadquery as cq

from t2twin.primitives_cad.shape import Keypoint

OPENING_DEG = 13.0
"""Rotation of each half from closed."""

BLADE_THICKNESS_MM = 2.4
EDGE_AT = ((5.0, 3.0), (0.6, 80.0))
"""Cutting edge in the closed frame: from near the pivot to the tip, mm."""
TIP_MM = (-0.6, 81.0)
SPINE = ((-5.2, 50.0), (-8.0, 18.0))
"""Points on the blade's back, mm."""
BEVEL_WIDTH_MM = 2.2
BEVEL_LAND_MM = 0.5
"""Thickness left at the cutting edge, mm."""
PIVOT_RADIUS_MM = 9.0

RING_AT_MM = (18.5, -60.0)
RING_HALF_WIDTH_MM = 15.0
THUMB_HALF_LENGTH_MM = 17.0
FINGER_HALF_LENGTH_MM = 23.0
RING_BAR_MM = 6.0
HANDLE_THICKNESS_MM = 8.0
RING_ROUNDING_MM = 2.6

SCREW_RADIUS_MM = 4.6
SCREW_TOP_MM = 4.2
SLOT_WIDTH_MM, SLOT_DEPTH_MM = 1.2, 0.8
SLOT_TURN_DEG = 35.0


def _turned(x_mm: float, y_mm: float) -> tuple[float, float]:
    """Rotate a point from the upper half's closed frame to the open scissors."""
    turn = radians(OPENING_DEG)
    return (x_mm * cos(turn) - y_mm * sin(turn), x_mm * sin(turn) + y_mm * cos(turn))


_SLOT = radians(SLOT_TURN_DEG)
KEYPOINTS = (
    Keypoint("blade-tip", (*_turned(-1.7, 66.0), BLADE_THICKNESS_MM), (0.0, 0.0, 1.0)),
    Keypoint(
        "blade-back",
        (*_turned(SPINE[0][0], SPINE[0][1]), BLADE_THICKNESS_MM / 2.0),
        (*_turned(-0.9950, 0.0995), 0.0),
    ),
    Keypoint("pivot", (-2.4 * sin(_SLOT), 2.4 * cos(_SLOT), SCREW_TOP_MM), (0.0, 0.0, 1.0)),
    Keypoint(
        "ring",
        (
            *_turned(RING_AT_MM[0] + RING_HALF_WIDTH_MM - RING_BAR_MM / 2.0, RING_AT_MM[1]),
            HANDLE_THICKNESS_MM / 2.0,
        ),
        (0.0, 0.0, 1.0),
    ),
)


def solid() -> cq.Shape:
    """The scissors, one solid."""
    upper = _half(THUMB_HALF_LENGTH_MM)
    # The other half is the same, turned over about y, with the longer ring.
    lower = _half(FINGER_HALF_LENGTH_MM).rotate((0, 0, 0), (0, 1, 0), 180.0)
    return upper.union(lower).union(_screw()).val()  # pyright: ignore[reportReturnType]


def _half(ring_half_length_mm: float) -> cq.Workplane:
    blade = (
        cq.Workplane()
        .moveTo(*EDGE_AT[0])
        .lineTo(*EDGE_AT[1])
        .lineTo(*TIP_MM)
        .spline([*SPINE, (-PIVOT_RADIUS_MM, 0.0)], includeCurrent=True)
        .lineTo(PIVOT_RADIUS_MM - 2.0, 0.0)
        .close()
        .extrude(BLADE_THICKNESS_MM)
        .cut(_bevel())
    )
    pivot = cq.Workplane().circle(PIVOT_RADIUS_MM).extrude(BLADE_THICKNESS_MM)
    half = blade.union(pivot).union(_handle(ring_half_length_mm))
    return half.rotate((0, 0, 0), (0, 0, 1), OPENING_DEG)


def _bevel() -> cq.Workplane:
    """The material ground off along the cutting edge, on the outer face."""
    (x0, y0), (x1, y1) = EDGE_AT
    length = hypot(x1 - x0, y1 - y0)
    along = cq.Vector((x1 - x0) / length, (y1 - y0) / length, 0.0)
    inwards = cq.Vector(-along.y, along.x, 0.0)
    start = cq.Plane(origin=(x0 - 20 * along.x, y0 - 20 * along.y, 0.0), xDir=inwards, normal=along)
    # The plane's x points into the blade; its y, normal cross x, is -z.
    top = 10.0
    slope = (BLADE_THICKNESS_MM - BEVEL_LAND_MM) / BEVEL_WIDTH_MM
    wedge = cq.Workplane(start).polyline(
        [
            (-5.0, start.yDir.z * (BEVEL_LAND_MM - 5.0 * slope)),
            (BEVEL_WIDTH_MM + 5.0, start.yDir.z * (BLADE_THICKNESS_MM + 5.0 * slope)),
            (-5.0, start.yDir.z * top),
        ]
    )
    ground = wedge.close().extrude(length + 40.0)
    beyond_pivot = cq.Workplane().center(0.0, 60.0).rect(60.0, 96.0).extrude(top, both=True)
    return ground.intersect(beyond_pivot)


def _handle(ring_half_length_mm: float) -> cq.Workplane:
    x, y = RING_AT_MM
    lowest = y - (ring_half_length_mm - THUMB_HALF_LENGTH_MM)
    half_thickness = HANDLE_THICKNESS_MM / 2.0
    at = cq.Workplane(origin=(x, lowest, 0.0))
    ring = _oval(at, RING_HALF_WIDTH_MM, ring_half_length_mm)
    hole = _oval(at, RING_HALF_WIDTH_MM - RING_BAR_MM, ring_half_length_mm - RING_BAR_MM)
    ring = ring.cut(hole).faces("|Z").edges().fillet(RING_ROUNDING_MM)
    arm = (
        cq.Workplane()
        .moveTo(2.2, -19.0)
        .threePointArc((6.0, -34.0), (12.0, -46.5))
        .lineTo(21.0, -45.5)
        .threePointArc((15.0, -32.0), (12.0, -19.0))
        .close()
        .extrude(half_thickness, both=True)
    )
    arm = arm.faces("|Z").edges().fillet(1.5)
    tang = (
        cq.Workplane()
        .polyline([(-5.0, 0.0), (8.5, 0.0), (11.5, -24.0), (4.0, -24.0)])
        .close()
        .extrude(BLADE_THICKNESS_MM)
    )
    return tang.union(arm).union(ring.cut(hole))


def _oval(at: cq.Workplane, half_width_mm: float, half_length_mm: float) -> cq.Workplane:
    """A stadium along y, as thick as the handles.

    Arcs, because the kernel meshes the rounded edge of an ellipse thirty times finer.
    """
    straight = at.rect(2.0 * half_width_mm, 2.0 * (half_length_mm - half_width_mm))
    oval = straight.extrude(HANDLE_THICKNESS_MM / 2.0, both=True)
    for side in (1.0, -1.0):
        end = at.center(0.0, side * (half_length_mm - half_width_mm)).circle(half_width_mm)
        oval = oval.union(end.extrude(HANDLE_THICKNESS_MM / 2.0, both=True))
    return oval


def _screw() -> cq.Workplane:
    screw = cq.Workplane().circle(SCREW_RADIUS_MM).extrude(SCREW_TOP_MM, both=True)
    screw = screw.faces("|Z").edges().fillet(0.9)
    slot = (
        cq.Workplane()
        .workplane(offset=SCREW_TOP_MM - SLOT_DEPTH_MM)
        .rect(4.0 * SCREW_RADIUS_MM, SLOT_WIDTH_MM)
        .extrude(SCREW_TOP_MM)
        .rotate((0, 0, 0), (0, 0, 1), SLOT_TURN_DEG)
    )
    return screw.cut(slot)
