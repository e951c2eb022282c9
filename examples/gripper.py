"""A gripper with a DIGIT and a CySkin grasps five tools; a network predicts the CySkin's counts.

    python examples/gripper.py --out gripper.gif
    python examples/gripper.py --rerun gripper.rrd
    python examples/gripper.py --view --tools wrench

The fingers close on a tool that a magnet holds. The hand lifts and holds the tool, then the grip
loosens until the tool slips.

The pretrained network predicts from the DIGIT's image what a CySkin in its place reads. The CySkin
is in the other finger and touches the other side of the tool, which is the mirror image. The
network therefore predicts the counts at mirrored taxels, as a field run can. A second comparison
does not need the mirror: its truth is a virtual CySkin in the DIGIT's place, under the same force.
"""

# MuJoCo defines its names at import, where pyright does not find them.
# pyright: reportAttributeAccessIssue=false

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import mujoco
import mujoco.viewer
import numpy as np
from gripper_figure import MAX_COUNTS, Moment, Page, SceneRenderer, write_animation
from gripper_scene import GRASPS, PANEL_PX, Scene, build, set_camera
from PIL import Image

import t2twin
from t2twin.attachment.geometry import Region, body_surface
from t2twin.core.draw import colored_tactile_image
from t2twin.core.errors import T2TwinError
from t2twin.rerun_log import RerunLog
from t2twin.sim.taxels.taxel_array import CountsReading
from t2twin.translate.inference.estimate import Estimate

GRIP_N, LIFT_M = 8.0, 0.06
"""Force of each finger while it holds, N, and height of the lift, m."""
SLIPPED_M = 0.012
"""Motion of the tool in the fingers that counts as slipped, m."""
CLOSED_S, LIFTED_S, HELD_S, END_S = 0.8, 1.8, 3.8, 6.6
"""Ends of the phases: close, lift, hold for 2 s, loosen, s."""
LOOSENING_S = 0.7
"""Time in which the grip force falls to 1 / e while the grip loosens, s."""
RATE_HZ, EVERY = 10.0, 2
"""Readings per second, and readings per page of the animation."""
LEVEL, MIN_FORCE_N = 0.9, 0.4
"""Probability of the intervals, and least force on which the network was trained, N."""


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
        mirrored = replace(layout, name="mirrored", x_mm=-layout.x_mm)
        self.mirrored = t2twin.load(layout=mirrored)

    def other_finger(self, image: np.ndarray) -> tuple[Estimate, dict[str, Any]]:
        """Also the contact on the DIGIT in the image, if the network predicts it."""
        has_contact = self.mirrored.config.predicts_contact
        estimate = self.mirrored.estimate(image, self.background, contact=has_contact)
        return estimate, {"contact": estimate.contact.summary()} if has_contact else {}

    def same_finger(self, image: np.ndarray) -> Estimate:
        return self.network.estimate(image, background=self.background)


def virtual_counts(
    tool: str, scene: Scene, data: mujoco.MjData, touch: t2twin.Touch, rng: np.random.Generator
) -> np.ndarray:
    """Counts of a CySkin in the DIGIT's place that carries the DIGIT's normal force."""
    pose, device = scene.digit.pose(scene.model, data), scene.cyskin.device
    region = Region.of(device.elastomer)
    found = body_surface(
        scene.model, data, data.body(tool).id, pose[:3, :3], pose[:3, 3], region, "visual"
    )
    assert found is not None  # the DIGIT touches the tool, and the cover is larger than its gel
    shape = replace(touch.shape, surface=found[0])
    reading = device.read(device.press(shape, touch.command), rng)
    assert isinstance(reading, CountsReading) and reading.counts is not None
    return reading.counts


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

    @property
    def rmse_counts(self) -> float:
        return float(np.sqrt(self.squares / self.size))

    @property
    def coverage_percent(self) -> float:
        return 100 * self.covered / self.size


@dataclass
class Result:
    """What became of one tool. held: whether it was in the fingers 2 s after the lift.

    slipped_n: grip force at which it slipped, N; None if it did not.
    """

    held: bool = False
    slipped_n: float | None = None
    other: Comparison = field(default_factory=Comparison)
    same: Comparison = field(default_factory=Comparison)


