"""Hand tools of the test split: a solid in the tool's own frame, flat side up, and four keypoints.

Grella et al. 2023 name the five tools, but not their sizes, which are assumed to be common ones.
"""

from functools import partial
from math import cos, hypot, radians, sin, sqrt
from typing import Any

import cadquery as cq

CHORDAL_MM = {"pliers": 0.0025}  # the error along their handles is larger than requested (measured)
UP = (0.0, 0.0, 1.0)
Point = tuple[float, float]  # x, y, mm


def solid(tool: str) -> cq.Shape:
    """The CadQuery solid of a tool, in the tool's own frame."""
    return SOLIDS[tool]().val()  # pyright: ignore[reportReturnType]


def _turned(x_mm: float, y_mm: float, angle_deg: float) -> tuple[float, float]:
    """A point after a turn about the origin."""
    turn = radians(angle_deg)
    return (x_mm * cos(turn) - y_mm * sin(turn), x_mm * sin(turn) + y_mm * cos(turn))


def _outline(start: Point, *onward: Any) -> cq.Workplane:
    """A closed outline of lines to points, and of arcs through a point to another: pairs."""
    outline = cq.Workplane().moveTo(*start)
    for one, other in onward:
        is_arc = isinstance(one, tuple)
        outline = outline.threePointArc(one, other) if is_arc else outline.lineTo(one, other)
    return outline.close()


def _slab(outline: cq.Workplane, half_thickness_mm: float, rounding_mm: float) -> cq.Workplane:
    """An outline extruded to both sides, with the edges of its flat sides rounded."""
    return outline.extrude(half_thickness_mm, both=True).faces("|Z").edges().fillet(rounding_mm)


# Pliers: combination pliers, a little open, the pivot at the origin, jaws towards +y, handles
# below. Each half is drawn closed, its jaw left of x = 0 and its handle right, then turned about
# the pivot; the other half is its mirror image.

PLIERS_OPENING_DEG = 4.0  # rotation of each half from closed
PLIERS_THICKNESS_MM = 9.0
JAW_TIP_MM, JAW_TIP_WIDTH_MM = 48.0, 5.2  # length of the jaws from the pivot, and their width
TEETH_FROM_MM, TEETH_TO_MM = 24.0, 46.0
TOOTH_PITCH_MM, TOOTH_DEPTH_MM = 2.0, 1.1
BOSS_RADIUS_MM = 11.5
RIVET_HEIGHT_MM = 1.6  # above the flat side, mm
SLEEVE_THICKNESS_MM = 12.0
SLEEVE_AT_MM = (17.4, -74.0)  # center of the plastic sleeve, mm


def _pliers() -> cq.Workplane:
    lever = _outline(  # the steel from the pivot into the sleeve
        (-6.0, -4.0), ((4.0, -22.0), (11.5, -46.0)), (19.0, -45.0), ((15.5, -24.0), (10.0, -3.0))
    )
    sleeve = (  # the plastic grip: bowed outwards, with a lip before the fingers and a round end
        cq.Workplane()
        .moveTo(3.4, -30.0)
        .threePointArc((9.3, -51.0), (11.2, -74.0))
        .tangentArcPoint((7.2, -113.0), relative=False)
        .tangentArcPoint((17.4, -114.4), relative=False)
        .tangentArcPoint((23.2, -76.0), relative=False)
        .tangentArcPoint((18.8, -28.0), relative=False)
        .close()
    )
    top = PLIERS_THICKNESS_MM / 2.0
    half = _jaw().union(_slab(lever, top - 0.4, 1.0))
    half = half.union(_slab(sleeve, SLEEVE_THICKNESS_MM / 2.0, 3.6))
    half = half.rotate((0, 0, 0), UP, PLIERS_OPENING_DEG)
    boss = _slab(cq.Workplane().circle(BOSS_RADIUS_MM), top + 0.8, 0.7)
    rivet = _slab(cq.Workplane().circle(4.6), top + RIVET_HEIGHT_MM, 0.6)
    return half.union(half.mirror("YZ")).union(boss.union(rivet))


