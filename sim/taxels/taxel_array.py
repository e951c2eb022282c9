"""A simulated taxel array: the press of a shape into its cover, and the counts of the contact."""

import json
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from msgspec import structs
from PIL import Image

from t2twin.core import arguments
from t2twin.core.arrays import Result, kept_property
from t2twin.core.draw import colored_tactile_image
from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad.shape import Shape
from t2twin.sim.contact.contact_solver import solve_contact
from t2twin.sim.contact.elastomer import Elastomer, Friction, MountTable
from t2twin.sim.contact.types import Contact, PressCommand
from t2twin.sim.taxels import reading
from t2twin.sim.taxels.layout import MAX_TAXELS, Layout, load_layout
from t2twin.sim.taxels.pads import (
    check_within,
    dense_layout,
    dense_tractions,
    pad_pressure_mpa,
    reach_mm,
)
from t2twin.sim.taxels.phi import Phi
from t2twin.sim.taxels.spec import DenseTable, Imperfections, TaxelArraySpec

MAX_WEIGHTS = 64_000_000  # cells times taxels; their weights take 7 GB for a moment (assumed)
FEWER_PLACES = 200  # places of dense counts of a mat without a table [dense] (assumed)


@dataclass(frozen=True)
class TaxelArray:
    """A taxel array: its file, and what differs from it."""

    OPTIONS: ClassVar = ("layout", "imperfections", "dead", "cover")  # options of `with_options`

    HAS_UNITS: ClassVar = False  # whether its units differ in what a recipe samples
    VALUE: ClassVar = "counts"  # column of its readings in a dataset
    FRICTION: ClassVar = "cover_friction"  # range of its friction in a recipe

    spec: TaxelArraySpec
    folder: str = ""  # of the sensor's file
    given_layout: Layout | None = None  # in place of the file's
    imperfections: str | None = None  # name of the file's; None for "white" or "none"
    dead: tuple[int, ...] = ()  # indices of taxels that always count 0
    cover: Elastomer | None = None  # pressed in place of the file's
    layout: Layout = field(init=False, repr=False, compare=False)
    flaws: Imperfections = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if self.cover is not None:
            arguments.instance(self.cover, "cover", Elastomer)
        layout = self.given_layout or self.spec.layout.layout(self.name, self.folder)
        object.__setattr__(self, "layout", layout)
        self._check_weights(layout.size, "taxels")
        check_within(layout, *reach_mm(self.elastomer, self.pitch_mm))
        if (self.given_layout, self.cover) == (None, None):
            self._check_file()
        presets, name = self.spec.imperfections, self.imperfections
        if name is None:
            name = reading.WHITE if reading.WHITE in presets else reading.NONE
        arguments.choice(name, f"imperfections of {self.name}", [reading.NONE, *presets])
        flaws = presets.get(name, Imperfections())
        flaws = structs.replace(flaws, dead=tuple(dict.fromkeys((*flaws.dead, *self.dead))))
        flaws.check_dead(layout.size)
        object.__setattr__(self, "imperfections", name)
        object.__setattr__(self, "flaws", flaws)

    def _check_file(self) -> None:
        """Raises T2TwinError for tables of the sensor's file that do not fit its taxels."""
        if reading.NONE in self.spec.imperfections:
            raise T2TwinError(
                f"imperfections.{reading.NONE} is the array without imperfections; rename the table"
            )
        for name, flaws in self.spec.imperfections.items():
            if flaws == Imperfections():
                raise T2TwinError(f"imperfections.{name} has no effect; remove it or give values")
            flaws.check_dead(self.layout.size, f"imperfections.{name}: dead taxel")
        table = self.spec.tactile_image
        for axis, pixels, places in (
            ("columns", table.columns, self.layout.x_mm), ("rows", table.rows, self.layout.y_mm),
        ):  # fmt: skip
            half_mm, most_mm = pixels / table.px_per_mm / 2, float(np.abs(places).max())
            if most_mm > half_mm:
                raise T2TwinError(
                    f"tactile_image.{axis} is {pixels}, which reaches {half_mm:.4g} mm from the "
                    f"middle; the taxels reach {most_mm:.4g} mm"
                )
        closest_mm = np.sort(self.layout.distances_mm(self.layout), axis=1)[:, 1].min()
        if closest_mm * table.px_per_mm < 1.0:
            least = f"two taxels share a pixel below {1.0 / closest_mm:.3g}"
            raise T2TwinError(f"tactile_image.px_per_mm is {table.px_per_mm:g}; {least}")
        if self.spec.dense is not None:
            self._check_weights(self.dense.size, "places of the dense counts")

    def _check_weights(self, count: int, what: str) -> None:
        """Raises T2TwinError for more places over the cells of the contact's grid than memory."""
        columns, rows = self.elastomer.cells(self.pitch_mm)
        if columns * rows * count > MAX_WEIGHTS:
            raise T2TwinError(
                f"{count} {what} over {columns} x {rows} cells of the contact's grid need too much "
                f"memory; use a larger grid_mm, for a product of at most {MAX_WEIGHTS:,}"
            )

    @property
    def name(self) -> str:
        return self.spec.name

    @cached_property
    def elastomer(self) -> Elastomer:
        """The cover that is pressed."""
        return self.cover or self.spec.cover.elastomer(self.name)

    @property
    def pitch_mm(self) -> float:
        """Pitch of the contact's grid, mm."""
        return self.spec.cover.grid_mm

    @property
    def friction(self) -> Friction:
        """The friction of the cover."""
        return self.spec.cover.law_of_friction

    @property
    def mount(self) -> MountTable:
        return self.spec.mount

    @property
    def full_scale(self) -> int:
        """Count at which a taxel saturates."""
        return self.spec.counts.full_scale

    @property
    def size(self) -> str:
        """Number of taxels, for lists of sensors."""
        return f"{self.layout.size} taxels"

    @property
    def tactile_image_size(self) -> tuple[int, int, float]:
        """Rows, columns and px/mm of the tactile image."""
        table = self.spec.tactile_image
        return table.rows, table.columns, table.px_per_mm

    @property
    def dense_table(self) -> DenseTable:
        """The grid of the dense counts."""
        cover, table = self.elastomer, DenseTable(max(0.2, self.elastomer.thickness_mm))
        area_mm2 = cover.width_mm * cover.length_mm
        if area_mm2 > MAX_TAXELS * table.cell_mm2:  # a mat
            table = DenseTable(float(np.sqrt(area_mm2 / FEWER_PLACES)))
        return self.spec.dense or table

    @cached_property
    def dense(self) -> Layout:
        """The places of the dense counts, through the first taxel of the sensor's file."""
        own = self.spec.layout.layout(self.name, self.folder)
        return dense_layout(self.elastomer, self.dense_table, own, self.pitch_mm)

    @cached_property
    def phi(self) -> Phi:
        """phi of the taxels, in the size and scale of the sensor's tactile image."""
        rows, columns, px_per_mm = self.tactile_image_size
        return Phi(self.layout.x_mm, self.layout.y_mm, (rows, columns), px_per_mm)

    def with_options(self, options: dict[str, Any]) -> "TaxelArray":
        """The same sensor with some of OPTIONS, by name; None keeps the present value."""
        given = {name: value for name, value in options.items() if value is not None}
        if "layout" in given:
            given["given_layout"] = load_layout(given.pop("layout"))
        return replace(self, **given)

    def for_dataset(self) -> "TaxelArray":
        """The same sensor with the errors that datasets have by default."""
        default = reading.DATASET_DEFAULT
        known = default in self.spec.imperfections
        return replace(self, imperfections=default if known else None)

    def info(self, with_dense_counts: bool, with_contact_maps: bool) -> dict[str, Any]:
        """What a dataset records of it: fields of t2twin.sim.dataset.info.ArrayInfo."""
        layout = self.layout
        content: dict[str, Any] = {
            "layout": layout.name,
            "x_mm": layout.x_mm,
            "y_mm": layout.y_mm,
            "pad_diameter_mm": layout.pad_diameter_mm,
            "full_scale_counts": self.full_scale,
            "tactile_image": self.tactile_image_size,
            "readings": self.spec.counts.readings,
            "rate_hz": self.spec.counts.rate_hz,
            "imperfections": self.flaws,
        }
        if with_dense_counts:
            content |= {
                "dense_x_mm": self.dense.x_mm,
                "dense_y_mm": self.dense.y_mm,
                "dense_pad_mm": float(self.dense.pad_diameter_mm[0]),
                "dense_cell_mm2": self.dense_table.cell_mm2,
            }
        return content

    def press(self, shape: Shape, command: PressCommand) -> Contact:
        """The contact of a shape with the cover. Raises T2TwinError as solve_contact does."""
        return solve_contact(shape, command, self.elastomer, self.pitch_mm)

    def read(
        self, contact: Contact | None, rng: np.random.Generator | None = None,
        before: "CountsReading | None" = None, seconds: float | None = None,
    ) -> "CountsReading":  # fmt: skip
        """The reading of a contact, of None without contact.

        rng: of the imperfections; None for none. before: the reading `seconds` earlier, None for a
        contact that has lasted long; seconds: None for the duration of a sample.
        """
        noiseless = self.noiseless(contact, self.layout)
        if rng is None:
            return CountsReading(self, contact, np.rint(noiseless).astype(np.uint16), None)
        memory = None if before is None or before.sensor.layout != self.layout else before.memory
        if memory is not None and len(memory) != len(self.flaws.memory_shares):
            memory = None  # that of another array is not used
        found = reading.read_after(
            memory, noiseless, self.layout, self.flaws, self.spec.counts, rng, seconds=seconds
        )
        return CountsReading(self, contact, *found)

    def noiseless(self, contact: Contact | None, layout: Layout) -> np.ndarray:
        """(n,) counts of a layout before rounding, without imperfections."""
        if contact is None:
            return np.zeros(layout.size)
        return self.counts_of(pad_pressure_mpa(contact, layout))

    def counts_of(self, pressure_mpa: np.ndarray) -> np.ndarray:
        """Noiseless counts of mean pressures on pads, any shape, before rounding."""
        signal = self.spec.transducer.signal(pressure_mpa)
        return np.minimum(self.spec.counts.gain * signal, self.full_scale)


