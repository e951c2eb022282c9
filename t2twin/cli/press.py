"""t2twin shapes, primitives, sensors, press, slide and studio"""

import gc
import math
import os
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from t2twin.core.errors import T2TwinError, how_to_install, warn
from t2twin.core.frame_order import UPRIGHT, FrameOrder
from t2twin.core.machine import cores
from t2twin.sim.press import Press

if TYPE_CHECKING:
    from t2twin.primitives_cad.shape import Shape
    from t2twin.sim.contact.types import Contact, PressCommand
    from t2twin.sim.sensors.files import Sensor
    from t2twin.sim.sensors.pair import SensorPair
    from t2twin.sim.touch import Touch

Renderer = Literal["baked", "pyrender"]

BOTH = "both"  # sensor of presses into both sensors
BALL_MM, FORCE_N = 6.0, 2.0  # of the press of `t2twin sensors check`
DEEPEST = 0.5  # its largest depth over the elastomer's thickness; it reduces the force

AHEAD = """
import gc
gc.disable()
from t2twin.sim.contact.contact_solver import compile_layout
from t2twin.sim.optical.surface import ball_surface
from t2twin.sim.sensors.pair import SensorPair
camera = SensorPair().camera
compile_layout(camera.elastomer, camera.pitch_mm)
print(flush=True)
camera.image_renderer.render(ball_surface(camera.elastomer, 0.0, 0.0, 1.0))
"""
"""A program that compiles the loops before a press's iteration, then those of images."""


def shapes() -> None:
    """List the names of the shapes that can be pressed."""
    from t2twin.primitives_cad.catalogue import OBJECTS, PRIMITIVES

    for title, names in (
        ("primitives, versions 1 to 4 (3 is for validation):", PRIMITIVES),
        ("tools at their keypoints, for testing:", OBJECTS),
    ):
        print(title)
        for start in range(0, len(names), 4):
            print("  " + "".join(f"{name:22}" for name in names[start : start + 4]).rstrip())
    print("also any STL, STEP, OBJ, PLY, 3MF or GLB file, pressing side up (+z; +y in GLB)")


def primitives(out: Path = Path("data/primitives")) -> None:
    """Write the 32 primitives, the 5 tools and a plate of all primitives as STEP and STL.

    Also writes a contact sheet, an image of all shapes.

    Args:
        out: Folder to write into.
    """
    from t2twin.primitives_cad.export import draw_sheet, export_shapes

    export_shapes(out)
    sheet = draw_sheet(out / "contact_sheet.png")
    print(f"wrote STEP, STL and manifest.json to {out}, and the contact sheet {sheet}")


def sensors(
    action: tyro.conf.Positional[Literal["list", "show", "check"]] = "list",
    sensor: tyro.conf.Positional[str | None] = None,
    out: Path | None = None,
) -> None:
    """List the bundled sensors, print the file of one to start from, or check a file of your own.

    Args:
        action: list; show SENSOR, which prints its file; or check SENSOR, which presses a ball of
            6 mm with 2 N. It presses with less where the ball would sink in by half the thickness.
        sensor: Name of a bundled sensor, or a sensor file.
        out: Picture that check writes: of a gel camera the background frame, the image and their
            difference; of a taxel array the tactile image; default runs/sensors/NAME.png.
    """
    from t2twin.core.files import result_folder
    from t2twin.sim.sensors.files import bundled_sensors, load_sensor, path_of

    if (action == "list") != (sensor is None) or (action != "check" and out is not None):
        raise T2TwinError("expected list, show SENSOR, or check SENSOR with --out or without")
    if sensor is None:
        for each in map(load_sensor, bundled_sensors()):
            print(f"{each.name:16}{each.spec.kind.replace('-', ' '):14}{each.size}")
        print("also any .toml file; t2twin sensors show NAME prints one to start from")
    elif action == "check":
        loaded = load_sensor(sensor)
        contact = _press_ball(loaded)
        path = out or Path("runs/sensors") / f"{loaded.name}.png"
        with result_folder(path.parent, path.name, [path.name]) as folder:
            reading = loaded.read(contact)
            reading.picture().save(folder / path.name, "PNG")
        print(contact_summary(loaded.name, contact, reading.notes))
        print(f"written to {path}")
    else:
        load_sensor(sensor)
        print(path_of(sensor).read_text(encoding="utf-8"), end="")


