"""Combination pliers, a little open: the pivot at the origin, jaws towards +y, handles below.

Each half is drawn closed, its jaw left of x = 0 and its handle right, then turned about the
pivot; the other half is its mirror image.
"""

from math import cos, radians, sin

import cadquery as cq

from t2twin.primitives_cad.shape import Keypoint

OPENING_DEG = 4.0
"""Rotation of each half from closed."""

THICKNESS_MM = 9.0
JAW_TIP_MM = 48.0
"""Length of the jaws from the pivot, mm."""
JAW_TIP_WIDTH_MM = 5.2
TEETH_FROM_MM, TEETH_TO_MM = 24.0, 46.0
TOOTH_PITCH_MM = 2.0
TOOTH_DEPTH_MM = 1.1
GRIP_MIDDLE_MM = 16.0
"""y of the center of the round opening for pipes behind the flat teeth, mm."""
GRIP_HALF_WIDTH_MM, GRIP_HALF_LENGTH_MM = 3.4, 5.6

BOSS_RADIUS_MM = 11.5
BOSS_HEIGHT_MM = 0.8
RIVET_RADIUS_MM = 4.6
RIVET_HEIGHT_MM = 1.6
"""Both above the flat side, mm."""

SLEEVE_THICKNESS_MM = 12.0
SLEEVE_ROUNDING_MM = 3.6
STEEL_ROUNDING_MM = 1.0
SLEEVE_AT_MM = (17.4, -74.0)
"""Center of the plastic sleeve, mm."""


def _turned(x_mm: float, y_mm: float) -> tuple[float, float]:
    """Rotate a point from a half's closed frame to the open pliers."""
    turn = radians(OPENING_DEG)
    return (x_mm * cos(turn) - y_mm * sin(turn), x_mm * sin(turn) + y_mm * cos(turn))


KEYPOINTS = (
    Keypoint(
        "jaw-tip", (*_turned(-JAW_TIP_WIDTH_MM / 2.0, JAW_TIP_MM), 0.0), (*_turned(0.0, 1.0), 0.0)
    ),
    Keypoint("teeth", (*_turned(-2.2, 36.0), THICKNESS_MM / 2.0), (0.0, 0.0, 1.0)),
    Keypoint("pivot", (0.0, 0.0, THICKNESS_MM / 2.0 + RIVET_HEIGHT_MM), (0.0, 0.0, 1.0)),
    Keypoint("handle", (*_turned(*SLEEVE_AT_MM), SLEEVE_THICKNESS_MM / 2.0), (0.0, 0.0, 1.0)),
)


def solid() -> cq.Shape:
    """The pliers, one solid."""
    half = _jaw().union(_lever()).union(_sleeve())
    half = half.rotate((0, 0, 0), (0, 0, 1), OPENING_DEG)
    pliers = half.union(half.mirror("YZ")).union(_pivot())
    return pliers.val()  # pyright: ignore[reportReturnType]


def _jaw() -> cq.Workplane:
    teeth = [(0.0, TEETH_TO_MM)]
    count = round((TEETH_TO_MM - TEETH_FROM_MM) / TOOTH_PITCH_MM)
    for tooth in range(count):
        crest = TEETH_TO_MM - tooth * TOOTH_PITCH_MM
        teeth += [
            (-TOOTH_DEPTH_MM, crest - TOOTH_PITCH_MM / 2.0),
            (0.0, crest - TOOTH_PITCH_MM),
        ]
    jaw = (
        cq.Workplane()
        .moveTo(0.0, 0.0)
        .lineTo(-BOSS_RADIUS_MM, 0.0)
        .threePointArc((-10.4, 25.0), (-JAW_TIP_WIDTH_MM, JAW_TIP_MM))
        .lineTo(0.0, JAW_TIP_MM)
    )
    for place in teeth:
        jaw = jaw.lineTo(*place)
    jaw = jaw.close().extrude(THICKNESS_MM / 2.0, both=True)
    outer = jaw.edges(cq.selectors.BoxSelector((-20.0, 1.0, -9.0), (-5.3, 47.0, 9.0)))
    jaw = outer.edges("not |Z").fillet(STEEL_ROUNDING_MM)
    pipe = (
        cq.Workplane(origin=(0.0, GRIP_MIDDLE_MM, 0.0))
        .ellipse(GRIP_HALF_WIDTH_MM, GRIP_HALF_LENGTH_MM)
        .extrude(THICKNESS_MM, both=True)
    )
    return jaw.cut(pipe)


def _pivot() -> cq.Workplane:
    top = THICKNESS_MM / 2.0
    boss = cq.Workplane().circle(BOSS_RADIUS_MM).extrude(top + BOSS_HEIGHT_MM, both=True)
    boss = boss.faces("|Z").edges().fillet(0.7)
    rivet = cq.Workplane().circle(RIVET_RADIUS_MM).extrude(top + RIVET_HEIGHT_MM, both=True)
    return boss.union(rivet.faces("|Z").edges().fillet(0.6))


def _lever() -> cq.Workplane:
    """The steel from the pivot into the sleeve."""
    return (
        cq.Workplane()
        .moveTo(-6.0, -4.0)
        .threePointArc((4.0, -22.0), (11.5, -46.0))
        .lineTo(19.0, -45.0)
        .threePointArc((15.5, -24.0), (10.0, -3.0))
        .close()
        .extrude(THICKNESS_MM / 2.0 - 0.4, both=True)
        .faces("|Z")
        .edges()
        .fillet(STEEL_ROUNDING_MM)
    )


def _sleeve() -> cq.Workplane:
    """The plastic grip: bowed outwards, with a lip before the fingers and a round end."""
    return (
        cq.Workplane()
        .moveTo(3.4, -30.0)
        .threePointArc((9.3, -51.0), (11.2, -74.0))
        .tangentArcPoint((7.2, -113.0), relative=False)
        .tangentArcPoint((17.4, -114.4), relative=False)
        .tangentArcPoint((23.2, -76.0), relative=False)
        .tangentArcPoint((18.8, -28.0), relative=False)
        .close()
        .extrude(SLEEVE_THICKNESS_MM / 2.0, both=True)
        .faces("|Z")
        .edges()
        .fillet(SLEEVE_ROUNDING_MM)
    )
