"""t2twin shapes, t2twin primitives, t2twin press, t2twin slide"""

import math
import os
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from t2twin.sim.press import Press
from t2twin.sim.sensors.defaults import SOURCE, TARGET

if TYPE_CHECKING:
    from t2twin.primitives_cad.shape import Shape
    from t2twin.sim.contact.types import Contact, PressCommand
    from t2twin.sim.sensors.files import Sensor
    from t2twin.sim.sensors.pair import SensorPair
    from t2twin.sim.touch import Touch


Renderer = Literal["baked", "pyrender"]

BOTH = "both"
"""Sensor of presses into both sensors."""

OF_SENSORS = {
    "layout": "layout",
    "optics": "optics",
    "imperfections": "imperfections",
    "markers": "markers",
    "marker_pitch_mm": "markers",
    "renderer": "renderer",
}
"""Options that some sensors have, and their names in a sensor's OPTIONS."""


def shapes() -> None:
    """List the names of the shapes that can be pressed."""
    from t2twin.primitives_cad.catalogue import OBJECTS
    from t2twin.primitives_cad.primitive_parameters import PRIMITIVES

    print("primitives, versions 1 to 4 (3 is for validation):")
    _print_columns(PRIMITIVES)
    print("tools at their keypoints, for testing:")
    _print_columns(OBJECTS)
    print("also any STL, STEP, OBJ, PLY, 3MF or GLB file, pressing side up (+z; +y in GLB)")


def _print_columns(names: Sequence[str]) -> None:
    for start in range(0, len(names), 4):
        print("  " + "".join(f"{name:22}" for name in names[start : start + 4]).rstrip())


def primitives(out: Path = Path("data/primitives")) -> None:
    """Write the 32 primitives, the 5 tools and a plate of all primitives as STEP and STL.

    Also writes a contact sheet, an image of all shapes.

    Args:
        out: Folder to write into.
    """
    from t2twin.primitives_cad.contact_sheet import draw_sheet
    from t2twin.primitives_cad.export import export_shapes

    export_shapes(out)
    sheet = draw_sheet(out / "contact_sheet.png")
    print(f"wrote STEP, STL and manifest.json to {out}, and the contact sheet {sheet}")