def _press_ball(sensor: "Sensor") -> "Contact":
    """The contact of the ball in the middle of a sensor."""
    from t2twin.primitives_cad.shape import ball
    from t2twin.sim.contact.contact_solver import force_at_depth
    from t2twin.sim.contact.types import PressCommand

    shape = ball(BALL_MM / 2)
    command = PressCommand(shape.name, 0.0, 0.0, 0.0, FORCE_N)
    contact = sensor.press(shape, command)
    deepest_mm = DEEPEST * sensor.elastomer.thickness_mm
    if contact.depth_mm > deepest_mm:
        force_n = force_at_depth(partial(sensor.press, shape), command, deepest_mm)
        contact = sensor.press(shape, replace(command, force_n=force_n))
    return contact


@dataclass(frozen=True)
class TouchOptions(Press):
    """Options of `t2twin press` and `t2twin slide`.

    Args:
        sensor: Sensor to press: both, source, target, or its name.
        center: Press a file's shape at the middle of its highest part instead of the middle of its
            bounding box.
        out: Folder to write; default runs/COMMAND/SHAPE.
        thickness_mm: Thickness of the elastomer, mm. With this, young_mpa or poisson the elastomer
            is linear elastic, for comparison with theory.
        young_mpa: Young's modulus of the elastomer, MPa.
        poisson: Poisson's ratio of the elastomer.
        flat: Remove the dome of the elastomer.
        marker_pitch_mm: Distance of neighboring markers, mm. Implies markers.
    """

    shape: tyro.conf.Positional[str]
    sensor: str = BOTH
    center: bool = False
    out: Path | None = None
    thickness_mm: float | None = None
    young_mpa: float | None = None
    poisson: float | None = None
    flat: bool = False
    marker_pitch_mm: float | None = None

    def load(self, renderer: Renderer = "baked") -> "tuple[Shape, SensorPair, str | None]":
        """The shape, the sensors, and the name in a touch of the one to press, None for both.

        A single sensor is both of the pair, so that other options than its own are refused.
        """
        from t2twin.primitives_cad import catalogue
        from t2twin.sim.optical.markers import Markers
        from t2twin.sim.sensors.pair import SensorPair

        shape = catalogue.load(self.shape, scale=self.scale, center=self.center)
        if self.seed is None and self.imperfections is not None:
            raise T2TwinError("--imperfections has no effect without --seed; give both or none")
        pair, only = SensorPair.of(self.source, self.target), None
        if self.sensor != BOTH:
            sensor = pair.by_name[pair.named(self.sensor)]
            pair, only = SensorPair(sensor, sensor), sensor.name
        options = self.options
        if renderer != "baked":
            options["renderer"] = renderer
        if self.marker_pitch_mm is not None:
            options |= {"markers": Markers(self.marker_pitch_mm)}
        pair = pair.with_options(**options)
        if self.flat and all(sensor.elastomer.is_flat for sensor in pair.by_name.values()):
            raise T2TwinError("--flat has no effect on sensors without a dome; leave it out")
        return shape, SensorPair(*map(self._with_elastomer, (pair.source, pair.target))), only

    def _with_elastomer(self, sensor: "Sensor") -> "Sensor":
        """The sensor with the given values of its elastomer."""
        names = ("thickness_mm", "young_mpa", "poisson")
        changes = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        changes |= {"law": "linear"} if changes else {}
        if self.flat:
            changes |= dict.fromkeys(("dome_width_radius_mm", "dome_length_radius_mm"), math.inf)
            changes["dome_flat_mm"] = 0.0
        if not changes:
            return sensor
        (layer,) = {"gel", "cover"} & {*sensor.OPTIONS}
        return sensor.with_options({layer: replace(sensor.elastomer, **changes)})

    def folder(self, command: str, shape: "Shape") -> Path:
        """The folder to write."""
        return self.out or Path("runs") / command / shape.name.replace("/", "-")


