"""A simulated gel camera: the press of a shape into its gel, the image and maps of the contact.

Contact maps are depth and normal pressure on a grid over the image, which divides it into equal
cells. A cell's depth is the deflection of the gel where the ray through the cell's middle meets the
deformed gel. A cell's pressure is the force on the part of the gel that it shows, over the area of
a cell in the view of the sensor's file. So the sum of the pressures times that area is the force in
the view, for each unit, whatever its scale and place.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from math import prod
from pathlib import Path
from typing import Any, ClassVar, get_args

import numpy as np
from msgspec import structs
from PIL import Image

from t2twin.core import arguments
from t2twin.core.arrays import Result, kept_property
from t2twin.core.errors import T2TwinError, warn
from t2twin.core.files import sha256_of
from t2twin.primitives_cad.shape import Shape
from t2twin.sim.contact.contact_solver import solve_contact
from t2twin.sim.contact.elastomer import DOME, Elastomer, Friction, MountTable
from t2twin.sim.contact.types import Contact, PressCommand
from t2twin.sim.optical.artifacts import Artifacts, with_artifacts
from t2twin.sim.optical.camera import PARALLAX_STEPS, Camera, optical_grid
from t2twin.sim.optical.compiled import at_places
from t2twin.sim.optical.image_renderer import (
    ImageRenderer,
    Renderer,
    check_exposure,
    optics_of_leds,
)
from t2twin.sim.optical.markers import Markers, moved, surface_shift
from t2twin.sim.optical.optics import SPECS, Optics, is_bundled
from t2twin.sim.optical.pyrender_renderer import PyrenderRenderer
from t2twin.sim.optical.spec import GelCameraSpec
from t2twin.sim.optical.surface import surface_on
from t2twin.sim.optical.units import Unit, UnitRanges, sample_unit

NO_CHANGE_GREY = 128  # grey level of no difference in pictures
CELL_MM = 0.26
"""Approximate side of a cell, mm (assumed: about the pitch of a contact's grid, and 5 pixels of a
DIGIT)."""

Grid = tuple[int, int]  # rows and columns of the cells of contact maps


def depth_on(grid: Grid, contact: Contact, camera: Camera) -> np.ndarray:
    """(rows, columns) depth of a contact, in the image of a unit's camera."""
    gel = contact.elastomer
    x_mm, y_mm = optical_grid(gel)
    surface, step = surface_on(contact, x_mm, y_mm), x_mm[1] - x_mm[0]
    row, column = (  # of the cells' middles, px
        (np.arange(cells) + 0.5) * pixels / cells - 0.5
        for pixels, cells in ((camera.rows, grid[0]), (camera.columns, grid[1]))
    )
    across, down = np.meshgrid(
        (column - camera.middle[1]) / camera.focal_px, (row - camera.middle[0]) / camera.focal_px
    )
    z, depth = np.zeros_like(across), np.zeros_like(across)
    for _ in range(PARALLAX_STEPS):
        reach = camera.distance_mm + z
        x, y = across * reach, down * reach
        rows, columns = (y - y_mm[0]) / step, (x - x_mm[0]) / step
        depth = at_places(surface[None], rows.ravel(), columns.ravel()).reshape(z.shape)
        z = camera.rest_mm(gel, x, y) - depth
    return depth


def pressure_on(grid: Grid, cell_mm2: float, contact: Contact, camera: Camera) -> np.ndarray:
    """(rows, columns) pressure of a contact, in the image of a unit's camera. The force of each
    cell of the contact's grid is shared by the four nearest cells of the image."""
    loaded = np.nonzero(contact.pressure_kpa)
    moved_mm = contact.sheared_mm[:, *loaded]
    x, y = contact.x_mm[loaded[1]], contact.y_mm[loaded[0]]
    depth = contact.surface_mm[loaded] + moved_mm[2]
    x, y = x + moved_mm[0], y + moved_mm[1]
    z = camera.rest_mm(contact.elastomer, x, y) - depth
    row, column = camera.project(x, y, z)
    row = (row + 0.5) * grid[0] / camera.rows - 0.5
    column = (column + 0.5) * grid[1] / camera.columns - 0.5
    values = contact.pressure_kpa[loaded] * contact.pitch_mm**2 / cell_mm2
    found = np.zeros((grid[0] + 2, grid[1] + 2))  # with a rim outside the image
    above, left = np.floor(row).astype(int), np.floor(column).astype(int)
    down, across = row - above, column - left
    for i, along_y in ((above, 1.0 - down), (above + 1, down)):
        for j, along_x in ((left, 1.0 - across), (left + 1, across)):
            place = np.clip(i + 1, 0, grid[0] + 1), np.clip(j + 1, 0, grid[1] + 1)
            np.add.at(found, place, values * along_y * along_x)
    return found[1:-1, 1:-1]


