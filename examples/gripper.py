"""A gripper with a DIGIT and a CySkin grasps five tools; a network predicts the CySkin's counts.

    python examples/gripper.py --out gripper.gif
    python examples/gripper.py --view --tools wrench

The DIGIT is in the left finger, the CySkin in the right one. The fingers close on a tool that a
magnet holds. The hand lifts and holds the tool, then the grip loosens until the tool slips.

The pretrained network predicts from the DIGIT's image what a CySkin in its place reads. The CySkin
touches the other side of the tool, which is the mirror image. The network therefore predicts the
counts at mirrored taxels, as a field run can. A second comparison does not need the mirror: its
truth is a virtual CySkin in the DIGIT's place, under the same force.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import mujoco
import mujoco.viewer
import numpy as np
from gripper_figure import MAX_COUNTS, Moment, Page, SceneRenderer, write_animation
from PIL import Image

import t2twin
from t2twin.attachment.geometry import Region, body_surface
from t2twin.sim.contact.elastomer import CYSKIN_COVER, DIGIT_GEL
from t2twin.sim.contact.sliding import COVER_FRICTION, GEL_FRICTION
from t2twin.sim.cyskin.tactile_image import colored_tactile_image
from t2twin.translate.uncertainty.estimate import Estimate

GRASPS = {
    "wrench": "shank",
    "pliers": "teeth",
    "scissors": "ring",
    "clamp": "screw",
    "allen-key": "long-arm",
}
"""The keypoint at which each tool is grasped."""

STEEL_KG_M3 = 7850.0
GRIP_N = 8.0
"""Force of each finger while it holds, N."""
LIFT_M, SLIPPED_M = 0.06, 0.012
"""Height of the lift, and distance that counts as slipped, m."""
CLOSED_S, LIFTED_S, HELD_S, END_S = 0.8, 1.8, 3.8, 6.6
"""Ends of the phases: close, lift, hold for 2 s, loosen, s."""
LOOSENING_S = 0.7
"""Time in which the grip force falls to 1 / e while the grip loosens, s."""
LEVEL, LEAST_N = 0.9, 0.4
"""Probability of the intervals, and least force on which the network was trained, N."""
CAMERA_AT_M = [0.0, 0.0, 0.14]
PANEL_PX = (120, 160)
"""Width and height of each sensor's image in MuJoCo's viewer."""
OPEN_M = 0.025
"""Distance of each sensor from the middle while the gripper is open, m."""
HANG_M = 0.02
"""Height of the tool's lowest point above the floor, m."""

CELL_MM, REACH_MM, LEVEL_MM = 4.0, 28.0, 0.3
"""Side of the cells of collision boxes, reach of these boxes from the grasp, and depth below the
highest place of a cell up to which a box covers the tool, mm."""
TOOL_FRICTION = [0.1, 0.005, 0.0001]
"""MuJoCo uses the larger friction of two geoms; the sensors' is larger. The second value, m, is
for torsion."""
PALM_M, HOUSING_M, MAGNET_HALF_M = 0.11, 0.009, 0.008
"""Height of the palm above the sensors' centers, half the thickness of a sensor's housing, half
side of the magnet, m."""
STEEL_RGBA, HAND_RGBA = [0.62, 0.65, 0.70, 1.0], [0.25, 0.28, 0.33, 1.0]
MAGNET_RGBA, FLOOR_RGBA = [0.75, 0.25, 0.2, 1.0], [0.88, 0.88, 0.86, 1.0]
SKY_RGB = [0.97, 0.97, 0.97]
GEOM, RAW = mujoco.mjtGeom, argparse.RawDescriptionHelpFormatter


@dataclass(frozen=True)
class Scene:
    """A compiled scene with its two sensors."""

    model: mujoco.MjModel
    digit: t2twin.AttachedSensor
    cyskin: t2twin.AttachedSensor


