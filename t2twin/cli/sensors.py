"""t2twin sensors: the bundled sensors, their files, and a first press of a sensor file."""

import json
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

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
    from t2twin.sim.sensors.files import bundled_sensors, load_sensor, path_of

    if (action == "list") != (sensor is None) or (action != "check" and out is not None):
        raise T2TwinError("expected list, show SENSOR, or check SENSOR with --out or without")
    if sensor is None:
        for each in map(load_sensor, bundled_sensors()):
            print(f"{each.name:16}{each.spec.kind.replace('-', ' '):14}{each.size}")
        print("also any .toml file; t2twin sensors show NAME prints one to start from")
    elif action == "check":
        _check(load_sensor(sensor), out)
    else:
        text = path_of(sensor).read_text(encoding="utf-8")
        optics = getattr(load_sensor(sensor), "optics_path", None)
        if optics is not None:  # beside the file, and named with its folder
            text = text.replace(json.dumps(optics.name), json.dumps(str(optics.absolute())), 1)
        print(text, end="")


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