@dataclass(frozen=True)
class GelCamera:
    """A gel camera: its file, and what differs from it.

    Raises T2TwinError for a file that is not an optics file, and for renderer "pyrender" with an
    optics file, which has no LEDs to render.
    """

    OPTIONS: ClassVar = ("optics", "renderer", "frames", "markers", "gel")  # of `with_options`
    HAS_UNITS: ClassVar = True  # whether its units differ in what a recipe samples
    VALUE: ClassVar = "image"  # column of its readings in a dataset
    FRICTION: ClassVar = "gel_friction"  # range of its friction in a recipe

    spec: GelCameraSpec
    folder: str = ""  # of the sensor's file
    optics_file: str | None = None  # replaces the file's light and, if it has one, Young's modulus
    renderer: Renderer = "baked"
    frames: int | None = None  # averaged for an image; None is the file's number
    markers: Markers | None = None  # printed on the gel
    gel: Elastomer | None = None  # pressed in place of the file's
    unit: Unit | None = field(default=None, repr=False)  # its light replaces the file's

    def __post_init__(self) -> None:
        arguments.choice(self.renderer, "renderer", get_args(Renderer))
        if self.gel is not None:
            arguments.instance(self.gel, "gel", Elastomer)
            try:
                structs.replace(self.spec, gel=self.gel)  # the checks of a file
            except T2TwinError as error:
                warn(f"{error}; only the contact is right, not the image")
            domes = {tuple(getattr(gel, key) for key in DOME) for gel in (self.gel, self.own_gel)}
            if self.optics_path and len(domes) > 1:
                warn("the optics are of another dome; the image is less exact toward its edges")
        if self.markers is not None:
            printed = arguments.instance(self.markers, "markers, if not True or False,", Markers)
            object.__setattr__(self, "markers", printed.printed(self.camera))
        self.elastomer.cells(self.pitch_mm)
        _ = self.image_renderer  # faults of the optics are those of the sensor
        if self.unit is None:
            check_exposure(self.optics.background)

    @property
    def name(self) -> str:
        return self.spec.name

    @property
    def pitch_mm(self) -> float:
        """Pitch of the contact's grid, mm."""
        return self.spec.gel.grid_mm

    @cached_property
    def contact_grid(self) -> Grid:
        """The grid of the contact maps."""
        columns, rows = (
            max(1, round(2 * half / CELL_MM)) for half in self.camera.seen_half_extent_mm()
        )
        return rows, columns

    @property
    def friction(self) -> Friction:
        """The friction of the gel."""
        return self.spec.gel.law_of_friction

    @property
    def mount(self) -> MountTable:
        return self.spec.mount

    @cached_property
    def camera(self) -> Camera:
        """The camera of the sensor's file."""
        table = self.spec.camera
        return Camera(*(getattr(table, name) for name in Camera.__struct_fields__))

    @property
    def size(self) -> str:
        """Size of an image, for lists of sensors."""
        return f"{self.camera.columns} x {self.camera.rows} pixels"

    @property
    def own_gel(self) -> Elastomer:
        """The gel of the sensor's file."""
        return self.spec.gel.elastomer(self.name)

    @property
    def noise_grey(self) -> float:
        """Standard deviation of an image's noise, grey levels."""
        frames = self.spec.camera.frames if self.frames is None else self.frames
        of_one = self.spec.camera.noise_grey if self.unit is None else self.unit.noise_grey
        return float(of_one / np.sqrt(frames))

    @property
    def optics_sha256(self) -> str | None:
        """SHA-256 of the optics file; None for light of LEDs."""
        return None if self.optics_path is None else sha256_of(self.optics_path)

    @property
    def optics_path(self) -> Path | None:
        """The optics file, None for light of LEDs."""
        if self.optics_file is not None:
            return Path(self.optics_file)
        own = self.spec.light.optics
        if own is None:
            return None
        return SPECS / f"{own}.npz" if is_bundled(own) else Path(self.folder) / own

    @cached_property
    def optics(self) -> Optics:
        """Those of the unit, of the optics file, or of the LEDs."""
        path, light, camera = self.optics_path, self.spec.light, self.camera
        if self.unit is not None:
            return self.unit.optics
        if path is None:
            return optics_of_leds(light.leds, light.ambient, light.gamma, camera, self.own_gel)
        optics = Optics.load(path)
        stated = optics.stated.items() if self.optics_file is None else ()
        for table, key, value in ((t, k, v) for t, own in stated for k, v in own.items()):
            if (own := getattr(getattr(self.spec, table), key)) != value:
                raise T2TwinError(
                    f"{table}.{key} is {own:.6g}, but light.optics was fitted with "
                    f"{value:.6g}; leave it out, or light.optics"
                )
        is_own_file = self.optics_file is None and not is_bundled(light.optics)
        if is_own_file and (light.leds or any(light.ambient) or self.spec.units):
            raise T2TwinError(
                "light.leds, light.ambient and units have no effect beside the optics of one unit; "
                "leave them out, or light.optics"
            )
        if (optics.camera.rows, optics.camera.columns) != (camera.rows, camera.columns):
            raise T2TwinError(
                f"{path} is of images with {optics.camera.rows} rows and {optics.camera.columns} "
                f"columns; expected {camera.rows} and {camera.columns}, those of {self.name}"
            )
        return optics

    @cached_property
    def image_renderer(self) -> ImageRenderer:
        gels = self.own_gel, self.spec.camera.noise_grey, self.gel, self.markers
        if self.renderer == "baked":
            return ImageRenderer(self.optics, *gels)
        leds = self.unit.leds if self.unit is not None else self.spec.light.leds
        if not leds or (self.unit is None and self.optics_file is not None):
            raise T2TwinError(
                "pyrender cannot render an optics file, which has no description of single "
                "LEDs; it renders the default optics and units sampled without an optics file"
            )
        return PyrenderRenderer(leds, self.spec.light.ambient, self.optics, *gels)

    @cached_property
    def elastomer(self) -> Elastomer:
        """The gel that is pressed: a given one, else the file's with the optics' modulus."""
        own = self.own_gel
        return self.gel or replace(own, young_mpa=self.optics.young_mpa or own.young_mpa)

    def with_options(self, options: dict[str, Any]) -> "GelCamera":
        """The same sensor with some of OPTIONS, by name; None keeps the present value. optics: a
        file. markers: True for those of the sensor's file."""
        given = {name: value for name, value in options.items() if value is not None}
        if "optics" in given:
            given["optics_file"] = str(arguments.path(given.pop("optics"), "optics"))
        if isinstance(given.get("markers"), bool | np.bool_):
            given["markers"] = self.spec.markers if given["markers"] else None
            if options["markers"] and self.spec.markers is None:
                raise T2TwinError(
                    f"the file of {self.name} has no table [markers]; give t2twin.Markers(...)"
                )
        return replace(self, **given)

    @property
    def is_center(self) -> bool:
        """Whether units are sampled near the optics: of a given file, or of a sensor's file without
        LEDs or ranges of units."""
        return self.optics_file is not None or not self.spec.light.leds or self.spec.units is None

    def sampled(
        self, rng: np.random.Generator, artifacts_rng: np.random.Generator, ranges: UnitRanges,
        artifacts: Artifacts | None,
    ) -> "GelCamera":  # fmt: skip
        """A sampled unit: near the optics, if they are the center, else from the ranges.
        artifacts: None for none."""
        unit = sample_unit(rng, self.spec, ranges, self.optics if self.is_center else None)
        if artifacts is not None:
            unit = with_artifacts(artifacts_rng, unit, artifacts, self.spec.light.leds)
        return self.with_unit(unit)

    def with_unit(self, unit: Unit) -> "GelCamera":
        """The same sensor with the light and noise of a sampled unit."""
        return replace(self, unit=unit)

    def for_dataset(self) -> "GelCamera":
        """The same sensor with the errors that datasets have by default: its own noise."""
        return self

    def info(self, with_dense_counts: bool, with_contact_maps: bool) -> dict[str, Any]:
        """What a dataset records of it: fields of t2twin.sim.dataset.info.CameraInfo."""
        camera = self.camera
        maps = {"contact_grid": self.contact_grid} if with_contact_maps else {}
        return maps | {
            "image_shape": (camera.rows, camera.columns, 3),
            "view_mm": camera.seen_half_extent_mm(),
            "noise_grey": self.noise_grey,
            "optics_sha256": self.optics_sha256,
        }

    def press(self, shape: Shape, command: PressCommand) -> Contact:
        """The contact of a shape with the gel. Raises T2TwinError as solve_contact does."""
        return solve_contact(shape, command, self.elastomer, self.pitch_mm)

    def read(
        self, contact: Contact | None, rng: np.random.Generator | None = None,
        before: "ImageReading | None" = None, seconds: float | None = None,
    ) -> "ImageReading":  # fmt: skip
        """The reading of a contact, of None without contact. rng: of the camera noise; None for
        none. before, seconds: not used, since an image does not depend on earlier ones."""
        return ImageReading(self, contact, self.image(contact, rng))

    def image(self, contact: Contact | None, rng: np.random.Generator | None = None) -> np.ndarray:
        """(rows, columns, 3) uint8: the image of a contact, of None the background frame. rng: of
        the camera noise; None for none."""
        if contact is None:
            return self.image_renderer.render(self._flat, rng, self.noise_grey)
        surface = surface_on(contact, *optical_grid(self.elastomer))
        shift = None if self.markers is None else surface_shift(contact)
        return self.image_renderer.render(surface, rng, self.noise_grey, shift)

    def background_frame(self, rng: np.random.Generator | None = None) -> np.ndarray:
        """(rows, columns, 3) uint8: the image without contact, of a sampled unit before its light
        drifted. rng: as for image."""
        earlier = None if self.unit is None else self.unit.earlier_background
        return self.image_renderer.render(self._flat, rng, self.noise_grey, background=earlier)

    @property
    def _flat(self) -> np.ndarray:
        """The deflection of a gel at rest."""
        x, y = optical_grid(self.elastomer)
        return np.zeros((y.size, x.size))


