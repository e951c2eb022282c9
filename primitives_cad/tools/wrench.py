"""A combination wrench along x: the ring end at the origin, the open end at HEAD_AT_MM."""

from math import cos, radians, sin, sqrt

import cadquery as cq

from t2twin.primitives_cad.shape import Keypoint

ACROSS_FLATS_MM = 13.0
HEAD_AT_MM = 142.0
"""x of the center of the open end, mm."""

RING_RADIUS_MM = 10.8
RING_THICKNESS_MM = 8.4
HEAD_RADIUS_MM = 14.5
HEAD_THICKNESS_MM = 6.4
JAW_LENGTH_MM = 10.0
"""Length of the jaws from the center of the nut, mm."""
TILT_DEG = -15.0
"""Angle of the open end's jaws to the shank: the usual 15 degrees."""

SHANK_WIDTH_MM = 11.5
SHANK_THICKNESS_MM = 5.2
PANEL_DEPTH_MM = 0.45
PANEL_RIM_MM = 2.4
PANEL_FROM_MM, PANEL_TO_MM = 34.0, 104.0
ROUNDING_MM = 0.9

CORNER_MM = ACROSS_FLATS_MM / sqrt(3.0)


def _at_head(along_mm: float, across_mm: float) -> tuple[float, float]:
    """x, y of a point given along and across the tilted jaws from the center of the nut."""
    turn = radians(TILT_DEG)
    return (
        HEAD_AT_MM + along_mm * cos(turn) - across_mm * sin(turn),
        along_mm * sin(turn) + across_mm * cos(turn),
    )


KEYPOINTS = (
    Keypoint(
        "ring", (-(CORNER_MM + RING_RADIUS_MM) / 2.0, 0.0, RING_THICKNESS_MM / 2.0), (0.0, 0.0, 1.0)
    ),
    Keypoint("open-end", (*_at_head(3.5, -10.0), HEAD_THICKNESS_MM / 2.0), (0.0, 0.0, 1.0)),
    Keypoint("shank", (70.0, 0.0, SHANK_THICKNESS_MM / 2.0 - PANEL_DEPTH_MM), (0.0, 0.0, 1.0)),
    Keypoint(
        "jaw-end",
        (*_at_head(JAW_LENGTH_MM, 8.4), 0.0),
        (cos(radians(TILT_DEG)), sin(radians(TILT_DEG)), 0.0),
    ),
)


def solid() -> cq.Shape:
    """The wrench, one solid."""
    socket, mouth = _socket(), _mouth()
    # Each part is cut before the union: the kernel cannot cut the joined ring.
    shank = _shank().cut(socket).cut(mouth)
    ring, head = _ring_blank().cut(socket), _head_blank().cut(mouth)
    return shank.union(ring).union(head).val()  # pyright: ignore[reportReturnType]


def _socket() -> cq.Workplane:
    """The ring's opening: two hexagons a twelfth of a turn apart, the usual twelve points."""
    # Where the sides of the two hexagons cross, halfway between their corners.
    crossing = ACROSS_FLATS_MM / 2.0 / cos(radians(15.0))
    outline = []
    for step in range(24):
        radius = CORNER_MM if step % 2 == 0 else crossing
        outline.append((radius * cos(radians(15.0 * step)), radius * sin(radians(15.0 * step))))
    return cq.Workplane().polyline(outline).close().extrude(RING_THICKNESS_MM, both=True)


def _mouth() -> cq.Workplane:
    """The open end's opening: the nut's hexagon and the way in, tilted."""
    nut = cq.Workplane().polygon(6, 2.0 * CORNER_MM).extrude(RING_THICKNESS_MM, both=True)
    way_in = cq.Workplane().center(25.0, 0.0).rect(50.0, ACROSS_FLATS_MM)
    return _to_head(nut.union(way_in.extrude(RING_THICKNESS_MM, both=True)))


def _to_head(part: cq.Workplane) -> cq.Workplane:
    return part.rotate((0, 0, 0), (0, 0, 1), TILT_DEG).translate((HEAD_AT_MM, 0.0, 0.0))


def _shank() -> cq.Workplane:
    half = SHANK_WIDTH_MM / 2.0
    # The shank flares into both heads, without a corner where they meet.
    outline = (
        cq.Workplane()
        .moveTo(1.0, 8.6)
        .spline([(14.0, half + 1.2), (28.0, half)], includeCurrent=True)
        .lineTo(110.0, half)
        .spline([(124.0, half + 1.4), (138.0, 12.5)], includeCurrent=True)
        .lineTo(138.0, -12.5)
        .spline([(124.0, -half - 1.4), (110.0, -half)], includeCurrent=True)
        .lineTo(28.0, -half)
        .spline([(14.0, -half - 1.2), (1.0, -8.6)], includeCurrent=True)
        .close()
        .extrude(SHANK_THICKNESS_MM / 2.0, both=True)
    )
    shank = outline.faces("|Z").edges().fillet(ROUNDING_MM)
    for side in (1.0, -1.0):
        panel = (
            cq.Workplane(origin=((PANEL_FROM_MM + PANEL_TO_MM) / 2.0, 0.0, 0.0))
            .workplane(offset=side * (SHANK_THICKNESS_MM / 2.0 - PANEL_DEPTH_MM))
            .slot2D(PANEL_TO_MM - PANEL_FROM_MM, SHANK_WIDTH_MM - 2.0 * PANEL_RIM_MM)
            .extrude(side * SHANK_THICKNESS_MM)
        )
        shank = shank.cut(panel)
    return shank


def _ring_blank() -> cq.Workplane:
    ring = cq.Workplane().circle(RING_RADIUS_MM).extrude(RING_THICKNESS_MM / 2.0, both=True)
    return ring.faces("|Z").edges().fillet(ROUNDING_MM)


def _head_blank() -> cq.Workplane:
    # The jaws' ends are cut flat, as forged wrenches are.
    keep = cq.Workplane().center(JAW_LENGTH_MM - 50.0, 0.0).rect(100.0, 100.0)
    head = (
        cq.Workplane()
        .circle(HEAD_RADIUS_MM)
        .extrude(HEAD_THICKNESS_MM / 2.0, both=True)
        .intersect(keep.extrude(50.0, both=True))
    )
    return _to_head(head.faces("|Z").edges().fillet(ROUNDING_MM))