def _jaw() -> cq.Workplane:
    teeth = []
    for tooth in range(round((TEETH_TO_MM - TEETH_FROM_MM) / TOOTH_PITCH_MM)):
        crest = TEETH_TO_MM - tooth * TOOTH_PITCH_MM
        teeth += [(-TOOTH_DEPTH_MM, crest - TOOTH_PITCH_MM / 2.0), (0.0, crest - TOOTH_PITCH_MM)]
    tip = (-10.4, 25.0), (-JAW_TIP_WIDTH_MM, JAW_TIP_MM)
    corners = (0.0, 0.0), (-BOSS_RADIUS_MM, 0.0), tip, (0.0, JAW_TIP_MM), (0.0, TEETH_TO_MM)
    jaw = _outline(*corners, *teeth).extrude(PLIERS_THICKNESS_MM / 2.0, both=True)
    outer = jaw.edges(cq.selectors.BoxSelector((-20.0, 1.0, -9.0), (-5.3, 47.0, 9.0)))
    jaw = outer.edges("not |Z").fillet(1.0)
    # The round opening for pipes behind the flat teeth.
    pipe = cq.Workplane(origin=(0.0, 16.0, 0.0)).ellipse(3.4, 5.6)
    return jaw.cut(pipe.extrude(PLIERS_THICKNESS_MM, both=True))


# Clamp: a G-clamp with a C frame, a threaded screw with a swivel pad, and a sliding T-bar handle.
# The screw's axis is y, the fixed anvil at the top, the frame's spine on the left (-x).

FRAME_THICKNESS_MM = 11.0
SPINE_LEFT_MM, SPINE_RIGHT_MM = -62.0, -47.0
FRAME_TOP_MM, FRAME_BOTTOM_MM = 76.0, -15.0
UPPER_ARM_MM, LOWER_ARM_MM = 62.0, 0.0  # y of the frame's inner sides, mm
WEB_DEPTH_MM = 0.5  # depth of the web between the flanges of the frame's I section, mm
CORE_RADIUS_MM, CREST_RADIUS_MM = 5.0, 6.4
THREAD_PITCH_MM = 3.0
CREST_WIDTH_MM, ROOT_WIDTH_MM = 0.9, 1.9  # axial widths of the thread's crest and core
# y of the first crest and number of crests, below the boss and above it. They are rings, because
# the kernel takes minutes to mesh such a fine helix.
THREADS = ((-80.0, 20), (6.5, 9))

PAD_RADIUS_MM, PAD_FROM_MM, PAD_TO_MM = 10.0, 34.0, 41.0
BAR_HALF_LENGTH_MM, BAR_AT_MM = 36.0, -91.0
BALL_RADIUS_MM = 5.2  # of the T-bar's ends
# y of a crest 31 mm from the higher boss and head, which no array touches: its corner is 26.4 mm
# from its center, which the protocol moves by up to 2.1 mm.
CREST_AT_MM = THREADS[0][0] + 10 * THREAD_PITCH_MM


def _clamp() -> cq.Workplane:
    half = FRAME_THICKNESS_MM / 2.0
    frame = _frame(0.0, half).faces("|Z").edges().fillet(1.0)
    panel = _frame(3.6, WEB_DEPTH_MM / 2.0)  # inside flanges of this width
    for side in (1.0, -1.0):
        frame = frame.cut(panel.translate((0.0, 0.0, side * (half - WEB_DEPTH_MM / 2.0))))
    anvil = _turned_part([(9.0, 54.0), (9.0, FRAME_TOP_MM)], 1.0)
    boss = _turned_part([(9.5, FRAME_BOTTOM_MM - 4.0), (9.5, LOWER_ARM_MM + 4.0)], 1.0)
    bar = cq.Workplane("YZ", origin=(0.0, BAR_AT_MM, 0.0)).circle(3.2)
    bar = bar.extrude(BAR_HALF_LENGTH_MM, both=True)
    for side in (1.0, -1.0):
        ball = cq.Workplane(origin=(side * BAR_HALF_LENGTH_MM, BAR_AT_MM, 0.0))
        bar = bar.union(ball.sphere(BALL_RADIUS_MM))
    return frame.union(anvil).union(boss).union(_screw()).union(bar)