@dataclass(frozen=True)
class TouchOptions(Press):
    """Options of `t2twin press` and `t2twin slide`.

    Args:
        source: The first sensor: a bundled one (t2twin sensors lists them) or a sensor file.
        target: The second sensor.
        sensor: Sensor to press: both, source, target, or its name.
        scale: mm per unit of the file: 1000 for meters, 25.4 for inches. Default: the file's unit
            (3MF, GLB, STEP), else 1.
        center: Press a file's shape at the middle of its highest part instead of the middle of its
            bounding box.
        out: Folder to write; default runs/COMMAND/SHAPE.
        thickness_mm: Thickness of the elastomer, mm. With this, young_mpa or poisson the elastomer
            is linear elastic, for comparison with theory.
        young_mpa: Young's modulus of the elastomer, MPa.
        poisson: Poisson's ratio of the elastomer.
        flat: Remove the dome of the elastomer.
        layout: Taxel layout of a taxel array: a name, or a JSON or CSV file with x_mm and y_mm.
        optics: A gel camera's light and, if it was fitted, its gel's modulus, as written by
            t2twin calibrate; default: those of the sensor's file.
        imperfections: An array's errors if there is a seed: none, or a name in the sensor's file;
            default white.
        markers: Print the markers of the sensor's file on the gel of a gel camera.
        marker_pitch_mm: Distance of neighboring markers, mm. Implies markers.
    """

    shape: tyro.conf.Positional[str]
    source: str = SOURCE
    target: str = TARGET
    sensor: str = BOTH
    scale: float | None = None
    center: bool = False
    out: Path | None = None
    thickness_mm: float | None = None
    young_mpa: float | None = None
    poisson: float | None = None
    flat: bool = False
    layout: str | None = None
    optics: Path | None = None
    imperfections: str | None = None
    markers: bool = False
    marker_pitch_mm: float | None = None

    def load_shape(self) -> "Shape":
        from t2twin.primitives_cad import catalogue

        return catalogue.load(self.shape, scale=self.scale, center=self.center)

    def sensors(self, renderer: Renderer = "baked") -> "SensorPair":
        """The sensors. renderer: what renders the image of a gel camera."""
        from t2twin.sim.optical.markers import Markers
        from t2twin.sim.sensors.pair import SensorPair

        pair = SensorPair.of(self.source, self.target)
        self._check_effects(pair)
        names = ("thickness_mm", "young_mpa", "poisson")
        changes = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        if changes:
            changes["law"] = "linear"
        if self.flat:
            changes |= {"dome_width_radius_mm": math.inf, "dome_length_radius_mm": math.inf}
        if changes:
            changed = []
            for each in (pair.source, pair.target):
                (layer,) = {"gel", "cover"} & {*each.OPTIONS}
                elastomer = getattr(each.spec, layer).elastomer(each.name)
                changed.append(each.with_options({layer: replace(elastomer, **changes)}))
            pair = SensorPair(*changed)
        pitch = self.marker_pitch_mm
        return pair.with_options(
            optics=self.optics,
            layout=self.layout,
            imperfections=self.imperfections,
            renderer=None if renderer == "baked" else renderer,
            markers=(self.markers or None) if pitch is None else Markers(pitch),
        )

    def only(self, sensors: "SensorPair") -> str | None:
        """The name in a touch of the sensor to press, None for both."""
        return None if self.sensor == BOTH else sensors.named(self.sensor)

    def pressed(self, sensors: "SensorPair") -> "dict[str, Sensor]":
        """The sensors to press, by their names in a touch."""
        only = self.only(sensors)
        return {name: each for name, each in sensors.by_name.items() if only in (None, name)}

    def _check_effects(self, sensors: "SensorPair") -> None:
        """Raises T2TwinError for an option without effect on the sensors to press."""
        from t2twin.core.errors import T2TwinError

        pressed = self.pressed(sensors)
        given = [
            name for name in OF_SENSORS if getattr(self, name, None) not in (None, False, "baked")
        ]
        unused = [
            name
            for name in given
            if all(OF_SENSORS[name] not in each.OPTIONS for each in pressed.values())
        ]
        if self.flat and all(each.elastomer.is_flat for each in pressed.values()):
            unused.append("flat")
        if unused:
            name = unused[0].replace("_", "-")
            raise T2TwinError(f"--{name} has no effect on {' and '.join(pressed)}")
        if self.seed is None and self.imperfections is not None:
            raise T2TwinError("--imperfections has no effect without --seed; give both or none")

    def command_for(self, shape: "Shape", sensors: "SensorPair") -> "PressCommand":
        """The press; a depth is that in the first pressed sensor."""
        return self.command(shape, next(iter(self.pressed(sensors).values())))

    def compile_ahead(self, sensors: "SensorPair") -> None:
        """Compile loops of the optics, if there are any, in a second process."""
        from t2twin.compile_ahead import compile_ahead

        if any("optics" in each.OPTIONS for each in self.pressed(sensors).values()):
            compile_ahead()

    def folder(self, command: str, shape: "Shape") -> Path:
        """The folder to write. The suffix is added where another file of a shape has this stem."""
        name, file = shape.name, Path(self.shape)
        if file.suffix:
            from t2twin.primitives_cad.shape import SUFFIXES

            solids = [each for each in file.parent.glob("*") if each.suffix.lower() in SUFFIXES]
            if file in solids and [each.stem for each in solids].count(file.stem) > 1:
                name += file.suffix.replace(".", "-")
        return self.out or Path("runs") / command / name.replace("/", "-")


@dataclass(frozen=True)
class PressOptions(TouchOptions):
    """Options of `t2twin press`.

    Args:
        renderer: What renders the image of a gel camera: the baked model, in milliseconds, or
            pyrender, in seconds and without an optics file only.
        view: Open the scene in MuJoCo's viewer (the source's if both sensors are pressed).
    """

    renderer: Renderer = "baked"
    view: bool = False


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
        from t2twin.core.errors import T2TwinError
        from t2twin.sim.slide import path_commands, read_path, straight_path

        motion = self.dx_mm, self.dy_mm, self.dyaw_deg
        if self.path is None:
            if not any(motion):
                raise T2TwinError("there is no motion; give --dx-mm, --dy-mm, --dyaw-deg or --path")
            start = self.command_for(shape, sensors)
            rows = straight_path(start, *motion, self.steps, start.force_n)
            return path_commands(shape.name, rows, tilt_rad=start.tilt_rad)
        given = self.x_mm, self.y_mm, self.yaw_deg, *motion, self.force_n, self.depth_mm
        if any(given) or self.steps != SlideOptions.steps:
            raise T2TwinError("--path contains poses and forces; give it without other ones")
        rows = read_path(self.path)
        return path_commands(shape.name, rows, str(self.path), self.tilt_rad)


