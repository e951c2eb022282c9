"""A G-clamp: a C frame, a threaded screw with a swivel pad, and a sliding T-bar handle.

The screw's axis is y, the fixed anvil at the top, the frame's spine on the left (-x).
"""

import cadquery as cq

from t2twin.primitives_cad.shape import Keypoint

FRAME_THICKNESS_MM = 11.0
SPINE_LEFT_MM, SPINE_RIGHT_MM = -62.0, -47.0
FRAME_TOP_MM, FRAME_BOTTOM_MM = 76.0, -15.0
ARM_RIGHT_MM = 0.0
UPPER_ARM_MM, LOWER_ARM_MM = 62.0, 0.0
"""y of the frame's inner sides, mm."""
OUTER_CORNER_MM, INNER_CORNER_MM = 20.0, 9.0
RIM_MM, WEB_DEPTH_MM = 3.6, 0.5
"""The frame's I section: width of the flanges, and depth of the web between them, mm."""

ANVIL_RADIUS_MM, ANVIL_MM = 9.0, 54.0
BOSS_RADIUS_MM = 9.5

CORE_RADIUS_MM, CREST_RADIUS_MM = 5.0, 6.4
THREAD_PITCH_MM = 3.0
CREST_WIDTH_MM, ROOT_WIDTH_MM = 0.9, 1.9
"""Axial width of the thread at its crest and at the core, mm."""
THREADS = ((-80.0, 20), (6.5, 9))
"""y of the first crest and number of crests, below the boss and above it. Crests are rings, not a
helix: the lead angle is under 5 degrees, and the kernel takes minutes to mesh such a fine helix."""

PAD_RADIUS_MM, PAD_FROM_MM, PAD_TO_MM = 10.0, 34.0, 41.0
HEAD_RADIUS_MM, HEAD_FROM_MM, HEAD_TO_MM = 8.0, -100.0, -82.0
BAR_RADIUS_MM, BAR_HALF_LENGTH_MM, BAR_AT_MM = 3.2, 36.0, -91.0
BALL_RADIUS_MM = 5.2

CREST_AT_MM = THREADS[0][0] + 10 * THREAD_PITCH_MM
"""y of a crest midway between the boss and the head, whose sides are higher. Both are 31 mm away. A
corner of an array pressed there is 26.4 mm from its center, which the protocol moves by up to
2.1 mm, so no corner touches them."""

KEYPOINTS = (
    Keypoint("screw", (0.0, CREST_AT_MM, CREST_RADIUS_MM), (0.0, 0.0, 1.0)),
    Keypoint("pad", (0.0, (PAD_FROM_MM + PAD_TO_MM) / 2.0, PAD_RADIUS_MM), (0.0, 0.0, 1.0)),
    Keypoint(
        "frame",
        ((SPINE_LEFT_MM + SPINE_RIGHT_MM) / 2.0, 27.0, FRAME_THICKNESS_MM / 2.0 - WEB_DEPTH_MM),
        (0.0, 0.0, 1.0),
    ),
    Keypoint("handle", (BAR_HALF_LENGTH_MM + BALL_RADIUS_MM, BAR_AT_MM, 0.0), (1.0, 0.0, 0.0)),
)


def solid() -> cq.Shape:
    """The clamp, one solid."""
    clamp = _frame().union(_screw()).union(_handle())
    return clamp.val()  # pyright: ignore[reportReturnType]