def build(tool: str, has_image: bool = False) -> Scene:
    """The gripper around a tool, which hangs with its center of mass below the grasp.

    has_image: whether the model has a user sensor for an image of both sensors, which MuJoCo's
    viewer shows.
    """
    shape = t2twin.load_shape(f"{tool}/{GRASPS[tool]}")
    vertices = in_scene(shape, np.asarray(shape.mesh.vertices))
    height = HANG_M - float(vertices[:, 2].min())
    spec = mujoco.MjSpec()
    add_room(spec)
    spec.add_mesh(
        name=tool, uservert=vertices.ravel(), userface=shape.mesh.faces.ravel(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_EXACT,
    )  # fmt: skip
    body = spec.worldbody.add_body(name=tool, pos=[0, 0, height])
    body.add_freejoint()
    body.add_geom(
        type=GEOM.mjGEOM_MESH, meshname=tool, density=STEEL_KG_M3, contype=0, conaffinity=0,
        rgba=STEEL_RGBA,
    )  # fmt: skip
    for center, half in collision_boxes(shape):
        body.add_geom(
            type=GEOM.mjGEOM_BOX, pos=center, size=half, quat=in_scene_quat(shape), mass=0, group=3,
            condim=4, friction=TOOL_FRICTION,
        )  # fmt: skip
    low = vertices[vertices[:, 2] < vertices[:, 2].min() + 2 * MAGNET_HALF_M]
    spec.worldbody.add_geom(
        type=GEOM.mjGEOM_BOX, size=[MAGNET_HALF_M, MAGNET_HALF_M, HANG_M / 2 + MAGNET_HALF_M],
        pos=[low[:, 0].max() + MAGNET_HALF_M, low[:, 1].mean(), HANG_M / 2 + MAGNET_HALF_M],
        contype=0, conaffinity=0, rgba=MAGNET_RGBA,
    )  # fmt: skip
    magnet = spec.add_equality(type=mujoco.mjtEq.mjEQ_WELD, name="magnet")
    magnet.objtype, magnet.name1, magnet.name2 = mujoco.mjtObj.mjOBJ_BODY, tool, "world"
    magnet.data[:] = [*np.zeros(10), 1.0, 0.0]  # the initial pose, the default torque scale
    digit, cyskin = add_gripper(spec, height)
    if not has_image:  # a sky would hide the image
        spec.add_texture(
            type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
            rgb1=SKY_RGB, width=8, height=48,
        )  # fmt: skip
    else:
        image = spec.add_sensor(name="image", type=mujoco.mjtSensor.mjSENS_USER)
        image.dim, image.intprm = 6 * PANEL_PX[0] * PANEL_PX[1], [2 * PANEL_PX[0], PANEL_PX[1], 0]
    return Scene(spec.compile(), digit, cyskin)


def add_room(spec: mujoco.MjSpec) -> None:
    """Floor, light and camera, and MuJoCo's options."""
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 20.0  # reduces the creep of contacts that stick
    spec.visual.headlight.ambient = spec.visual.headlight.diffuse = [0.4, 0.4, 0.4]
    spec.visual.map.znear = 0.02
    spec.worldbody.add_geom(
        type=GEOM.mjGEOM_CYLINDER, size=[0.14, 0.005, 0.0], pos=[0, 0, -0.005], contype=0,
        conaffinity=0, rgba=FLOOR_RGBA,
    )  # fmt: skip
    spec.worldbody.add_light(pos=[-0.3, -0.4, 0.8], dir=[0.3, 0.4, -0.8], castshadow=True)


def axes_of(shape: t2twin.Shape) -> np.ndarray:
    """(3, 3) the scene's axes in the shape frame: the center of mass is below the grasp, and the
    shape's pressing side faces -x."""
    up = -np.array([*shape.mesh.center_mass[:2], 0.0])
    up /= np.linalg.norm(up)
    out = np.array([0.0, 0.0, 1.0])
    return np.stack([-out, np.cross(out, up), up])


def in_scene(shape: t2twin.Shape, points_mm: np.ndarray) -> np.ndarray:
    """Points of the shape frame, (n, 3) mm, in the frame of the tool's body, m.

    The body's origin is in the middle of the grasp.
    """
    middle = [0.0, 0.0, shape.mesh.bounds[:, 2].mean()]
    return 1e-3 * (points_mm - middle) @ axes_of(shape).T


def in_scene_quat(shape: t2twin.Shape) -> np.ndarray:
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, axes_of(shape).ravel())
    return quat


