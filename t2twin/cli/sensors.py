"""t2twin sensors: the bundled sensors, their files, and a first press of a sensor file."""

import json
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from t2twin.core.errors import T2TwinError

if TYPE_CHECKING:
    from t2twin.sim.contact.types import Contact
    from t2twin.sim.sensors.files import Sensor

BALL_MM, FORCE_N = 6.0, 2.0
"""Diameter of the ball that `check` presses, mm, and its force, N."""

DEEPEST = 0.5
"""Largest depth of that press, as a share of the elastomer's thickness; it reduces the force."""


def sensors(
    action: Annotated[
        Literal["list", "show", "check"], tyro.conf.Positional, tyro.conf.arg(metavar="ACTION")
    ] = "list",
    sensor: Annotated[str | None, tyro.conf.Positional, tyro.conf.arg(metavar="SENSOR")] = None,
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
) -> None:
    """List the bundled sensors, print the file of one to start from, or check a file of your own.

    Args:
        action: list; show SENSOR, which prints its file; or check SENSOR, which presses a ball of
            6 mm with 2 N. It presses with less where the ball would sink in by half the thickness.
        sensor: Name of a bundled sensor, or a sensor file.
        out: Picture that check writes: of a gel camera the background frame, the image and their
            difference; of a taxel array the tactile image; default runs/sensors/NAME.png.
    """
    from t2twin.sim.sensors.files import bundled_sensors, load_sensor

    if action == "list" and sensor is not None:
        raise T2TwinError(f"list takes no sensor; expected show {sensor} or check {sensor}")
    if action != "check" and out is not None:
        raise T2TwinError(f"--out has no effect with {action}; only check writes a picture")
    if action == "list":
        for name in bundled_sensors():
            print(_line(load_sensor(name)))
        print("also any .toml file; t2twin sensors show NAME prints one to start from")
    elif sensor is None:
        raise T2TwinError(f"SENSOR is missing; expected t2twin sensors {action} SENSOR")
    elif action == "show":
        print(_file(sensor), end="")
    else:
        _check(load_sensor(sensor), out)


def _line(sensor: "Sensor") -> str:
    """Name, kind, and size of the images or number of taxels."""
    return f"{sensor.name:16}{sensor.spec.kind.replace('-', ' '):14}{sensor.size}"


def _file(source: str) -> str:
    """The file of a sensor; an optics file beside it is named with its folder."""
    from t2twin.sim.sensors.files import load_sensor, path_of

    path = path_of(source)
    optics = getattr(load_sensor(source), "optics_path", None)
    text = path.read_text(encoding="utf-8")
    if optics is None:
        return text
    return text.replace(json.dumps(optics.name), json.dumps(str(optics.absolute())), 1)


def _check(sensor: "Sensor", out: Path | None) -> None:
    """Press a ball and write the picture."""
    from t2twin.cli.press import contact_summary
    from t2twin.core.files import atomic_write

    contact = _pressed(sensor)
    picture = sensor.read(contact).picture()
    path = out or Path("runs/sensors") / f"{sensor.name}.png"
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(path) as temporary:
        picture.save(temporary, "PNG")
    print(f"{contact_summary(sensor.name, contact)}; wrote {path}")


def _pressed(sensor: "Sensor") -> "Contact":
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