def _frame(inset: float, half_thickness: float) -> cq.Workplane:
    """The C, its sides moved inwards by inset."""
    left, right = SPINE_LEFT_MM + inset, SPINE_RIGHT_MM - inset
    top, bottom = FRAME_TOP_MM - inset, FRAME_BOTTOM_MM + inset
    upper, lower = UPPER_ARM_MM + inset, LOWER_ARM_MM - inset
    outline = [
        (-inset, top), (left, top), (left, bottom), (-inset, bottom),
        (-inset, lower), (right, lower), (right, upper), (-inset, upper),
    ]  # fmt: skip
    frame = cq.Workplane().polyline(outline).close().extrude(half_thickness, both=True)
    outer = cq.selectors.BoxSelector((-99, -99, -99), (left + 1, 99, 99))
    inner = cq.selectors.BoxSelector((right - 1, -99, -99), (right + 1, 99, 99))
    frame = frame.edges("|Z").edges(outer).fillet(20.0 - inset)
    return frame.edges("|Z").edges(inner).fillet(9.0 + inset)


def _screw() -> cq.Workplane:
    """The head, the thread and the pad."""
    profile = [(8.0, -100.0), (8.0, -82.0), (CORE_RADIUS_MM, -82.0)]
    for start, count in THREADS:
        for crest in (start + THREAD_PITCH_MM * turn for turn in range(count)):
            profile += [
                (CORE_RADIUS_MM, crest - ROOT_WIDTH_MM / 2.0),
                (CREST_RADIUS_MM, crest - CREST_WIDTH_MM / 2.0),
                (CREST_RADIUS_MM, crest + CREST_WIDTH_MM / 2.0),
                (CORE_RADIUS_MM, crest + ROOT_WIDTH_MM / 2.0),
            ]
    profile += [(CORE_RADIUS_MM, PAD_FROM_MM - 2.0), (CORE_RADIUS_MM + 2.0, PAD_FROM_MM)]
    profile += [(PAD_RADIUS_MM, PAD_FROM_MM), (PAD_RADIUS_MM, PAD_TO_MM)]
    return _turned_part(profile, 0.0)


def _turned_part(profile: list[tuple[float, float]], chamfer_mm: float) -> cq.Workplane:
    """A solid of revolution about y: (radius, y) pairs from the bottom to the top, mm."""
    outline = _outline((0.0, profile[0][1]), *profile, (0.0, profile[-1][1]))
    part = outline.revolve(360.0, (0, 0, 0), (0, 1, 0))
    return part.faces("<Y or >Y").chamfer(chamfer_mm) if chamfer_mm else part


# Scissors: a little open, the pivot at the origin, blades towards +y, ring handles below. Each half
# is drawn closed, its blade straight up, then turned about the pivot.

SCISSORS_OPENING_DEG = 13.0  # rotation of each half from closed
BLADE_THICKNESS_MM = 2.4
# cutting edge of the closed half, from near the pivot to the tip
EDGE_AT = ((5.0, 3.0), (0.6, 80.0))
SPINE = ((-5.2, 50.0), (-8.0, 18.0))  # points on the blade's back, mm
BEVEL_WIDTH_MM, BEVEL_LAND_MM = 2.2, 0.5  # width of the bevel, and thickness at the cutting edge
PIVOT_RADIUS_MM = 9.0
RING_AT_MM = (18.5, -60.0)
RING_HALF_WIDTH_MM, RING_BAR_MM = 15.0, 6.0
THUMB_HALF_LENGTH_MM, FINGER_HALF_LENGTH_MM = 17.0, 23.0
HANDLE_THICKNESS_MM = 8.0
SCREW_TOP_MM = 4.2
SLOT_TURN_DEG = 35.0


def _scissors() -> cq.Workplane:
    upper = _half_scissors(THUMB_HALF_LENGTH_MM)
    # The other half is the same, turned over about y, with the longer ring.
    lower = _half_scissors(FINGER_HALF_LENGTH_MM).rotate((0, 0, 0), (0, 1, 0), 180.0)
    screw = _slab(cq.Workplane().circle(4.6), SCREW_TOP_MM, 0.9)
    slot = cq.Workplane().workplane(offset=SCREW_TOP_MM - 0.8).rect(4.0 * 4.6, 1.2)
    slot = slot.extrude(SCREW_TOP_MM).rotate((0, 0, 0), UP, SLOT_TURN_DEG)
    return upper.union(lower).union(screw.cut(slot))