def collision_boxes(shape: t2twin.Shape) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Centers and half sides, m, of boxes that fill the tool where the sensors can touch it.

    Each box has the height of the tool's highest place in a square cell, on both sides, as the two
    sides of the tool are alike.
    """
    middle = shape.mesh.bounds[:, 2].mean()
    inside = (np.arange(16) + 0.5) / 16 * CELL_MM
    corners = np.arange(-REACH_MM, REACH_MM, CELL_MM)
    for x_mm, y_mm in np.stack(np.meshgrid(corners, corners), -1).reshape(-1, 2):
        x, y = np.meshgrid(x_mm + inside, y_mm + inside)
        front = shape.surface.sample(x, y) - middle
        filled = (front > front.max() - LEVEL_MM) & (front > 0.0)
        if filled.any():
            low = np.array([x[filled].min(), y[filled].min(), middle - front.max()])
            high = np.array([x[filled].max(), y[filled].max(), middle + front.max()])
            yield in_scene(shape, (low + high) / 2), 1e-3 * (high - low) / 2


def add_gripper(spec: mujoco.MjSpec, height: float) -> tuple[t2twin.AttachedSensor, ...]:
    """A hand that moves up and down, two coupled fingers, and a sensor in each: DIGIT, CySkin.

    Actuators: force of the left and of the right finger, N, and height above the start, m.
    height: of the sensors' centers, m.
    """
    hand = spec.worldbody.add_body(name="hand", pos=[0, 0, height], gravcomp=1)
    hand.add_joint(name="lift", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1])
    hand.add_geom(
        type=GEOM.mjGEOM_BOX, size=[0.07, 0.016, 0.012], pos=[0, 0, PALM_M + 0.012], mass=0.5,
        contype=0, conaffinity=0, rgba=HAND_RGBA,
    )  # fmt: skip
    sensors = []
    for side, sign, sensor, thickness_mm, friction in (
        ("left", -1.0, "digit", DIGIT_GEL.thickness_mm, GEL_FRICTION),
        ("right", 1.0, "cyskin", CYSKIN_COVER.thickness_mm, COVER_FRICTION),
    ):
        finger = hand.add_body(name=f"{side}_finger", pos=[sign * OPEN_M, 0, 0], gravcomp=1)
        finger.add_joint(
            name=side, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[-sign, 0, 0], damping=60.0
        )
        back_m = sign * (1e-3 * thickness_mm + HOUSING_M)
        for size, pos in (
            ([HOUSING_M, 0.014, 0.023], [back_m, 0, 0]),
            ([HOUSING_M / 2, 0.012, PALM_M / 2], [back_m * 1.3, 0, PALM_M / 2]),
        ):
            finger.add_geom(
                type=GEOM.mjGEOM_BOX, size=size, pos=pos, mass=0.1, contype=0, conaffinity=0,
                rgba=HAND_RGBA,
            )  # fmt: skip
        # The sensor's x and y axes: right and down in its image. Its z axis points out of it.
        finger.add_site(name=f"{side}_pad", xyaxes=[0, sign, 0, 0, 0, -1])
        sensors.append(
            t2twin.attach(
                spec, sensor=sensor, site=f"{side}_pad", pos=(0.0, 0.0, -1e-3 * thickness_mm),
                friction=friction, geometry="visual", seed=0,
            )
        )  # fmt: skip
        force = spec.add_actuator(name=f"{side}_force", target=side)
        force.trntype = mujoco.mjtTrn.mjTRN_JOINT
    coupling = spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, name="coupling")
    coupling.name1, coupling.name2, coupling.data[:2] = "left", "right", [0.0, 1.0]
    lift = spec.add_actuator(name="height", target="lift", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    lift.set_to_position(kp=8000.0, dampratio=1.0)
    return tuple(sensors)


@dataclass(frozen=True)
class Tick:
    """One reading of both sensors. drop_m: motion of the tool down in the fingers since the lift
    began."""

    time_s: float
    phase: str
    grip_n: float
    digit: t2twin.Touch
    cyskin: t2twin.Touch
    drop_m: float


def grasp(tool: str, scene: Scene, data: mujoco.MjData, rate_hz: float) -> Iterator[Tick]:
    """Simulate one grasp and read both sensors; ends when the tool has slipped."""
    model, steps = scene.model, round(1 / (rate_hz * scene.model.opt.timestep))
    place, hand, grasped_m = data.body(tool).xpos, data.body("hand").xpos, 0.0
    mujoco.mj_forward(model, data)
    while data.time < END_S:
        for _ in range(steps):
            grip_n, height_m = commands(data.time)
            data.ctrl[:] = grip_n, grip_n, height_m
            if data.eq_active[0] and data.time > CLOSED_S:
                data.eq_active[0] = 0  # the magnet lets go
                grasped_m = place[2] - hand[2]
            mujoco.mj_step(model, data)
        drop_m = 0.0 if data.eq_active[0] else grasped_m - (place[2] - hand[2])
        touches = scene.digit.read(model, data), scene.cyskin.read(model, data)
        yield Tick(data.time, phase(data.time), grip_n, *touches, drop_m)
        if drop_m > SLIPPED_M:
            return


def phase(time_s: float) -> str:
    ends = {"close": CLOSED_S, "lift": LIFTED_S, "hold": HELD_S}
    return next((name for name, end_s in ends.items() if time_s <= end_s), "loosen")


def commands(time_s: float) -> tuple[float, float]:
    """Grip force of each finger, N, and height of the hand above its start, m, at a time."""
    grip_n = GRIP_N * min(1.0, time_s / CLOSED_S)
    if time_s > HELD_S:
        grip_n *= np.exp(-(time_s - HELD_S) / LOOSENING_S)
    share = np.clip((time_s - CLOSED_S) / (LIFTED_S - CLOSED_S), 0.0, 1.0)
    return grip_n, LIFT_M * share**2 * (3 - 2 * share)


class Predictor:
    """Predicts the counts of the CySkin in the other finger, and of one in the DIGIT's place."""

    def __init__(self, layout: t2twin.Layout, background: np.ndarray) -> None:
        self.background = background
        self.network = t2twin.load()
        self.mirrored = self.network.at_layout(-layout.x_mm, layout.y_mm, "mirrored")

    def other_finger(self, image: np.ndarray) -> Estimate:
        return self.mirrored.estimate(image, background=self.background)

    def same_finger(self, image: np.ndarray) -> Estimate:
        return self.network.estimate(image, background=self.background)


