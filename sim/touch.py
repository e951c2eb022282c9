"""The result of a press, and the folder that it is saved to.

press.json                       the command, what each contact came to, versions, an attached
                                 sensor's pose
digit.png, contact_digit.npz     the DIGIT's image, its surface and pressure
cyskin.json, contact_cyskin.npz  the CySkin's counts, its surface and pressure
tactile_image.png                the counts as an image, 16 bits a pixel
tactile_picture.png              the same in colors, with the taxels
markers.csv                      centers of the DIGIT's markers, if its gel has any
scene_digit.xml, scene_cyskin.xml    each contact as a MuJoCo scene
"""

import json
from dataclasses import asdict, dataclass
from functools import cached_property
from math import hypot
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.files import locked, move_into, temporary_folder, write_csv
from t2twin.core.machine import installed_version
from t2twin.core.renamed import NewAttributes
from t2twin.primitives_cad.mesh_io.stl import binary_stl
from t2twin.primitives_cad.shape import Shape
from t2twin.sim import scene
from t2twin.sim.contact.elastomer import elastomer_json
from t2twin.sim.contact.types import Contact, PressCommand
from t2twin.sim.optical.image_renderer import Renderer
from t2twin.sim.optical.markers import Markers, surface_shift
from t2twin.sim.taxels.dense import dense_counts, dense_layout, dense_tractions
from t2twin.sim.taxels.layout import Layout
from t2twin.sim.taxels.pads import FULL_SCALE_COUNTS
from t2twin.sim.taxels.phi import Phi
from t2twin.sim.taxels.tactile_image import colored_tactile_image

VERSIONS = ("t2twin", "mujoco", "numpy")
"""Packages whose versions press.json contains."""

MARKERS_CSV = "markers.csv"
MARKER_COLUMNS = ("marker", "rest_x_mm", "rest_y_mm", "x_mm", "y_mm")

MaybeNone = Any
"""None, which type checkers need not exclude: most touches are of both sensors (as in typeshed)."""


@dataclass(frozen=True)
class Notice:
    """One cause for which a touch differs from what a physics engine computes.

    body: name of the touching body. reason: a clause that names the cause. force_n: the force on
    the sensor that the contact lacks, along x, y and z of the sensor frame, N; 0 where only the
    shape is approximate.
    """

    body: str
    reason: str
    force_n: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def unread_n(self) -> float:
        """Size of the force that the contact lacks, N."""
        return hypot(*self.force_n)

    def __str__(self) -> str:
        lacking = f"{self.unread_n:.3g} N of {self.body} not read" if self.unread_n else self.body
        return f"{lacking}: {self.reason}"


@dataclass(frozen=True)
class Touch(NewAttributes):
    """One press of one shape into the DIGIT, the CySkin or both.

    command: the shape's position, rotation and force. image: (320, 240, 3) uint8, the DIGIT's, RGB.
    counts: (n,) uint16, one for each taxel of the layout. digit, cyskin: the contacts, with
    depth_mm, force_n, surface_mm, pressure_kpa and more. layout: the CySkin's taxels. optics:
    file of the DIGIT's light, None for the default optics. renderer: what rendered the image.
    markers: those on the DIGIT's gel, None for none.
    sensor_to_world: (4, 4) transform, m, of a sensor in a MuJoCo model; None without a model.
    memory: (m, n) state of the CySkin's memory after the counts, counts; None without a memory.
    notices: what the contacts lack of the forces in a MuJoCo model, and where they are approximate.

    The fields of a sensor that was not pressed are None. A press of 0 N, which datasets contain,
    has an image and counts but no contacts.
    """

    shape: Shape
    command: PressCommand
    image: np.ndarray | MaybeNone
    counts: np.ndarray | MaybeNone
    digit: Contact | MaybeNone
    cyskin: Contact | MaybeNone
    layout: Layout | MaybeNone
    optics: str | None = None
    renderer: Renderer = "baked"
    markers: Markers | None = None
    sensor_to_world: np.ndarray | None = None
    memory: np.ndarray | MaybeNone = None
    notices: tuple[Notice, ...] = ()

    def __repr__(self) -> str:
        parts = [f"{sensor}: {contact.summary}" for sensor, contact in self.contacts.items()]
        parts += [f"not read: {self.unread_n:.3g} N"] if self.unread_n else []
        return f"Touch({self.command.shape!r}, {'; '.join(parts) or 'no contact'})"

    @property
    def unread_n(self) -> float:
        """Sum of the sizes of all forces that the contacts lack, N."""
        return sum(notice.unread_n for notice in self.notices)

    @cached_property
    def contacts(self) -> dict[str, Contact]:
        """The contacts there are, by sensor: "digit", then "cyskin"."""
        contacts = {"digit": self.digit, "cyskin": self.cyskin}
        return {sensor: contact for sensor, contact in contacts.items() if contact is not None}

    @cached_property
    def markers_mm(self) -> np.ndarray:
        """(n, 2) x and y of the markers' centers on the deformed gel, mm, x right and y down.

        They are in the order of `markers.rest_mm`, and some are outside the image.
        Raises T2TwinError if the gel has no markers, or the DIGIT was not pressed.
        """
        if self.markers is None:
            raise T2TwinError("the touch has no markers; expected a twin with markers=True")
        return self.markers.moved_mm(None if self.digit is None else surface_shift(self.digit))

    @cached_property
    def tactile_image(self) -> np.ndarray:
        """(396, 240) float32, counts: barycentric interpolation between the taxels.

        Raises T2TwinError if the CySkin was not pressed, and for a layout that phi refuses, such as
        one with all taxels on a line.
        """
        if self.layout is None:
            raise T2TwinError("the CySkin was not pressed, so there is no tactile image")
        return Phi(self.layout.x_mm, self.layout.y_mm)(self.counts.astype(np.float32))

    @cached_property
    def dense_counts(self) -> np.ndarray:
        """(n,) uint16: noiseless counts at the places of the dense counts
        (t2twin.sim.taxels.dense)."""
        if self.cyskin is None:
            return np.zeros(dense_layout().size, np.uint16)
        return dense_counts(self.cyskin)

    @cached_property
    def tractions(self) -> np.ndarray:
        """(3, n) float32, kPa: pressure and shear along x and y on the cover at the places of
        the dense counts (t2twin.sim.taxels.dense)."""
        if self.cyskin is None:
            return np.zeros((3, dense_layout().size), np.float32)
        return dense_tractions(self.cyskin)

    def save(self, folder: str | Path) -> None:
        """Write all files of the folder, or none.

        Raises T2TwinError where the folder cannot be written.
        """
        folder = arguments.path(folder, "folder")
        with locked(folder), temporary_folder(folder, "press") as temporary:
            content = json.dumps(_press_json(self), indent=1)
            (temporary / "press.json").write_text(f"{content}\n")
            mesh_file = scene.mesh_name(self.shape)
            if mesh_file is not None:
                (temporary / mesh_file).write_bytes(binary_stl(*self.shape.triangles))
            for sensor, contact in self.contacts.items():
                _write_contact(temporary, sensor, contact, mesh_file)
            if self.image is not None:
                Image.fromarray(self.image).save(temporary / "digit.png")
            if self.layout is not None:
                _write_cyskin(temporary, self.layout, self.counts, self.tactile_image)
            if self.markers is not None:
                write_csv(temporary / MARKERS_CSV, MARKER_COLUMNS, marker_rows(self))
            move_into(folder, sorted(temporary.iterdir()))