@dataclass(frozen=True)
class SlideOptions(TouchOptions):
    """Options of `t2twin slide`.

    Args:
        dx_mm: Motion of the shape to the right in the image, mm.
        dy_mm: Motion down in the image, mm.
        dyaw_deg: Rotation about the shape's middle, clockwise in the image, degrees.
        steps: Number of equal steps of the motion.
        path: Instead of start, force and motion, a CSV file with the columns x_mm, y_mm, yaw_deg
            and force_n. The first row is a press; a force of 0 lifts the shape off.
        friction: Coefficient of friction of both sensors; default: that of each one's file.
        rerun: Recording of images, counts and forces for the viewer of Rerun.
    """

    dx_mm: float = 0.0
    dy_mm: float = 0.0
    dyaw_deg: float = 0.0
    steps: int = 10
    path: Path | None = None
    friction: float | None = None
    rerun: Path | None = None

    def commands(self, shape: "Shape", sensors: "SensorPair") -> "list[PressCommand]":
        """The commands of the path. Raises T2TwinError where options conflict or are invalid."""
        from t2twin.sim.slide import path_commands, read_path, straight_path

        motion = self.dx_mm, self.dy_mm, self.dyaw_deg
        if self.path is None:
            if not any(motion):
                raise T2TwinError("there is no motion; give --dx-mm, --dy-mm, --dyaw-deg or --path")
            start = self.command(shape, sensors.source)
            rows = straight_path(start, *motion, self.steps, start.force_n)
            return path_commands(shape.name, rows, tilt_rad=start.tilt_rad)
        given = self.x_mm, self.y_mm, self.yaw_deg, *motion, self.force_n, self.depth_mm
        if any(given) or self.steps != SlideOptions.steps:
            raise T2TwinError("--path contains poses and forces; give it without other ones")
        rows = read_path(self.path)
        return path_commands(shape.name, rows, str(self.path), self.tilt_rad)