@dataclass(frozen=True, eq=False)
class CountsReading(Result):
    """Counts of a taxel array."""

    sensor: TaxelArray
    contact: Contact | None
    counts: np.ndarray | None  # (n,) uint16; None before they are read
    memory: np.ndarray | None = None  # (m, n) of the array after the counts; None without a memory

    @property
    def notes(self) -> list[str]:
        """What limits the reading, in words; empty for nothing."""
        sensor, counts, full_scale = self.sensor, self.counts, self.sensor.full_scale
        if counts is None or self.contact is None or 0.05 < counts.max() / full_scale < 0.5:
            return []  # above what noise alone reaches, below any clipped reading (assumed)
        signal = sensor.noiseless(self.contact, sensor.layout).max()
        if max(counts.max(), signal) >= full_scale:
            return [f"counts are clipped at full scale, {full_scale:,.0f}"]
        if signal > 0.5:
            return []
        return ["no taxel reaches a count: the contact lies between pads, or the gain is too small"]

    @kept_property
    def tactile_image(self) -> np.ndarray:
        """(rows, columns) float32, counts: barycentric interpolation between the taxels."""
        assert self.counts is not None
        return self.sensor.phi(self.counts.astype(np.float32))

    @kept_property
    def dense_counts(self) -> np.ndarray:
        """(n,) uint16: noiseless counts at the places of the dense counts (`sensor.dense`)."""
        noiseless = self.sensor.noiseless(self.contact, self.sensor.dense)
        return np.rint(noiseless).astype(np.uint16)

    @kept_property
    def tractions(self) -> np.ndarray:
        """(3, n) float32, kPa: pressure and shear along x and y at the places of dense counts."""
        if self.contact is None:
            return np.zeros((3, self.sensor.dense.size), np.float32)
        return dense_tractions(self.sensor.dense, self.sensor.dense_table.cell_mm2, self.contact)

    @property
    def setup(self) -> dict[str, Any]:
        """What differs from the sensor's file, for JSON."""
        return {"layout": self.sensor.layout.name}

    def save(self, folder: Path, name: str, second: str) -> None:
        """Write NAME.json, tactile_image.png and tactile_picture.png. second: after these names."""
        if self.counts is None:
            return
        layout, image = self.sensor.layout, self.tactile_image
        content = {
            "layout": layout.name,
            "counts": self.counts.tolist(),
            "x_mm": layout.x_mm.tolist(),
            "y_mm": layout.y_mm.tolist(),
            "full_scale_counts": self.sensor.full_scale,
        }
        (folder / f"{name}.json").write_text(f"{json.dumps(content, indent=1)}\n")
        # 16 bits a pixel, so that the counts can be read back from the image.
        raw = Image.fromarray(np.rint(image).astype(np.uint16))
        raw.save(folder / f"tactile_image{second}.png")
        self.picture().save(folder / f"tactile_picture{second}.png")

    def picture(self) -> Image.Image:
        """The tactile image in colors up to its maximum, with the taxels."""
        image, layout = self.tactile_image, self.sensor.layout
        brightest, scale = max(float(image.max()), 1.0), self.sensor.spec.tactile_image.px_per_mm
        return colored_tactile_image(image, layout.x_mm, layout.y_mm, brightest, px_per_mm=scale)

    def without_value(self) -> "CountsReading":
        """The same without the counts, which a moving contact does not need."""
        return replace(self, counts=None)
