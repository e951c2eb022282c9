"""t2twin press"""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

if TYPE_CHECKING:
    from t2twin.sim.contact.types import Contact


def press(
    shape: tyro.conf.Positional[Annotated[str, tyro.conf.arg(metavar="SHAPE")]],
    sensor: Literal["digit", "cyskin", "both"] = "both",
    x_mm: float = 0.0,
    y_mm: float = 0.0,
    yaw_deg: float = 0.0,
    force_n: Annotated[float | None, tyro.conf.arg(metavar="FLOAT")] = None,
    depth_mm: Annotated[float | None, tyro.conf.arg(metavar="FLOAT")] = None,
    scale: Annotated[float | None, tyro.conf.arg(metavar="FLOAT")] = None,
    out: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None,
    thickness_mm: Annotated[float | None, tyro.conf.arg(metavar="FLOAT")] = None,
    young_mpa: Annotated[float | None, tyro.conf.arg(metavar="FLOAT")] = None,
    poisson: Annotated[float | None, tyro.conf.arg(metavar="FLOAT")] = None,
    flat: bool = False,
    layout: str = "cyskin-20",
    calibration: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    optics: Literal["baked", "pyrender"] = "baked",
    seed: Annotated[int | None, tyro.conf.arg(metavar="INT")] = None,
    imperfections: Annotated[str, tyro.conf.arg(metavar="NAME")] = "white",
    view: bool = False,
) -> None:
    """Press one shape into one sensor or both, and write what they see and feel.

    Args:
        shape: A catalogue name (square-2, pliers/jaw-tip; t2twin shapes lists all), a random shape
            (random-0, random-1 and so on), or an STL, STEP, OBJ, PLY, 3MF or GLB file, its
            pressing side up (+z; +y in GLB).
        sensor: Which sensor is touched.
        x_mm: Where the shape's middle stands, to the right in the picture, mm.
        y_mm: The same, down the picture, mm.
        yaw_deg: Turn about the press axis, clockwise in the picture, degrees.
        force_n: Commanded force, N; 8 unless given.
        depth_mm: Instead of a force: how far the shape travels from its first touch, mm, into the
            DIGIT's gel, or into the CySkin's cover where that alone is touched.
        scale: mm in one of the file's units: 1000 for meters, 25.4 for inches. Unless given, what
            the file says (3MF, GLB, STEP), else 1.
        out: Folder to write into; runs/press/SHAPE unless given.
        thickness_mm: Another elastomer's thickness, mm. With any of these three the elastomer is
            linear elastic, so that it can be compared with theory.
        young_mpa: Another elastomer's Young's modulus, MPa.
        poisson: Another elastomer's Poisson's ratio.
        flat: Take the dome off the gel.
        layout: Taxel layout: a name, or a JSON or CSV file with x_mm and y_mm.
        calibration: The DIGIT's light, and its gel's modulus where that was fitted, as t2twin
            calibrate writes them; the light that ships unless given.
        optics: What makes the DIGIT's picture: the baked model, in milliseconds, or pyrender
            itself, in seconds, which knows the light that ships only.
        seed: Of noise: the camera's, and what the CySkin adds. Without a seed there is none.
        imperfections: What the CySkin adds where there is a seed: none, white, baseline or all.
        view: Then open the scene in MuJoCo's viewer (the DIGIT's, where both are touched).
    """
    import numpy as np

    import t2twin
    from t2twin.core.arguments import check_seed
    from t2twin.core.compile_ahead import compile_optics_ahead
    from t2twin.press_folder import scene_path, write_press
    from t2twin.sim.contact.elastomer import CYSKIN_COVER, DIGIT_GEL
    from t2twin.twin import other_elastomer, press_command

    solid = t2twin.load_shape(shape, scale)
    for note in solid.notes:
        print(f"t2twin: {note}", file=sys.stderr)
    other = (thickness_mm, young_mpa, poisson, flat)
    gel, cover = (other_elastomer(own, *other) for own in (DIGIT_GEL, CYSKIN_COVER))
    if seed is not None:
        check_seed(seed)
    rng = None if seed is None else np.random.default_rng(seed)
    sensors = t2twin.Twin(calibration, layout, imperfections, gel, cover, optics).sensors
    if optics == "pyrender" and sensor != "cyskin":
        print(f"t2twin: {slow_picture()}", file=sys.stderr)
    deep = sensors.cyskin if sensor == "cyskin" else sensors.digit
    command = press_command(solid, force_n, x_mm, y_mm, yaw_deg, depth_mm, deep)
    if sensor != "cyskin":
        compile_optics_ahead()
    digit = sensors.digit.touch(solid, command, rng) if sensor != "cyskin" else None
    cyskin = sensors.cyskin.touch(solid, command, rng) if sensor != "digit" else None
    folder = out or Path("runs/press") / solid.name.replace("/", "-")
    write_press(folder, digit, cyskin)
    if digit is not None:
        print(summary("digit", digit.contact))
    if cyskin is not None:
        print(summary("cyskin", cyskin.contact))
        print("counts: " + " ".join(str(count) for count in cyskin.counts))
    print(f"written to {folder}")
    if view:
        show(scene_path(folder, "cyskin" if sensor == "cyskin" else "digit"))


def slow_picture() -> str:
    """What pyrender's picture costs, in words."""
    from t2twin.sim.digit.rendered import FIRST_SECONDS

    return f"pyrender takes about {FIRST_SECONDS:.0f} s for the picture, longer on a busy machine"


def summary(sensor: str, contact: "Contact") -> str:
    """A contact in one line."""
    words = (
        f"{sensor}: {contact.force_n:.2f} N at {contact.depth_mm:.3f} mm, "
        f"{contact.contact_area_mm2:.1f} mm2 in contact, {contact.milliseconds:.0f} ms"
    )
    if not contact.settled:
        words += "; it did not settle"
    if contact.bottomed:
        words += "; it bottomed out: the base plate (the lowest flat face) touched"
    return words + _off_sensor(contact)


def _off_sensor(contact: "Contact") -> str:
    """In words, that a shape's middle lies beside the sensor; nothing where it lies on it."""
    places = (contact.command.x_mm, contact.x_mm), (contact.command.y_mm, contact.y_mm)
    if all(abs(at) <= abs(axis).max() for at, axis in places):
        return ""
    half_x, half_y = (abs(axis).max() for _, axis in places)
    return (
        "; its middle lies off the sensor, whose soft layer reaches "
        f"{half_x:.1f} mm to each side and {half_y:.1f} mm up and down"
    )


def show(path: Path) -> None:
    """Open a scene where there is a display, else say where it lies."""
    import os

    from t2twin.sim.scene import view

    if sys.platform == "linux" and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        print(
            f"no display here to view on; open it elsewhere: python -m mujoco.viewer --mjcf={path}"
        )
        return
    view(path)