def press(options: Annotated[PressOptions, tyro.conf.arg(name="")]) -> None:
    """Press one shape into one sensor or both, and write the image, counts and contacts."""
    from t2twin.sim.scene import view
    from t2twin.sim.touch import scene_path

    shape, rng = options.load_shape(), options.rng
    sensors = options.sensors(options.renderer)
    if options.renderer == "pyrender":
        from t2twin.sim.optical.pyrender_renderer import FIRST_SECONDS

        takes = f"about {FIRST_SECONDS:.0f} s for the image, longer on a busy machine"
        print(f"t2twin: pyrender takes {takes}", file=sys.stderr)
    command = options.command_for(shape, sensors)
    options.compile_ahead(sensors)
    touch = sensors.press(shape, command, rng, only=options.only(sensors))
    folder = options.folder("press", shape)
    touch.save(folder)
    print_notes(shape)
    for name, reading in touch.readings.items():
        if reading.contact is not None:
            print("; ".join([contact_summary(name, reading.contact), *reading.notes]))
    for name, reading in touch.readings.items():
        if (counts := getattr(reading, "counts", None)) is not None:
            print(f"{name}: counts: {' '.join(map(str, counts))}")
    print(f"written to {folder}")
    scene = scene_path(folder, next(iter(touch.readings)))
    is_headless = sys.platform == "linux" and not {"DISPLAY", "WAYLAND_DISPLAY"} & {*os.environ}
    if options.view and is_headless:
        print(f"no display here; to view the scene: python -m mujoco.viewer --mjcf={scene}")
    elif options.view:
        view(scene)


def slide(options: Annotated[SlideOptions, tyro.conf.arg(name="")]) -> None:
    """Press a shape and slide or turn it with friction; write images, counts and shear."""
    from t2twin.core.progress import Progress
    from t2twin.rerun_log import RerunLog, recorded
    from t2twin.sim.contact.friction import check_friction
    from t2twin.sim.slide import touches_along
    from t2twin.slide_files import FRAME_MS, write_slide

    shape, rng = options.load_shape(), options.rng
    friction, sensors = check_friction(options.friction), options.sensors()
    commands = options.commands(shape, sensors)
    options.compile_ahead(sensors)
    only = options.only(sensors)
    touches = touches_along(sensors, shape, commands, friction, rng, only)
    folder = options.folder("slide", shape)
    log = None if options.rerun is None else RerunLog(options.rerun)
    if log is not None:
        touches = recorded(log, touches, 1e-3 * FRAME_MS)
    notes: Counter[str] = Counter()
    touches = Progress(_noted(touches, notes), total=len(commands), desc="slide", unit="step")
    rows = write_slide(folder, touches, len(commands))
    if log is not None:
        log.close()
    print_notes(shape)
    for name in sensors.by_name:
        contacts = [row for row in rows if f"{name}_shear_x_n" in row]
        if contacts:
            print(slide_summary(name, contacts))
    for note, steps in notes.items():
        print(f"{note}; in {steps} of {len(commands)} touches")
    print(f"written to {folder}")


def _noted(touches: "Iterable[Touch]", notes: Counter[str]) -> "Iterator[Touch]":
    """The same touches; counts their notes."""
    for touch in touches:
        notes.update(touch.notes)
        yield touch


def print_notes(shape: "Shape") -> None:
    """Print what was repaired in a shape, stays open or may be missed."""
    for note in shape.notes:
        print(f"t2twin: {note}", file=sys.stderr)


def slide_summary(sensor: str, rows: "list[dict[str, float]]") -> str:
    """One line about the rows with contact of a slide."""
    end = {name.removeprefix(f"{sensor}_"): value for name, value in rows[-1].items()}
    # Adding 0 turns -0 into 0.
    return (
        f"{sensor}: step {end['step']}: tangential force {round(end['shear_x_n'], 2) + 0.0:.2f} N "
        f"right, {round(end['shear_y_n'], 2) + 0.0:.2f} N down, torque "
        f"{round(end['torque_nmm'], 2) + 0.0:.2f} N mm, {100 * end['slip_share']:.0f} % of the "
        "contact slips"
    )


def contact_summary(sensor: str, contact: "Contact") -> str:
    """One line about a contact."""
    from t2twin.sim.touch import contact_notes

    line = (
        f"{sensor}: {contact.force_n:.2f} N at {contact.depth_mm:.3f} mm, "
        f"{contact.contact_area_mm2:.1f} mm2 in contact, {contact.milliseconds:.0f} ms"
    )
    return "; ".join([line, *contact_notes(contact)])
