"""t2twin press"""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

if TYPE_CHECKING:
    from t2twin.sim.contact.types import Contact

Float = Annotated[float | None, tyro.conf.arg(metavar="FLOAT")]


@dataclass(frozen=True)
class PressOptions:
    """Options of `t2twin press`.

    Args:
        shape: A catalogue name (square-2, pliers/jaw-tip; t2twin shapes lists all), a random shape
            (random-0, random-1 and so on), or an STL, STEP, OBJ, PLY, 3MF or GLB file. The
            pressing side of a file's shape is up (+z; +y in GLB).
        sensor: Sensor to press.
        x_mm: Position of the shape's middle, to the right in the image, mm.
        y_mm: The same, down in the image, mm.
        yaw_deg: Rotation about the press axis, clockwise in the image, degrees.
        force_n: Commanded force, N; default 8.
        depth_mm: Instead of a force, the depth from first contact, mm, in the DIGIT's gel, or in
            the CySkin's cover if only the CySkin is pressed.
        scale: mm per unit of the file: 1000 for meters, 25.4 for inches. Default: the file's unit
            (3MF, GLB, STEP), else 1.
        out: Folder to write; default runs/press/SHAPE.
        thickness_mm: Thickness of the elastomer, mm. With this, young_mpa or poisson the elastomer
            is linear elastic, for comparison with theory.
        young_mpa: Young's modulus of the elastomer, MPa.
        poisson: Poisson's ratio of the elastomer.
        flat: Remove the dome of the gel.
        layout: Taxel layout: a name, or a JSON or CSV file with x_mm and y_mm.
        calibration: The DIGIT's light and, if it was fitted, its gel's modulus, as written by
            t2twin calibrate; default: the default calibration.
        optics: What renders the DIGIT's image: the baked model, in milliseconds, or pyrender, in
            seconds and for the default calibration only.
        seed: Seed of the camera noise and of the CySkin's imperfections; none without a seed.
        imperfections: The CySkin's errors if there is a seed: none, white, baseline or all.
        view: Open the scene in MuJoCo's viewer (the DIGIT's if both sensors are pressed).
    """

    shape: tyro.conf.Positional[Annotated[str, tyro.conf.arg(metavar="SHAPE")]]
    sensor: Literal["digit", "cyskin", "both"] = "both"
    x_mm: float = 0.0
    y_mm: float = 0.0
    yaw_deg: float = 0.0
    force_n: Float = None
    depth_mm: Float = None
    scale: Float = None
    out: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    thickness_mm: Float = None
    young_mpa: Float = None
    poisson: Float = None
    flat: bool = False
    layout: str = "cyskin-20"
    calibration: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    optics: Literal["baked", "pyrender"] = "baked"
    seed: Annotated[int | None, tyro.conf.arg(metavar="INT")] = None
    imperfections: Annotated[str, tyro.conf.arg(metavar="NAME")] = "white"
    view: bool = False


def press(options: Annotated[PressOptions, tyro.conf.arg(name="")]) -> None:
    """Press one shape into one sensor or both, and write the image, counts and contacts."""
    import numpy as np

    import t2twin
    from t2twin.core.arguments import check_seed
    from t2twin.core.compile_ahead import compile_optics_ahead
    from t2twin.sim.contact.elastomer import CYSKIN_COVER, DIGIT_GEL
    from t2twin.sim.touch import scene_path
    from t2twin.twin import other_elastomer, press_command

    sensor, optics = options.sensor, options.optics
    shape = t2twin.load_shape(options.shape, options.scale)
    for note in shape.notes:
        print(f"t2twin: {note}", file=sys.stderr)
    changes = (options.thickness_mm, options.young_mpa, options.poisson, options.flat)
    gel, cover = (other_elastomer(own, *changes) for own in (DIGIT_GEL, CYSKIN_COVER))
    if options.seed is not None:
        check_seed(options.seed)
    rng = None if options.seed is None else np.random.default_rng(options.seed)
    sensors = t2twin.Twin(
        options.calibration, options.layout, options.imperfections, gel, cover, optics
    ).sensors
    if optics == "pyrender" and sensor != "cyskin":
        print(f"t2twin: {pyrender_duration()}", file=sys.stderr)
    command = press_command(
        shape,
        options.force_n,
        options.x_mm,
        options.y_mm,
        options.yaw_deg,
        options.depth_mm,
        sensors.cyskin if sensor == "cyskin" else sensors.digit,
    )
    if sensor != "cyskin":
        compile_optics_ahead()
    touch = sensors.press(shape, command, rng, sensor=sensor)
    folder = options.out or Path("runs/press") / shape.name.replace("/", "-")
    touch.save(folder)
    for name, contact in touch.contacts.items():
        print(contact_summary(name, contact))
    if touch.counts is not None:
        print("counts: " + " ".join(str(count) for count in touch.counts))
    print(f"written to {folder}")
    if options.view:
        show(scene_path(folder, "cyskin" if sensor == "cyskin" else "digit"))


def pyrender_duration() -> str:
    """The time that pyrender takes, as a message."""
    from t2twin.sim.digit.rendered import FIRST_SECONDS

    return f"pyrender takes about {FIRST_SECONDS:.0f} s for the image, longer on a busy machine"


def contact_summary(sensor: str, contact: "Contact") -> str:
    """One line about a contact."""
    line = (
        f"{sensor}: {contact.force_n:.2f} N at {contact.depth_mm:.3f} mm, "
        f"{contact.contact_area_mm2:.1f} mm2 in contact, {contact.milliseconds:.0f} ms"
    )
    if not contact.settled:
        line += "; it did not settle"
    if contact.bottomed:
        line += "; it bottomed out: the base plate (the lowest flat face) touched"
    return line + _off_sensor(contact)


def _off_sensor(contact: "Contact") -> str:
    """A note that the shape's middle lies off the sensor; empty where it does not."""
    places = (contact.command.x_mm, contact.x_mm), (contact.command.y_mm, contact.y_mm)
    if all(abs(at) <= abs(axis).max() for at, axis in places):
        return ""
    half_x, half_y = (abs(axis).max() for _, axis in places)
    return (
        "; its middle lies off the sensor, whose soft layer reaches "
        f"{half_x:.1f} mm to each side and {half_y:.1f} mm up and down"
    )


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
