"""The folder that `t2twin press` writes: pictures, counts, contact fields, scenes, press.json."""

import json
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from t2twin.core.files import locked, move_into, temporary_folder
from t2twin.primitives_cad.mesh_io.stl import binary_stl
from t2twin.sim import scene
from t2twin.sim.contact.elastomer import elastomer_json
from t2twin.sim.contact.types import Contact
from t2twin.sim.cyskin.phi import Phi
from t2twin.sim.cyskin.tactile_image import colored_tactile_image
from t2twin.sim.cyskin.taxels import FULL_SCALE_COUNTS
from t2twin.sim.sensors import CySkinTouch, DigitTouch

VERSIONS = ("t2twin", "mujoco", "numpy")
"""Packages whose versions press.json names."""


def write_press(folder: Path, digit: DigitTouch | None, cyskin: CySkinTouch | None) -> None:
    """Write all files of a press, or none; at least one of the sensors was touched.

    Raises T2TwinError where the folder cannot be written.
    """
    touches = {"digit": digit, "cyskin": cyskin}
    contacts = {name: touch.contact for name, touch in touches.items() if touch is not None}
    shape = next(iter(contacts.values())).shape
    with locked(folder), temporary_folder(folder, "press") as temporary:
        (temporary / "press.json").write_text(json.dumps(_summary(digit, cyskin), indent=1) + "\n")
        mesh_file = scene.mesh_name(shape)
        if mesh_file is not None:
            (temporary / mesh_file).write_bytes(binary_stl(*shape.triangles))
        for sensor, contact in contacts.items():
            _write_contact(temporary, sensor, contact, mesh_file)
        if digit is not None:
            Image.fromarray(digit.image).save(temporary / "digit.png")
        if cyskin is not None:
            _write_cyskin(temporary, cyskin)
        move_into(folder, sorted(temporary.iterdir()))


def scene_path(folder: Path, sensor: str) -> Path:
    """Where `write_press` puts the scene of a sensor, "digit" or "cyskin"."""
    return folder / f"scene_{sensor}.xml"


def _write_contact(folder: Path, sensor: str, contact: Contact, mesh_file: str | None) -> None:
    np.savez_compressed(
        folder / f"contact_{sensor}.npz",
        surface_mm=contact.surface_mm,
        pressure_kpa=contact.pressure_kpa,
        x_mm=contact.x_mm,
        y_mm=contact.y_mm,
    )
    scene_path(folder, sensor).write_text(scene.scene(contact, mesh_file))


def _write_cyskin(folder: Path, touch: CySkinTouch) -> None:
    layout = touch.layout
    content = {
        "layout": layout.name,
        "counts": touch.counts.tolist(),
        "x_mm": layout.x_mm.tolist(),
        "y_mm": layout.y_mm.tolist(),
        "full_scale_counts": FULL_SCALE_COUNTS,
    }
    (folder / "cyskin.json").write_text(json.dumps(content, indent=1) + "\n")
    image = Phi(layout.x_mm, layout.y_mm)(touch.counts.astype(np.float32))
    # Counts as they are, 16 bits a pixel: the picture is data too.
    Image.fromarray(np.rint(image).astype(np.uint16)).save(folder / "tactile_image.png")
    # On a scale of its own: soft presses would be black on the full one.
    most = max(float(image.max()), 1.0)
    picture = colored_tactile_image(image, layout.x_mm, layout.y_mm, most)
    picture.save(folder / "tactile_picture.png")


def _summary(digit: DigitTouch | None, cyskin: CySkinTouch | None) -> dict[str, Any]:
    """What press.json holds."""
    contacts: dict[str, Contact] = {}
    with_what: dict[str, dict[str, str]] = {}
    if digit is not None:
        contacts["digit"] = digit.contact
        light = digit.calibration or "the one that ships"
        with_what["digit"] = {"calibration": light, "optics": digit.renderer}
    if cyskin is not None:
        contacts["cyskin"] = cyskin.contact
        with_what["cyskin"] = {"layout": cyskin.layout.name}
    command = next(iter(contacts.values())).command
    return {
        "shape": command.shape,
        "x_mm": command.x_mm,
        "y_mm": command.y_mm,
        "yaw_rad": command.yaw_rad,
        "commanded_force_n": command.force_n,
        "versions": {name: version(name) for name in VERSIONS},
    } | {
        sensor: {
            "force_n": contact.force_n,
            "depth_mm": contact.depth_mm,
            "settled": contact.settled,
            "bottomed": contact.bottomed,
            "contact_area_mm2": contact.contact_area_mm2,
            "milliseconds": contact.milliseconds,
            "elastomer": elastomer_json(contact.elastomer),
        }
        | with_what[sensor]
        for sensor, contact in contacts.items()
    }