def _half_scissors(ring_half_length_mm: float) -> cq.Workplane:
    blade = (
        cq.Workplane()
        .moveTo(*EDGE_AT[0])
        .lineTo(*EDGE_AT[1])
        .lineTo(-0.6, 81.0)
        .spline([*SPINE, (-PIVOT_RADIUS_MM, 0.0)], includeCurrent=True)
        .lineTo(PIVOT_RADIUS_MM - 2.0, 0.0)
        .close()
        .extrude(BLADE_THICKNESS_MM)
        .cut(_bevel())
    )
    pivot = cq.Workplane().circle(PIVOT_RADIUS_MM).extrude(BLADE_THICKNESS_MM)
    half = blade.union(pivot).union(_scissors_handle(ring_half_length_mm))
    return half.rotate((0, 0, 0), UP, SCISSORS_OPENING_DEG)


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
    low, high = BEVEL_LAND_MM - 5.0 * slope, BLADE_THICKNESS_MM + 5.0 * slope
    corners = ((-5.0, low), (BEVEL_WIDTH_MM + 5.0, high), (-5.0, top))
    wedge = cq.Workplane(start).polyline([(x, start.yDir.z * z) for x, z in corners])
    ground = wedge.close().extrude(length + 40.0)
    beyond_pivot = cq.Workplane().center(0.0, 60.0).rect(60.0, 96.0).extrude(top, both=True)
    return ground.intersect(beyond_pivot)


def _scissors_handle(ring_half_length_mm: float) -> cq.Workplane:
    x, y = RING_AT_MM
    at = cq.Workplane(origin=(x, y - (ring_half_length_mm - THUMB_HALF_LENGTH_MM), 0.0))
    ring = _oval(at, RING_HALF_WIDTH_MM, ring_half_length_mm)
    hole = _oval(at, RING_HALF_WIDTH_MM - RING_BAR_MM, ring_half_length_mm - RING_BAR_MM)
    ring = ring.cut(hole).faces("|Z").edges().fillet(2.6)
    arm = _outline(
        (2.2, -19.0), ((6.0, -34.0), (12.0, -46.5)), (21.0, -45.5), ((15.0, -32.0), (12.0, -19.0))
    )
    tang = _outline((-5.0, 0.0), (8.5, 0.0), (11.5, -24.0), (4.0, -24.0))
    tang = tang.extrude(BLADE_THICKNESS_MM)
    return tang.union(_slab(arm, HANDLE_THICKNESS_MM / 2.0, 1.5)).union(ring.cut(hole))


def _oval(at: cq.Workplane, half_width_mm: float, half_length_mm: float) -> cq.Workplane:
    """A stadium along y, as thick as the handles: an ellipse would be meshed 30 times finer."""
    straight = at.rect(2.0 * half_width_mm, 2.0 * (half_length_mm - half_width_mm))
    oval = straight.extrude(HANDLE_THICKNESS_MM / 2.0, both=True)
    for side in (1.0, -1.0):
        end = at.center(0.0, side * (half_length_mm - half_width_mm)).circle(half_width_mm)
        oval = oval.union(end.extrude(HANDLE_THICKNESS_MM / 2.0, both=True))
    return oval


# Allen key: a bar of hexagon section bent into an L, the bend at the origin's corner. The long arm
# lies along +x, the short one along +y; flats of the hexagon face +-z.

KEY_FLAT_MM = 6.0 / 2.0  # distance of the hexagon's flats from its center, mm
KEY_CORNER_MM = 6.0 / sqrt(3.0)  # distance of the hexagon's corners from its center, mm
SHORT_ARM_MM = 38.0
BEND_RADIUS_MM = 11.0  # radius of the bend, to the center line of the bar, mm
BEND_MIDDLE_MM = BEND_RADIUS_MM * (1.0 - sqrt(0.5))  # x and y of the center of the bend, mm