def virtual_counts(
    tool: str, scene: Scene, data: mujoco.MjData, touch: t2twin.Touch, rng: np.random.Generator
) -> np.ndarray:
    """Counts of a CySkin in the DIGIT's place that carries the DIGIT's normal force."""
    pose = scene.digit.pose(scene.model, data)
    region = Region.of(CYSKIN_COVER)
    found = body_surface(
        scene.model, data, data.body(tool).id, pose[:3, :3], pose[:3, 3], region, "visual"
    )
    assert found is not None  # the DIGIT touches the tool, and the cover is larger than its gel
    shape = replace(touch.shape, surface=found.surface)
    return scene.cyskin.device.counts(scene.cyskin.device.press(shape, touch.command), rng)


@dataclass
class Comparison:
    """Sums over readings of predicted against true counts."""

    squares: float = 0.0
    covered: int = 0
    size: int = 0

    def add(self, estimate: Estimate, counts: np.ndarray) -> None:
        low, high = estimate.interval(LEVEL)
        self.squares += float(((estimate.counts - counts) ** 2).sum())
        self.covered += int(((low <= counts) & (counts <= high)).sum())
        self.size += counts.size

    def __add__(self, other: "Comparison") -> "Comparison":
        return Comparison(
            self.squares + other.squares, self.covered + other.covered, self.size + other.size
        )

    def __str__(self) -> str:
        rmse, share = np.sqrt(self.squares / self.size), self.covered / self.size
        return f"{rmse:9,.0f} {100 * share:9.1f}"


@dataclass
class Result:
    """What became of one tool. held: whether it was in the fingers 2 s after the lift.

    slipped_n: grip force at which it slipped, N; None if it did not.
    """

    held: bool = False
    slipped_n: float | None = None
    other: Comparison = field(default_factory=Comparison)
    same: Comparison = field(default_factory=Comparison)


