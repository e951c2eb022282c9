"""The result of a press, and the folder that it is saved to; docs/reference/file-formats.md lists
its files."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from math import hypot
from pathlib import Path
from typing import Any

import numpy as np

from t2twin.core import arguments
from t2twin.core.arrays import Record, kept_property
from t2twin.core.errors import T2TwinError
from t2twin.core.files import result_folder, write_csv
from t2twin.core.machine import installed_version
from t2twin.primitives_cad.shape import Shape, binary_stl
from t2twin.sim import scene
from t2twin.sim.contact.displacements import is_far
from t2twin.sim.contact.elastomer import elastomer_json
from t2twin.sim.contact.heights import is_cut, reaches_beyond
from t2twin.sim.contact.types import SMALL, TILT, UNSETTLED, Contact, PressCommand
from t2twin.sim.optical.gel_camera import ImageReading
from t2twin.sim.optical.markers import Markers
from t2twin.sim.optical.spec import KIND as GEL_CAMERA
from t2twin.sim.taxels.layout import Layout
from t2twin.sim.taxels.spec import KIND as TAXEL_ARRAY
from t2twin.sim.taxels.taxel_array import CountsReading

# A sensor's reading: the sensor, its contact, and its image or counts
Reading = ImageReading | CountsReading
VERSIONS = ("t2twin", "mujoco", "numpy")  # packages whose versions press.json contains
PRESS_JSON = "press.json"  # the file that each saved touch has
# Attributes of a contact that press.json contains.
CONTACT_JSON = (
    "force_n", "depth_mm", "settled", "smaller_than_grid", "bottomed", "contact_area_mm2",
    "milliseconds",
)  # fmt: skip
POSE_JSON = ("shape", "x_mm", "y_mm", "yaw_rad", *TILT)  # and of its command
MARKERS_CSV = "markers.csv"
MARKER_COLUMNS = ("marker", "rest_x_mm", "rest_y_mm", "x_mm", "y_mm")

BOTTOMED = "the shape bottomed out: its base plate (the lowest flat face) is in contact"
FAR_SHEARED = (
    "the surface is sheared beyond what the model describes, so its displacement is approximate"
)

# None, which type checkers need not exclude: most touches are of both sensors (as in typeshed)
MaybeNone = Any


@dataclass(frozen=True)
class Notice:
    """One cause for which a touch differs from what a physics engine computes."""

    body: str  # name of the touching body
    reason: str  # a clause that names the cause
    # the force on the sensor that the contact lacks, along x, y and z of the sensor frame, N; 0
    # where only the shape is approximate
    force_n: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def unread_n(self) -> float:
        """Size of the force that the contact lacks, N."""
        return hypot(*self.force_n)

    def __str__(self) -> str:
        lacking = f"{self.unread_n:.3g} N of {self.body} not read" if self.unread_n else self.body
        return f"{lacking}: {self.reason}"


@dataclass(frozen=True, eq=False)
class Touch(Record):
    """One press of one shape into one sensor or two.

    command: the shape's position, rotation and force. readings: those of the sensors by their
    names, the source's first; touch["digit"] is the reading of a sensor, with its contact.
    sensor_to_world: (4, 4) transform, m, of a sensor in a MuJoCo model; None without a model.
    notices: what the contacts lack of the forces in a MuJoCo model, and where they are approximate.

    The attributes of one kind, such as `image` and `counts`, are those of the first sensor of that
    kind, and None without one. A press of 0 N, which datasets contain, has readings but no
    contacts.
    """

    shape: Shape
    command: PressCommand
    readings: Mapping[str, Reading] = field(default_factory=dict)
    sensor_to_world: np.ndarray | None = None
    notices: tuple[Notice, ...] = ()

    def __getitem__(self, sensor: str) -> Reading | MaybeNone:
        """The reading of a sensor. Raises T2TwinError for one that was not pressed."""
        if sensor not in self.readings:
            there = ", ".join(self.readings) or "none"
            raise T2TwinError(f"the touch has no reading of {sensor!r}; it has: {there}")
        return self.readings[sensor]

    def __contains__(self, sensor: object) -> bool:
        return sensor in self.readings

    def __iter__(self) -> Iterator[str]:
        """The names of the sensors, as of a dict."""
        return iter(self.readings)

    def __repr__(self) -> str:
        parts = [f"{sensor}: {contact.summary}" for sensor, contact in self.contacts.items()]
        parts += [f"not read: {self.unread_n:.3g} N"] if self.unread_n else []
        return f"Touch({self.command.shape!r}, {'; '.join(parts) or 'no contact'})"

    @property
    def unread_n(self) -> float:
        """Sum of the sizes of all forces that the contacts lack, N."""
        return sum(notice.unread_n for notice in self.notices)

    @kept_property
    def contacts(self) -> Mapping[str, Contact]:
        """The contacts there are, by sensor, the source's first."""
        of_all = {sensor: reading.contact for sensor, reading in self.readings.items()}
        return {sensor: contact for sensor, contact in of_all.items() if contact is not None}

    @property
    def notes(self) -> list[str]:
        """What limits the contacts and readings, each with the sensor's name; empty for nothing.

        Of a contact: it did not settle, is smaller than the grid, bottomed out, is sheared beyond
        what the model describes, or lies outside the camera's view. Of a shape: its middle lies off
        the sensor, or parts of it are not pressed. Of counts: they are clipped at full scale.
        """
        found = []
        for name, each in self.readings.items():
            limits = [] if each.contact is None else contact_notes(each.contact)
            found += [f"{name}: {note}" for note in [*limits, *each.notes]]
        return found

    def _first(self, kind: str) -> Reading | MaybeNone:
        """The reading of the first sensor of a kind; None without one."""
        of_kind = (each for each in self.readings.values() if each.sensor.spec.kind == kind)
        return next(of_kind, None)

    @property
    def of_camera(self) -> ImageReading | MaybeNone:
        """The reading of the first gel camera."""
        return self._first(GEL_CAMERA)

    @property
    def of_array(self) -> CountsReading | MaybeNone:
        """The reading of the first taxel array."""
        return self._first(TAXEL_ARRAY)

    @property
    def image(self) -> np.ndarray | MaybeNone:
        """(rows, columns, 3) uint8, RGB: the image of the first gel camera."""
        return None if self.of_camera is None else self.of_camera.image

    @property
    def counts(self) -> np.ndarray | MaybeNone:
        """(n,) uint16: the counts of the first taxel array, in the order of `layout`."""
        return None if self.of_array is None else self.of_array.counts

    @property
    def digit(self) -> Contact | MaybeNone:
        """The contact of the first gel camera, with depth_mm, force_n, pressure_kpa and more."""
        return None if self.of_camera is None else self.of_camera.contact

    @property
    def cyskin(self) -> Contact | MaybeNone:
        """The contact of the first taxel array."""
        return None if self.of_array is None else self.of_array.contact

    @property
    def layout(self) -> Layout | MaybeNone:
        """The taxels of the first taxel array."""
        return None if self.of_array is None else self.of_array.sensor.layout

    @property
    def markers(self) -> Markers | None:
        """The markers on the gel of the first gel camera; None for none."""
        return None if self.of_camera is None else self.of_camera.sensor.markers

    @property
    def markers_mm(self) -> np.ndarray:
        """(n, 2) x and y of the markers' centers on the deformed gel, mm, in the order of
        `markers.rest_mm`; some are outside the image. Raises T2TwinError without markers."""
        if self.of_camera is None:
            raise T2TwinError("the touch has no gel camera, which markers would be of")
        return self.of_camera.markers_mm

    def _array(self, wanted: str) -> CountsReading:
        """The reading of the first taxel array. Raises T2TwinError without one, for what it has."""
        if self.of_array is None:
            raise T2TwinError(f"the touch has no taxel array, which {wanted} would be of")
        return self.of_array

    @property
    def tactile_image(self) -> np.ndarray:
        """(rows, columns) float32, counts: barycentric interpolation between the taxels.

        Raises T2TwinError without a taxel array, and for a layout that phi refuses.
        """
        return self._array("a tactile image").tactile_image

    @property
    def dense_counts(self) -> np.ndarray:
        """(n,) uint16: noiseless counts of the first taxel array at its dense places; raises as
        `tactile_image` without one."""
        return self._array("dense counts").dense_counts

    def save(self, folder: str | Path) -> None:
        """Write all files of the folder, or none; removes those of an earlier touch there.

        Raises T2TwinError where another's file has one of the names, or none can be written.
        """
        folder = arguments.path(folder, "folder")
        with result_folder(folder, "press", [PRESS_JSON]) as temporary:
            content = json.dumps(self._content(), indent=1)
            (temporary / PRESS_JSON).write_text(f"{content}\n")
            mesh_file = scene.mesh_name(self.shape)
            if mesh_file is not None:
                (temporary / mesh_file).write_bytes(binary_stl(*self.shape.triangles))
            for sensor, contact in self.contacts.items():
                names = ("surface_mm", "pressure_kpa", "x_mm", "y_mm")
                arrays = {name: getattr(contact, name) for name in names}
                np.savez_compressed(temporary / f"contact_{sensor}.npz", **arrays)
                scene_path(temporary, sensor).write_text(scene.scene(contact, mesh_file))
            for sensor, reading in self.readings.items():
                second = "" if reading is self.of_array else f"_{sensor}"
                reading.save(temporary, sensor, second)
            if self.markers is not None:
                write_csv(temporary / MARKERS_CSV, MARKER_COLUMNS, marker_rows(self))

    def _content(self) -> dict[str, Any]:
        """The content of press.json."""
        command, attached = self.command, {}
        if self.sensor_to_world is not None:
            attached["sensor_to_world"] = self.sensor_to_world.tolist()
            attached["notices"] = [asdict(notice) for notice in self.notices]
        return {
            **attached,
            **{name: getattr(command, name) for name in POSE_JSON},
            "commanded_force_n": command.force_n,
            "notes": [*command.tilted(self.shape).notes, *self.notes],
            "versions": {name: installed_version(name) for name in VERSIONS},
        } | {
            sensor: {name: getattr(contact, name) for name in CONTACT_JSON}
            | {"elastomer": elastomer_json(contact.elastomer)}
            | self[sensor].setup
            for sensor, contact in self.contacts.items()
        }


