"""t2twin shapes, t2twin primitives, t2twin press, t2twin slide"""

import math
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from t2twin.sim.press import Press
from t2twin.sim.sensors.defaults import ROLES, SOURCE, TARGET

if TYPE_CHECKING:
    from t2twin.primitives_cad.shape import Shape
    from t2twin.sim.contact.types import Contact, PressCommand
    from t2twin.sim.sensors.files import Sensor
    from t2twin.sim.sensors.pair import SensorPair
    from t2twin.sim.touch import Touch


def shapes() -> None:
    """List the names of the shapes that can be pressed."""
    from t2twin.primitives_cad.catalogue import KEYPOINTS
    from t2twin.primitives_cad.primitive_parameters import FAMILIES

    print("primitives, versions 1 to 4 (3 is for validation):")
    for family, versions in FAMILIES.items():
        names = [f"{family}-{number + 1}" for number in range(len(versions))]
        print("  " + "".join(f"{name:18}" for name in names).rstrip())
    print("tools at their keypoints, for testing:")
    for tool, keypoints in KEYPOINTS.items():
        names = [f"{tool}/{keypoint}" for keypoint in keypoints]
        print("  " + "".join(f"{name:22}" for name in names).rstrip())
    print("also any STL, STEP, OBJ, PLY, 3MF or GLB file, pressing side up (+z; +y in GLB)")


def primitives(
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("data/primitives"),
) -> None:
    """Write the 32 primitives, the 5 tools and a plate of all primitives as STEP and STL.

    Also writes a contact sheet, an image of all shapes.

    Args:
        out: Folder to write into.
    """
    from t2twin.primitives_cad.catalogue import NAMES
    from t2twin.primitives_cad.contact_sheet import draw_sheet
    from t2twin.primitives_cad.export import export_shapes

    export_shapes(out)
    sheet = draw_sheet(out / "contact_sheet.png")
    print("shapes to press:")
    for start in range(0, len(NAMES), 4):
        print("  " + "".join(f"{name:24}" for name in NAMES[start : start + 4]).rstrip())
    print(f"wrote STEP, STL and manifest.json to {out}, and the contact sheet {sheet}")


Float = Annotated[float | None, tyro.conf.arg(metavar="FLOAT")]
Name = Annotated[str, tyro.conf.arg(metavar="NAME")]
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

LAYERS = ("gel", "cover")
"""Names of a sensor's elastomer, as an option and as a table of its file."""