def run(
    tool: str, rate_hz: float, every: int, log: RerunLog | None = None, start_s: float = 0.0
) -> tuple[Result, list[Image.Image]]:
    """Grasp one tool; returns what became of it and the pages of the animation.

    log: recording of the readings and predictions, from start_s on, s.
    """
    scene = build(tool)
    data, result, pages = mujoco.MjData(scene.model), Result(), []
    twin = t2twin.Twin()
    predictor = Predictor(twin.layout, twin.background)
    page, rng, times, forces = Page(twin.layout.size, END_S), np.random.default_rng(0), [], []
    show = SceneRenderer(scene.model)
    set_camera(show.camera)
    for number, tick in enumerate(grasp(tool, scene, data, rate_hz)):
        estimate, contact = predictor.other_finger(tick.digit.image)
        if log is not None:
            record(log, start_s + tick.time_s, tick, estimate, contact)
        if tick.phase != "close" and tick.digit.contacts and tick.grip_n > MIN_FORCE_N:
            result.other.add(estimate, tick.cyskin.counts)
            truth = virtual_counts(tool, scene, data, tick.digit, rng)
            result.same.add(predictor.same_finger(tick.digit.image), truth)
        if tick.phase == "hold":
            result.held = bool(tick.drop_m < SLIPPED_M)
        if tick.drop_m > SLIPPED_M:
            result.slipped_n = float(tick.grip_n)
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


def record(
    log: RerunLog, time_s: float, tick: Tick, estimate: Estimate, contact: dict[str, Any]
) -> None:
    """Record both readings and the predictions of the counts and the contact at a time."""
    log.touch(time_s, tick.cyskin)
    log.touch(time_s, tick.digit)
    predicted = {"counts": estimate.counts, "counts_std": estimate.counts_std}
    log.prediction(time_s, tick.digit.image, predicted | contact)


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
            image = np.hstack([np.asarray(picture.resize(PANEL_PX)) for picture in pictures])
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


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--tools", nargs="+", choices=GRASPS, default=list(GRASPS))
    parser.add_argument("--out", type=Path, default=Path("gripper.gif"), help=".gif or .mp4")
    parser.add_argument("--rate-hz", type=float, default=RATE_HZ, help="readings per second")
    parser.add_argument("--every", type=int, default=EVERY, help="readings per page of --out")
    parser.add_argument("--rerun", type=Path, metavar="FILE.rrd", help="recording for Rerun")
    parser.add_argument("--view", action="store_true", help="open MuJoCo's viewer; F4 shows images")
    options = parser.parse_args()
    if options.out.suffix not in (".gif", ".mp4"):
        parser.error(f"{options.out} has another suffix; expected .gif or .mp4")
    if options.out.suffix == ".mp4" and find_spec("imageio_ffmpeg") is None:
        parser.error("an .mp4 needs imageio-ffmpeg: pip install imageio-ffmpeg")
    if options.view:
        for tool in options.tools:
            view(tool, options.rate_hz)
        return
    try:
        log = None if options.rerun is None else RerunLog(options.rerun)
    except T2TwinError as error:
        parser.error(str(error))
    results, pages = {}, []
    for number, tool in enumerate(options.tools):
        results[tool], drawn = run(tool, options.rate_hz, options.every, log, number * END_S)
        pages += drawn
    if log is not None:
        log.close()
    write_animation(options.out, pages, options.rate_hz / options.every)
    print(table(results))


def table(results: dict[str, Result]) -> str:
    """A row for each tool, and the mean over all readings."""
    head = "held slips at, N  other finger: RMSE, cover %  same finger: RMSE, cover %"
    lines = [f"{'':10} {head}"]
    for tool, result in results.items():
        held, slips = ("yes" if result.held else "no"), result.slipped_n or np.nan
        lines.append(f"{tool:10} {held:4} {slips:11.2f} {figures(result.other, result.same)}")
    other, same = totals(results)
    held = sum(result.held for result in results.values())
    return "\n".join([*lines, f"{'all':10} {held}/{len(results)} {'':12} {figures(other, same)}"])


def totals(results: dict[str, Result]) -> tuple[Comparison, Comparison]:
    """The comparisons with the other finger and with the same finger, over all tools."""
    other = sum((each.other for each in results.values()), Comparison())
    return other, sum((each.same for each in results.values()), Comparison())


def figures(*comparisons: Comparison) -> str:
    """RMSE, counts, and share of the counts that the intervals cover, %."""
    pairs = (f"{each.rmse_counts:18,.0f} {each.coverage_percent:8.1f}" for each in comparisons)
    return " ".join(pairs)


if __name__ == "__main__":
    main()