def _allen_key() -> cq.Workplane:
    long_arm, chamfer = 96.0, 0.4
    path = (
        cq.Workplane("XY")
        .moveTo(long_arm, 0.0)
        .lineTo(BEND_RADIUS_MM, 0.0)
        .threePointArc((BEND_MIDDLE_MM, BEND_MIDDLE_MM), (0.0, BEND_RADIUS_MM))
        .lineTo(0.0, SHORT_ARM_MM)
    )
    section = cq.Workplane("YZ", origin=(long_arm, 0.0, 0.0)).polygon(6, 2.0 * KEY_CORNER_MM)
    return section.sweep(path).faces(">X").chamfer(chamfer).faces(">Y").chamfer(chamfer)


# Wrench: a combination wrench along x, the ring end at the origin, the open end at HEAD_AT_MM.

NUT_MM = 13.0  # across the flats of the nut
NUT_CORNER_MM = NUT_MM / sqrt(3.0)
HEAD_AT_MM = 142.0  # x of the center of the open end, mm
RING_RADIUS_MM, RING_THICKNESS_MM = 10.8, 8.4
HEAD_THICKNESS_MM = 6.4
JAW_LENGTH_MM = 10.0  # length of the jaws from the center of the nut, mm
TILT_DEG = -15.0  # angle of the open end's jaws to the shank: the usual 15 degrees
SHANK_WIDTH_MM, SHANK_THICKNESS_MM = 11.5, 5.2
PANEL_DEPTH_MM = 0.45
ROUNDING_MM = 0.9


def _at_head(along_mm: float, across_mm: float) -> tuple[float, float]:
    """x, y of a point given along and across the tilted jaws from the center of the nut."""
    x, y = _turned(along_mm, across_mm, TILT_DEG)
    return HEAD_AT_MM + x, y


def _to_head(part: cq.Workplane) -> cq.Workplane:
    return part.rotate((0, 0, 0), UP, TILT_DEG).translate((HEAD_AT_MM, 0.0, 0.0))


def _wrench() -> cq.Workplane:
    # The ring's opening: two hexagons a twelfth of a turn apart, the usual twelve points. Their
    # sides cross halfway between the corners.
    crossing = NUT_MM / 2.0 / cos(radians(15.0))
    radii = [NUT_CORNER_MM, crossing] * 12
    outline = [_turned(radius, 0.0, 15.0 * step) for step, radius in enumerate(radii)]
    socket = cq.Workplane().polyline(outline).close().extrude(RING_THICKNESS_MM, both=True)
    # The open end's opening: the nut's hexagon and the way in.
    nut = cq.Workplane().polygon(6, 2.0 * NUT_CORNER_MM).extrude(RING_THICKNESS_MM, both=True)
    way_in = cq.Workplane().center(25.0, 0.0).rect(50.0, NUT_MM)
    mouth = _to_head(nut.union(way_in.extrude(RING_THICKNESS_MM, both=True)))
    ring = _slab(cq.Workplane().circle(RING_RADIUS_MM), RING_THICKNESS_MM / 2.0, ROUNDING_MM)
    # The jaws' ends are cut flat, as forged wrenches are.
    keep = cq.Workplane().center(JAW_LENGTH_MM - 50.0, 0.0).rect(100.0, 100.0)
    head = cq.Workplane().circle(14.5).extrude(HEAD_THICKNESS_MM / 2.0, both=True)
    head = head.intersect(keep.extrude(50.0, both=True)).faces("|Z").edges().fillet(ROUNDING_MM)
    # Each part is cut before the union: the kernel cannot cut the joined ring.
    shank = _shank().cut(socket).cut(mouth)
    return shank.union(ring.cut(socket)).union(_to_head(head).cut(mouth))


def _shank() -> cq.Workplane:
    """The shank with a panel on both sides; it flares into both heads, without a corner there."""
    half = SHANK_WIDTH_MM / 2.0
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
    )
    shank = _slab(outline, SHANK_THICKNESS_MM / 2.0, ROUNDING_MM)
    for side in (1.0, -1.0):
        bottom = side * (SHANK_THICKNESS_MM / 2.0 - PANEL_DEPTH_MM)
        panel = cq.Workplane(origin=(69.0, 0.0, 0.0)).workplane(offset=bottom)
        panel = panel.slot2D(70.0, SHANK_WIDTH_MM - 2.0 * 2.4)
        shank = shank.cut(panel.extrude(side * SHANK_THICKNESS_MM))
    return shank