def _frame() -> cq.Workplane:
    def outline(inset: float) -> cq.Workplane:
        """The C, its sides moved inwards by inset, not yet with round corners."""
        return (
            cq.Workplane()
            .polyline(
                [
                    (ARM_RIGHT_MM - inset, FRAME_TOP_MM - inset),
                    (SPINE_LEFT_MM + inset, FRAME_TOP_MM - inset),
                    (SPINE_LEFT_MM + inset, FRAME_BOTTOM_MM + inset),
                    (ARM_RIGHT_MM - inset, FRAME_BOTTOM_MM + inset),
                    (ARM_RIGHT_MM - inset, LOWER_ARM_MM - inset),
                    (SPINE_RIGHT_MM - inset, LOWER_ARM_MM - inset),
                    (SPINE_RIGHT_MM - inset, UPPER_ARM_MM + inset),
                    (ARM_RIGHT_MM - inset, UPPER_ARM_MM + inset),
                ]
            )
            .close()
        )

    def rounded(inset: float, half_thickness: float) -> cq.Workplane:
        solid = outline(inset).extrude(half_thickness, both=True)
        left = cq.selectors.BoxSelector((-99, -99, -99), (SPINE_LEFT_MM + inset + 1, 99, 99))
        inner = cq.selectors.BoxSelector(
            (SPINE_RIGHT_MM - inset - 1, -99, -99), (SPINE_RIGHT_MM - inset + 1, 99, 99)
        )
        solid = solid.edges("|Z").edges(left).fillet(OUTER_CORNER_MM - inset)
        return solid.edges("|Z").edges(inner).fillet(INNER_CORNER_MM + inset)

    frame = rounded(0.0, FRAME_THICKNESS_MM / 2.0).faces("|Z").edges().fillet(1.0)
    panel = rounded(RIM_MM, WEB_DEPTH_MM / 2.0)
    middle = FRAME_THICKNESS_MM / 2.0 - WEB_DEPTH_MM / 2.0
    for side in (1.0, -1.0):
        frame = frame.cut(panel.translate((0.0, 0.0, side * middle)))
    anvil = _turned_part([(ANVIL_RADIUS_MM, ANVIL_MM), (ANVIL_RADIUS_MM, FRAME_TOP_MM)], 1.0)
    boss = _turned_part(
        [(BOSS_RADIUS_MM, FRAME_BOTTOM_MM - 4.0), (BOSS_RADIUS_MM, LOWER_ARM_MM + 4.0)], 1.0
    )
    return frame.union(anvil).union(boss)


def _screw() -> cq.Workplane:
    profile = [
        (HEAD_RADIUS_MM, HEAD_FROM_MM),
        (HEAD_RADIUS_MM, HEAD_TO_MM),
        (CORE_RADIUS_MM, HEAD_TO_MM),
    ]
    for crest in _crests():
        profile += [
            (CORE_RADIUS_MM, crest - ROOT_WIDTH_MM / 2.0),
            (CREST_RADIUS_MM, crest - CREST_WIDTH_MM / 2.0),
            (CREST_RADIUS_MM, crest + CREST_WIDTH_MM / 2.0),
            (CORE_RADIUS_MM, crest + ROOT_WIDTH_MM / 2.0),
        ]
    profile += [
        (CORE_RADIUS_MM, PAD_FROM_MM - 2.0),
        (CORE_RADIUS_MM + 2.0, PAD_FROM_MM),
        (PAD_RADIUS_MM, PAD_FROM_MM),
        (PAD_RADIUS_MM, PAD_TO_MM),
    ]
    return _turned_part(profile, 0.0)


def _crests() -> list[float]:
    """y of the thread's crests, below the boss and above it."""
    return [start + THREAD_PITCH_MM * turn for start, count in THREADS for turn in range(count)]


def _handle() -> cq.Workplane:
    bar = (
        cq.Workplane("YZ", origin=(0.0, BAR_AT_MM, 0.0))
        .circle(BAR_RADIUS_MM)
        .extrude(BAR_HALF_LENGTH_MM, both=True)
    )
    for side in (1.0, -1.0):
        ball = cq.Workplane(origin=(side * BAR_HALF_LENGTH_MM, BAR_AT_MM, 0.0))
        bar = bar.union(ball.sphere(BALL_RADIUS_MM))
    return bar


def _turned_part(profile: list[tuple[float, float]], chamfer_mm: float) -> cq.Workplane:
    """A solid of revolution about y: (radius, y) pairs from the bottom to the top, mm."""
    outline = cq.Workplane().moveTo(0.0, profile[0][1])
    for place in profile:
        outline = outline.lineTo(*place)
    part = outline.lineTo(0.0, profile[-1][1]).close().revolve(360.0, (0, 0, 0), (0, 1, 0))
    return part.faces("<Y or >Y").chamfer(chamfer_mm) if chamfer_mm else part