DEFAULT_STEPS = 10
"""Steps of a slide unless given."""


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

    shape: tyro.conf.Positional[Annotated[str, tyro.conf.arg(metavar="SHAPE")]]
    source: Name = SOURCE
    target: Name = TARGET
    sensor: Name = BOTH
    scale: Float = None
    center: bool = False
    out: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    thickness_mm: Float = None
    young_mpa: Float = None
    poisson: Float = None
    flat: bool = False
    layout: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    optics: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    imperfections: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    markers: bool = False
    marker_pitch_mm: Float = None

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
            pair = SensorPair(*(_with_layer(each, changes) for each in (pair.source, pair.target)))
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
        from t2twin.core.errors import T2TwinError

        if self.sensor == BOTH:
            return None
        try:
            return sensors.named(self.sensor)
        except T2TwinError:
            names = ", ".join((BOTH, *ROLES, *sensors.by_name))
            raise T2TwinError(
                f"--sensor is {self.sensor!r}; expected one of {names}, or other sensors by "
                "--source and --target"
            ) from None

    def pressed(self, sensors: "SensorPair") -> "dict[str, Sensor]":
        """The sensors to press, by their names in a touch."""
        only = self.only(sensors)
        return {name: each for name, each in sensors.by_name.items() if only in (None, name)}

    def _check_effects(self, sensors: "SensorPair") -> None:
        """Raises T2TwinError for an option without effect on the sensors to press."""
        from t2twin.core.errors import T2TwinError

        plain, pressed = type(self)(self.shape), self.pressed(sensors)
        unused = [
            name
            for name, option in OF_SENSORS.items()
            if all(option not in each.OPTIONS for each in pressed.values())
        ]
        if all(each.elastomer.is_flat for each in pressed.values()):
            unused.append("flat")
        for name in unused:
            if getattr(self, name, None) != getattr(plain, name, None):
                raise T2TwinError(
                    f"--{name.replace('_', '-')} has no effect on {' and '.join(pressed)}"
                )
        if self.seed is None and self.imperfections != plain.imperfections:
            raise T2TwinError("--imperfections has no effect without --seed; give both or none")

    def command_for(self, shape: "Shape", sensors: "SensorPair") -> "PressCommand":
        """The press; a depth is that in the first pressed sensor."""
        return self.command(shape, next(iter(self.pressed(sensors).values())))

    def folder(self, command: str, shape: "Shape") -> Path:
        """The folder to write. The suffix is added where another file of a shape has this stem."""
        name, file = shape.name, Path(self.shape)
        if file.suffix:
            from t2twin.primitives_cad.mesh_files import SUFFIXES

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
        steps: Number of equal steps of the motion; default 10.
        path: Instead of start, force and motion, a CSV file with the columns x_mm, y_mm, yaw_deg
            and force_n. The first row is a press; a force of 0 lifts the shape off.
        friction: Coefficient of friction of both sensors; default: that of each one's file.
        rerun: Recording of images, counts and forces for the viewer of Rerun.
    """

    dx_mm: float = 0.0
    dy_mm: float = 0.0
    dyaw_deg: float = 0.0
    steps: Annotated[int | None, tyro.conf.arg(metavar="INT")] = None
    path: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    friction: Float = None
    rerun: Annotated[Path | None, tyro.conf.arg(metavar="FILE.rrd")] = None

    def commands(self, shape: "Shape", sensors: "SensorPair") -> "list[PressCommand]":
        """The commands of the path. Raises T2TwinError where options conflict or are invalid."""
        from t2twin.core.errors import T2TwinError
        from t2twin.sim.slide import path_commands, read_path, straight_path

        motion = self.dx_mm, self.dy_mm, self.dyaw_deg
        if self.path is None:
            if not any(motion):
                raise T2TwinError(
                    "there is no motion; give --dx-mm, --dy-mm or --dyaw-deg, or a file --path"
                )
            start = self.command_for(shape, sensors)
            steps = DEFAULT_STEPS if self.steps is None else self.steps
            rows = straight_path(start, *motion, steps, start.force_n)
            return path_commands(shape.name, rows, tilt_rad=start.tilt_rad)
        given = (self.x_mm, self.y_mm, self.yaw_deg, *motion)
        if any(given) or (self.force_n, self.depth_mm, self.steps) != (None, None, None):
            raise T2TwinError(
                "--path contains poses and forces; expected none of --x-mm, --y-mm, --yaw-deg, "
                "--force-n, --depth-mm, --dx-mm, --dy-mm, --dyaw-deg, --steps with it"
            )
        rows = read_path(self.path)
        return path_commands(shape.name, rows, str(self.path), self.tilt_rad)


def press(options: Annotated[PressOptions, tyro.conf.arg(name="")]) -> None:
    """Press one shape into one sensor or both, and write the image, counts and contacts."""
    from t2twin.compile_ahead import compile_ahead
    from t2twin.sim.touch import scene_path

    shape = options.load_shape()
    rng = options.rng
    sensors = options.sensors(options.renderer)
    if options.renderer == "pyrender":
        from t2twin.sim.optical.pyrender_renderer import FIRST_SECONDS

        takes = f"about {FIRST_SECONDS:.0f} s for the image, longer on a busy machine"
        print(f"t2twin: pyrender takes {takes}", file=sys.stderr)
    command = options.command_for(shape, sensors)
    if _have_optics(options.pressed(sensors)):
        compile_ahead()
    touch = sensors.press(shape, command, rng, only=options.only(sensors))
    folder = options.folder("press", shape)
    touch.save(folder)
    print_notes(shape)
    for name, contact in touch.contacts.items():
        print("; ".join([contact_summary(name, contact), *touch[name].notes]))
    counts = {name: getattr(each, "counts", None) for name, each in touch.readings.items()}
    of_arrays = {name: values for name, values in counts.items() if values is not None}
    for name, values in of_arrays.items():
        of_which = f"{name}: " if len(of_arrays) > 1 else ""
        print(f"{of_which}counts: {' '.join(map(str, values))}")
    print(f"written to {folder}")
    if options.view:
        show(scene_path(folder, next(iter(touch.readings))))


def slide(options: Annotated[SlideOptions, tyro.conf.arg(name="")]) -> None:
    """Press a shape and slide or turn it with friction; write images, counts and shear."""
    from t2twin.compile_ahead import compile_ahead
    from t2twin.core.progress import Progress
    from t2twin.rerun_log import RerunLog, recorded
    from t2twin.sim.contact.friction import check_friction
    from t2twin.sim.slide import touches_along
    from t2twin.slide_files import FRAME_MS, write_slide

    shape = options.load_shape()
    rng, friction = options.rng, check_friction(options.friction)
    sensors = options.sensors()
    commands = options.commands(shape, sensors)
    if _have_optics(options.pressed(sensors)):
        compile_ahead()
    only = options.only(sensors)
    touches = touches_along(sensors, shape, commands, friction, rng, only)
    folder = options.folder("slide", shape)
    log = None if options.rerun is None else RerunLog(options.rerun)
    if log is not None:
        touches = recorded(log, touches, 1e-3 * FRAME_MS)
    said: Counter[str] = Counter()
    touches = _noted(touches, said)
    rows = write_slide(
        folder, Progress(touches, total=len(commands), desc="slide", unit="step"), len(commands)
    )
    if log is not None:
        log.close()
    print_notes(shape)
    for name in sensors.by_name:
        contacts = [row for row in rows if f"{name}_shear_x_n" in row]
        if contacts:
            print(slide_summary(name, contacts))
    for note, steps in said.items():
        print(f"{note}; in {steps} of {len(commands)} touches")
    print(f"written to {folder}")


def _noted(touches: "Iterable[Touch]", said: Counter[str]) -> "Iterator[Touch]":
    """The same touches; counts their notes."""
    for touch in touches:
        said.update(touch.notes)
        yield touch


def _have_optics(sensors: "dict[str, Sensor]") -> bool:
    return any("optics" in each.OPTIONS for each in sensors.values())


def _with_layer(sensor: "Sensor", changes: dict[str, Any]) -> "Sensor":
    """A sensor whose own elastomer has other properties. Raises T2TwinError for invalid ones."""
    (layer,) = (each for each in LAYERS if each in sensor.OPTIONS)
    own = getattr(sensor.spec, layer).elastomer(sensor.name)
    return sensor.with_options({layer: replace(own, **changes)})


def print_notes(shape: "Shape") -> None:
    """Print what was repaired in a shape, stays open or may be missed."""
    for note in shape.notes:
        print(f"t2twin: {note}", file=sys.stderr)


def slide_summary(sensor: str, rows: "list[dict[str, float]]") -> str:
    """One line about the rows with contact of a slide."""
    end = rows[-1]
    # Adding 0 turns -0 into 0.
    x_n, y_n, torque_nmm = (
        round(end[f"{sensor}_{name}"], 2) + 0.0 for name in ("shear_x_n", "shear_y_n", "torque_nmm")
    )
    return (
        f"{sensor}: step {end['step']}: tangential force {x_n:.2f} N right, {y_n:.2f} N down, "
        f"torque {torque_nmm:.2f} N mm, {100 * end[f'{sensor}_slip_share']:.0f} % of the contact "
        "slips"
    )


def contact_summary(sensor: str, contact: "Contact") -> str:
    """One line about a contact."""
    from t2twin.sim.touch import contact_notes

    line = (
        f"{sensor}: {contact.force_n:.2f} N at {contact.depth_mm:.3f} mm, "
        f"{contact.contact_area_mm2:.1f} mm2 in contact, {contact.milliseconds:.0f} ms"
    )
    return "; ".join([line, *contact_notes(contact)])


def show(path: Path) -> None:
    """Open a scene in MuJoCo's viewer; without a display, print the command that does."""
    import os

    from t2twin.sim.scene import view

    if sys.platform == "linux" and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        print(f"no display here; to view the scene: python -m mujoco.viewer --mjcf={path}")
        return
    view(path)