def run(tool: str, rate_hz: float, every: int) -> tuple[Result, list[Image.Image]]:
    """Grasp one tool; returns what became of it and the pages of the animation."""
    scene = build(tool)
    data, result, pages = mujoco.MjData(scene.model), Result(), []
    layout = t2twin.load_layout()
    predictor = Predictor(layout, t2twin.Twin().background)
    page, rng, times, forces = Page(layout.size, END_S), np.random.default_rng(0), [], []
    show = SceneRenderer(scene.model)
    set_camera(show.camera)
    for number, tick in enumerate(grasp(tool, scene, data, rate_hz)):
        estimate = predictor.other_finger(tick.digit.image)
        if tick.phase != "close" and tick.digit.contacts and tick.grip_n > LEAST_N:
            result.other.add(estimate, tick.cyskin.counts)
            truth = virtual_counts(tool, scene, data, tick.digit, rng)
            result.same.add(predictor.same_finger(tick.digit.image), truth)
        if tick.phase == "hold":
            result.held = tick.drop_m < SLIPPED_M
        if tick.drop_m > SLIPPED_M:
            result.slipped_n = tick.grip_n
        times.append(tick.time_s)
        forces.append([shear_n(tick.digit), shear_n(tick.cyskin), tick.grip_n])
        if number % every == 0:
            low, high = estimate.interval(LEVEL)
            moment = Moment(
                f"{tool}: {tick.phase}", show.render(data), tick.digit.image, tick.cyskin.counts,
                estimate.counts, low, high, times, np.transpose(forces),
            )  # fmt: skip
            pages.append(page.draw(moment))
    show.close()
    return result, pages


def view(tool: str, rate_hz: float) -> None:
    """Grasp one tool in MuJoCo's viewer until its window is closed. F4 shows the sensors' image."""
    scene = build(tool, has_image=True)
    data = mujoco.MjData(scene.model)
    with mujoco.viewer.launch_passive(
        scene.model, data, show_left_ui=False, show_right_ui=False
    ) as window:
        set_camera(window.cam)
        window.opt.sitegroup[:] = 0
        for number, tick in enumerate(grasp(tool, scene, data, rate_hz)):
            pictures = Image.fromarray(tick.digit.image), counts_picture(tick.cyskin)
            image = np.hstack([picture.resize(PANEL_PX) for picture in pictures])
            values = data.sensor("image").data
            values[:] = image[::-1].ravel()  # the viewer shows the rows from the bottom up
            values[-1] = 1 + number % 255  # and only images whose last byte is not 0
            window.sync()
            if not window.is_running():
                return


def counts_picture(touch: t2twin.Touch) -> Image.Image:
    """The counts as a tactile image in colors."""
    layout = touch.layout
    return colored_tactile_image(touch.tactile_image, layout.x_mm, layout.y_mm, MAX_COUNTS)


def shear_n(touch: t2twin.Touch) -> float:
    """Shear force on a sensor, N."""
    return sum(float(np.hypot(*contact.shear_n)) for contact in touch.contacts.values())


def set_camera(camera: mujoco.MjvCamera) -> None:
    camera.lookat[:], camera.distance, camera.azimuth, camera.elevation = CAMERA_AT_M, 0.5, 60, -10


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=RAW)
    parser.add_argument("--tools", nargs="+", choices=GRASPS, default=list(GRASPS))
    parser.add_argument("--out", type=Path, default=Path("gripper.gif"), help=".gif or .mp4")
    parser.add_argument("--rate-hz", type=float, default=25.0, help="readings per second")
    parser.add_argument("--every", type=int, default=5, help="readings per page of the animation")
    parser.add_argument("--view", action="store_true", help="open MuJoCo's viewer instead")
    options = parser.parse_args()
    if options.view:
        for tool in options.tools:
            view(tool, options.rate_hz)
        return
    results, pages = {}, []
    for tool in options.tools:
        results[tool], drawn = run(tool, options.rate_hz, options.every)
        pages += drawn
    write_animation(options.out, pages, options.rate_hz / options.every)
    print(table(results))


def table(results: dict[str, Result]) -> str:
    """RMSE in counts, and share of the counts that the intervals cover, for both comparisons."""
    lines = [f"{'':10} held slips at, N  other finger: RMSE, cover %  same finger: RMSE, cover %"]
    for tool, result in results.items():
        slips = "-" if result.slipped_n is None else f"{result.slipped_n:.2f}"
        held = "yes" if result.held else "no"
        lines.append(f"{tool:10} {held:4} {slips:>11} {result.other} {result.same}")
    other = sum((each.other for each in results.values()), Comparison())
    same = sum((each.same for each in results.values()), Comparison())
    held = sum(result.held for result in results.values())
    return "\n".join([*lines, f"{'all':10} {held}/{len(results)} {'':11} {other} {same}"])


if __name__ == "__main__":
    main()