def contact_notes(contact: Contact) -> list[str]:
    """A clause for each limit of a contact; none for an ordinary one."""
    found = []
    if contact.smaller_than_grid:
        found.append(SMALL)
    elif not contact.settled:
        found.append(UNSETTLED)
    motion = contact.motion
    if motion is not None and motion.parts_mm is not None:
        # Up to a mean strain of 1 the linear response is that of a rubber (assumed).
        weights, most_mm = contact.pressure_kpa[motion.window], contact.elastomer.thickness_mm
        if is_far(motion.parts_mm.sum(axis=0), weights, contact.pitch_mm, most_mm):
            found.append(FAR_SHEARED)
    if contact.bottomed:
        found.append(BOTTOMED)
    places = (contact.command.x_mm, contact.x_mm), (contact.command.y_mm, contact.y_mm)
    half_x, half_y = (abs(axis).max() for _, axis in places)
    if any(abs(at) > abs(axis).max() for at, axis in places):
        found.append(
            "the shape's middle lies off the sensor, whose soft layer reaches "
            f"{half_x:.1f} mm to each side and {half_y:.1f} mm up and down"
        )
    shape = contact.command.tilted(contact.shape)
    # Only then its solid is needed, which is slow to make.
    if is_cut(shape.surface) and reaches_beyond(
        shape.surface, contact.command, contact.x_mm, contact.y_mm
    ):
        corners, reach_mm = shape.triangles[0], max(shape.surface.x_mm[-1], shape.surface.y_mm[-1])
        if len(corners) and abs(corners[:, :2]).max() > reach_mm:
            beyond = f"beyond {reach_mm:.0f} mm from its middle"
            found.append(f"parts of the shape {beyond} are not pressed")
    return found


def marker_rows(touch: Touch) -> list[list[Any]]:
    """Rows of MARKER_COLUMNS, one for each marker of a touch with markers."""
    assert touch.markers is not None
    places = np.hstack([touch.markers.rest_mm, touch.markers_mm]).tolist()
    return [[number, *row] for number, row in enumerate(places)]


def scene_path(folder: Path, sensor: str) -> Path:
    """The scene of a sensor, by its name, in the folder of a saved touch."""
    return folder / f"scene_{sensor}.xml"