def _compile_ahead(pair: "SensorPair") -> "subprocess.Popen | None":
    """Compile loops here and in another process, if none is cached and there are two cores."""
    from t2twin.core.jit import cached_code
    from t2twin.sim.contact.contact_solver import compile_iteration
    from t2twin.sim.optical import compiled

    if cached_code(compiled.__file__) != [] or cores() < 2:
        return None
    program = [sys.executable, "-c", AHEAD]
    helper = subprocess.Popen(program, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    compile_iteration(pair.target.elastomer, pair.target.pitch_mm)
    with helper.stdout or nullcontext(iter(())) as lines:
        next(lines, None)  # printed after compile_layout
    return helper


@contextmanager
def _no_garbage_collection() -> Iterator[None]:
    """Collect no garbage, nor later what there is: compiling loops leaves much, for seconds."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


@_no_garbage_collection()
def press(
    options: Annotated[TouchOptions, tyro.conf.arg(name="")],
    renderer: Renderer = "baked",
    view: bool = False,
) -> None:
    """Press one shape into one sensor or both, and write the image, counts and contacts.

    Args:
        renderer: What renders the image of a gel camera: the baked model, in milliseconds, or
            pyrender, in seconds and without an optics file only.
        view: Open the scene in MuJoCo's viewer (the source's if both sensors are pressed).
    """
    from t2twin.sim.scene import view as open_viewer
    from t2twin.sim.touch import scene_path

    def timed(stage: str) -> AbstractContextManager[None]:
        """Wait for the loops of images before the first reading, or both would compile them."""
        if helper is not None and stage.startswith("read"):
            helper.wait()
        return nullcontext()

    rng, (shape, pair, only) = options.rng, options.load(renderer)
    if renderer == "pyrender":
        from t2twin.sim.optical.pyrender_renderer import FIRST_SECONDS

        takes = f"about {FIRST_SECONDS:.0f} s for the image, longer on a busy machine"
        print(f"t2twin: pyrender takes {takes}", file=sys.stderr)
    command = options.command(shape, pair.source)
    pressed = [sensor for name, sensor in pair.by_name.items() if only in (None, name)]
    helper = _compile_ahead(pair) if any(sensor.VALUE == "image" for sensor in pressed) else None
    touch = pair.press(shape, command, rng, timed, only)
    folder = options.folder("press", shape)
    touch.save(folder)
    _print_notes(shape)
    for name, reading in touch.readings.items():
        if reading.contact is not None:
            print(contact_summary(name, reading.contact, reading.notes))
    for name, reading in touch.readings.items():
        if (counts := getattr(reading, "counts", None)) is not None:
            print(f"{name}: counts: {' '.join(map(str, counts))}")
    print(f"written to {folder}")
    scene = scene_path(folder, next(iter(touch.readings)))
    is_headless = sys.platform == "linux" and not {"DISPLAY", "WAYLAND_DISPLAY"} & {*os.environ}
    if view and is_headless:
        print(f"no display here; to view the scene: python -m mujoco.viewer --mjcf={scene}")
    elif view:
        open_viewer(scene)


def slide(options: Annotated[SlideOptions, tyro.conf.arg(name="")]) -> None:
    """Press a shape and slide or turn it with friction; write images, counts and shear."""
    from t2twin.core.progress import Progress
    from t2twin.rerun_log import RerunLog, recorded
    from t2twin.sim.contact.elastomer import Friction
    from t2twin.sim.slide import touches_along
    from t2twin.slide_files import FRAME_MS, write_slide

    rng, (shape, pair, only) = options.rng, options.load()
    friction = None if options.friction is None else Friction(options.friction)
    commands = options.commands(shape, pair)
    touches = touches_along(pair, shape, commands, friction, rng, only)
    folder = options.folder("slide", shape)
    log = None if options.rerun is None else RerunLog(options.rerun)
    if log is not None:
        touches = recorded(log, touches, 1e-3 * FRAME_MS)
    notes: Counter[str] = Counter()

    def noted() -> "Iterator[Touch]":
        for touch in touches:
            notes.update(touch.notes)
            yield touch

    progress = Progress(noted(), total=len(commands), desc="slide", unit="step")
    rows = write_slide(folder, progress, len(commands))
    if log is not None:
        log.close()
    _print_notes(shape)
    for name in pair.by_name:
        contacts = [row for row in rows if f"{name}_shear_x_n" in row]
        if contacts:
            print(_slide_summary(name, contacts[-1]))
    for note, steps in notes.items():
        print(f"{note}; in {steps} of {len(commands)} touches")
    print(f"written to {folder}")


def _print_notes(shape: "Shape") -> None:
    """Print what was repaired in a shape, stays open or may be missed."""
    for note in shape.notes:
        print(f"t2twin: {note}", file=sys.stderr)


def _slide_summary(sensor: str, row: "dict[str, float]") -> str:
    """One line about the last row with contact of a slide."""
    end = {name.removeprefix(f"{sensor}_"): value for name, value in row.items()}
    # Adding 0 turns -0 into 0.
    return (
        f"{sensor}: step {end['step']}: tangential force {round(end['shear_x_n'], 2) + 0.0:.2f} N "
        f"right, {round(end['shear_y_n'], 2) + 0.0:.2f} N down, torque "
        f"{round(end['torque_nmm'], 2) + 0.0:.2f} N mm, {100 * end['slip_share']:.0f} % of the "
        "contact slips"
    )


def contact_summary(sensor: str, contact: "Contact", notes: Sequence[str] = ()) -> str:
    """One line about a contact, with the notes of its reading."""
    from t2twin.sim.touch import contact_notes

    line = (
        f"{sensor}: {contact.force_n:.2f} N at {contact.depth_mm:.3f} mm, "
        f"{contact.contact_area_mm2:.1f} mm2 in contact, {contact.milliseconds:.0f} ms"
    )
    return "; ".join([line, *contact_notes(contact), *notes])


def studio(
    run: tuple[Path, ...] = (),
    source: str | None = None,
    host: str = "127.0.0.1",
    port: int = 8080,
    background: Path | None = None,
    order: Annotated[FrameOrder, tyro.conf.arg(name="")] = UPRIGHT,
) -> None:
    """Press shapes and translate images in a browser, until Ctrl-C.

    Args:
        run: Folders of trained runs, or names of pretrained runs, in addition to field; runs in
            the folder runs/ unless given.
        source: Frames to translate: camera number, video file or folder.
        host: Address to listen on; reachable from this machine only unless given. 0.0.0.0 allows
            everyone who can reach this machine.
        port: Port to listen on.
        background: Background frame of the same sensor, stored as the frames, for field runs; the
            mean background frame of their training unless given.
    """
    if find_spec("viser") is None:
        raise T2TwinError(f"the studio needs viser; {how_to_install('studio')}")
    from t2twin.studio.server import studio as serve

    try:
        with serve(run, host, port, source, background, order) as served:
            if host not in ("localhost", "127.0.0.1", "::1"):
                warn(
                    "everyone who can reach this machine can open the page and use its processors; "
                    "--host 127.0.0.1 restricts it to this machine"
                )
            print(f"open {served.address} (Ctrl-C ends it)", flush=True)
            while True:
                time.sleep(3600)
    except SystemExit as stop:  # a signal; an exit of Python would abort threads that compute
        os._exit(stop.code if isinstance(stop.code, int) else 1)