SOLIDS = {"pliers": _pliers, "clamp": _clamp, "scissors": _scissors, "allen-key": _allen_key,
          "wrench": _wrench}  # fmt: skip

PLIERS_TOP_MM = PLIERS_THICKNESS_MM / 2.0
SPINE_MIDDLE_MM = (SPINE_LEFT_MM + SPINE_RIGHT_MM) / 2.0
RING_SIDE_MM = RING_AT_MM[0] + RING_HALF_WIDTH_MM - RING_BAR_MM / 2.0
SLOT = radians(SLOT_TURN_DEG)
_jaw_point = partial(_turned, angle_deg=PLIERS_OPENING_DEG)
_blade_point = partial(_turned, angle_deg=SCISSORS_OPENING_DEG)

UP = (0.0, 0.0, 1.0)
# Places and directions, unit vectors outwards, at which tools are pressed, in their own frames
KEYPOINTS: dict[str, dict[str, tuple[tuple[float, float, float], tuple[float, float, float]]]] = {
    "pliers": {
        "jaw-tip": ((*_jaw_point(-JAW_TIP_WIDTH_MM / 2.0, JAW_TIP_MM), 0.0),
                    (*_jaw_point(0.0, 1.0), 0.0)),
        "teeth": ((*_jaw_point(-2.2, 36.0), PLIERS_TOP_MM), UP),
        "pivot": ((0.0, 0.0, PLIERS_TOP_MM + RIVET_HEIGHT_MM), UP),
        "handle": ((*_jaw_point(*SLEEVE_AT_MM), SLEEVE_THICKNESS_MM / 2.0), UP),
    },
    "clamp": {
        "screw": ((0.0, CREST_AT_MM, CREST_RADIUS_MM), UP),
        "pad": ((0.0, (PAD_FROM_MM + PAD_TO_MM) / 2.0, PAD_RADIUS_MM), UP),
        "frame": ((SPINE_MIDDLE_MM, 27.0, FRAME_THICKNESS_MM / 2.0 - WEB_DEPTH_MM), UP),
        "handle": ((BAR_HALF_LENGTH_MM + BALL_RADIUS_MM, BAR_AT_MM, 0.0), (1.0, 0.0, 0.0)),
    },
    "scissors": {
        "blade-tip": ((*_blade_point(-1.7, 66.0), BLADE_THICKNESS_MM), UP),
        "blade-back": ((*_blade_point(*SPINE[0]), BLADE_THICKNESS_MM / 2.0),
                       (*_blade_point(-0.9950, 0.0995), 0.0)),
        "pivot": ((-2.4 * sin(SLOT), 2.4 * cos(SLOT), SCREW_TOP_MM), UP),
        "ring": ((*_blade_point(RING_SIDE_MM, RING_AT_MM[1]), HANDLE_THICKNESS_MM / 2.0), UP),
    },
    "allen-key": {
        "long-arm": ((62.0, 0.0, KEY_FLAT_MM), UP),
        "bend": ((BEND_MIDDLE_MM, BEND_MIDDLE_MM, KEY_FLAT_MM), UP),
        "short-end": ((0.0, SHORT_ARM_MM, 0.0), (0.0, 1.0, 0.0)),
        "ridge": ((56.0, -KEY_CORNER_MM, 0.0), (0.0, -1.0, 0.0)),
    },
    "wrench": {
        "ring": ((-(NUT_CORNER_MM + RING_RADIUS_MM) / 2.0, 0.0, RING_THICKNESS_MM / 2.0), UP),
        "open-end": ((*_at_head(3.5, -10.0), HEAD_THICKNESS_MM / 2.0), UP),
        "shank": ((70.0, 0.0, SHANK_THICKNESS_MM / 2.0 - PANEL_DEPTH_MM), UP),
        "jaw-end": ((*_at_head(JAW_LENGTH_MM, 8.4), 0.0),
                    (*_turned(1.0, 0.0, TILT_DEG), 0.0)),
    },
}  # fmt: skip