def marker_rows(touch: Touch) -> list[list[Any]]:
    """Rows of MARKER_COLUMNS, one for each marker of a touch with markers."""
    assert touch.markers is not None
    places = np.hstack([touch.markers.rest_mm, touch.markers_mm]).tolist()
    return [[number, *row] for number, row in enumerate(places)]


def scene_path(folder: Path, sensor: str) -> Path:
    """The scene of a sensor, "digit" or "cyskin", in the folder of a saved touch."""
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


def _write_cyskin(folder: Path, layout: Layout, counts: np.ndarray, image: np.ndarray) -> None:
    content = {
        "layout": layout.name,
        "counts": counts.tolist(),
        "x_mm": layout.x_mm.tolist(),
        "y_mm": layout.y_mm.tolist(),
        "full_scale_counts": FULL_SCALE_COUNTS,
    }
    (folder / "cyskin.json").write_text(json.dumps(content, indent=1) + "\n")
    # 16 bits a pixel, so that the counts can be read back from the image.
    Image.fromarray(np.rint(image).astype(np.uint16)).save(folder / "tactile_image.png")
    # The color scale ends at the image's maximum: a light press would be black at full scale.
    brightest = max(float(image.max()), 1.0)
    picture = colored_tactile_image(image, layout.x_mm, layout.y_mm, brightest)
    picture.save(folder / "tactile_picture.png")


def _press_json(touch: Touch) -> dict[str, Any]:
    setup: dict[str, dict[str, Any]] = {
        "digit": {"optics": touch.optics or "default", "renderer": touch.renderer},
        "cyskin": {} if touch.layout is None else {"layout": touch.layout.name},
    }
    if touch.markers is not None:
        setup["digit"]["markers"] = asdict(touch.markers)
    command = touch.command
    to_world = touch.sensor_to_world
    attached: dict[str, Any] = {}
    if to_world is not None:
        attached["sensor_to_world"] = to_world.tolist()
        attached["notices"] = [asdict(notice) for notice in touch.notices]
    return {
        **attached,
        "shape": command.shape,
        "x_mm": command.x_mm,
        "y_mm": command.y_mm,
        "yaw_rad": command.yaw_rad,
        "commanded_force_n": command.force_n,
        "notes": list(touch.shape.notes),
        "versions": {name: installed_version(name) for name in VERSIONS},
    } | {
        sensor: {
            "force_n": contact.force_n,
            "depth_mm": contact.depth_mm,
            "settled": bool(contact.settled),
            "smaller_than_grid": contact.smaller_than_grid,
            "bottomed": contact.bottomed,
            "contact_area_mm2": contact.contact_area_mm2,
            "milliseconds": contact.milliseconds,
            "elastomer": elastomer_json(contact.elastomer),
        }
        | setup[sensor]
        for sensor, contact in touch.contacts.items()
    }