@dataclass(frozen=True, eq=False)
class ImageReading(Result):
    """An image of a gel camera. image: (rows, columns, 3) uint8, RGB; None before it is made."""

    sensor: GelCamera
    contact: Contact | None
    image: np.ndarray | None

    @property
    def notes(self) -> list[str]:
        """What limits the reading, in words; empty for nothing."""
        if self.contact is None:
            return []
        across, down = self.sensor.camera.is_seen(self.contact.x_mm, self.contact.y_mm, 0.0)
        is_seen = self.contact.pressure_kpa[np.ix_(down, across)].any()
        return [] if is_seen else ["the contact lies outside the camera's view"]

    @kept_property
    def markers_mm(self) -> np.ndarray:
        """(n, 2) x and y of the markers' centers on the deformed gel, mm, in the order of
        `sensor.markers.rest_mm`. Raises T2TwinError without markers."""
        if self.sensor.markers is None:
            raise T2TwinError("the touch has no markers; give the twin or the sensor markers=True")
        shift = None if self.contact is None else surface_shift(self.contact)
        return moved(self.sensor.markers.rest_mm, shift)

    @property
    def setup(self) -> dict[str, Any]:
        """What differs from the sensor's file, for JSON."""
        sensor, markers = self.sensor, self.sensor.markers
        own = {} if markers is None else {"markers": structs.asdict(markers)}
        return {"optics": sensor.optics_file or "default", "renderer": sensor.renderer, **own}

    @kept_property
    def depth_map_mm(self) -> np.ndarray:
        """(rows, columns) mm: depth of the gel on `sensor.contact_grid`."""
        grid = self.sensor.contact_grid
        if self.contact is None:
            return np.zeros(grid)
        return depth_on(grid, self.contact, self.sensor.optics.camera)

    @kept_property
    def pressure_map_kpa(self) -> np.ndarray:
        """(rows, columns) kPa: normal pressure on `sensor.contact_grid`."""
        grid = self.sensor.contact_grid
        if self.contact is None:
            return np.zeros(grid)
        cell_mm2 = 4 * prod(self.sensor.camera.seen_half_extent_mm()) / prod(grid)
        return pressure_on(grid, cell_mm2, self.contact, self.sensor.optics.camera)

    def save(self, folder: Path, name: str, _second: str) -> None:
        """Write NAME.png."""
        if self.image is not None:
            Image.fromarray(self.image).save(folder / f"{name}.png")

    def picture(self) -> Image.Image:
        """The background frame, the image, and their difference on grey."""
        assert self.image is not None
        background = self.sensor.background_frame()
        difference = np.clip(NO_CHANGE_GREY + self.image.astype(int) - background, 0, 255)
        return Image.fromarray(np.hstack([background, self.image, difference.astype(np.uint8)]))

    def without_value(self) -> "ImageReading":
        """The same without the image, which a moving contact does not need."""
        return replace(self, image=None)
