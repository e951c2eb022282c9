"""The record of a taxel array: pressure sensors under a soft cover."""

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta, Struct

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.elastomer import LayerTable, MountTable, SensorName
from t2twin.sim.taxels.layout import (
    LARGEST_PAD_MM,
    MAX_TAXELS,
    SQUARE_TO_ROUND,
    Layout,
    check_layout,
    load_layout,
)

KIND = "taxel-array"

Line = Annotated[int, Meta(ge=1, le=MAX_TAXELS)]
Length = Annotated[float, Meta(ge=0.05, le=LARGEST_PAD_MM)]
Share = Annotated[float, Meta(ge=0.0, le=1.0)]
Level = Annotated[float, Meta(ge=0.0, le=65_535.0)]
Spread = Annotated[float, Meta(ge=0.0, le=5.0)]
Seconds = Annotated[float, Meta(gt=0.0, le=1e6)]
# Rising percentages of the taxels and the values at them, interpolated linearly.
Percentage = Annotated[float, Meta(ge=0.0, le=100.0)]
Percentiles = tuple[tuple[Percentage, Level], ...]
Ratios = tuple[tuple[Percentage, Annotated[float, Meta(ge=-10.0, le=10.0)]], ...]


class LayoutTable(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The taxels: a layout's name or file, or a grid of them around the sensor's axis."""

    file: Annotated[
        str | None, Meta(description="name of a bundled layout, or file beside the sensor's file")
    ] = None
    rows: Annotated[Line | None, Meta(description="taxels along y, first the smallest y")] = None
    columns: Annotated[Line | None, Meta(description="taxels along x; counts are row by row")] = (
        None
    )
    pitch_mm: Annotated[
        Length | None, Meta(description="distance of neighboring taxels of the grid")
    ] = None
    pad: Annotated[
        Literal["round", "square"] | None, Meta(description="shape of the grid's pads")
    ] = None
    pad_mm: Annotated[Length | None, Meta(description="diameter or side of the grid's pads")] = None

    def __post_init__(self) -> None:
        names = ("rows", "columns", "pitch_mm", "pad", "pad_mm")
        given = [name for name in names if getattr(self, name) is not None]
        if (self.file is None) != (len(given) == len(names)) or (self.file and given):
            raise T2TwinError(f"expected file, or all of {', '.join(names)}")

    def layout(self, name: str, folder: str) -> Layout:
        """The layout, checked. folder: of the sensor's file."""
        if self.file is not None:
            return load_layout(self.file, Path(folder))
        assert self.rows and self.columns and self.pitch_mm and self.pad_mm
        pad_mm = self.pad_mm * (SQUARE_TO_ROUND if self.pad == "square" else 1.0)
        counts = self.columns, self.rows
        x, y = ((np.arange(count) - (count - 1) / 2) * self.pitch_mm for count in counts)
        x, y = (each.ravel() for each in np.meshgrid(x, y))
        layout = Layout(name, x, y, np.full(x.size, pad_mm))
        check_layout(layout)
        return layout


class TransducerTable(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The law of a taxel.

    capacitive: strain m (1 - exp(-p / (M m))) of a dielectric of modulus M and largest strain m;
    the signal is strain / (1 - strain) (Schmitz et al. 2011). piezoresistive: a p / (1 + b p).
    """

    law: Annotated[Literal["capacitive", "piezoresistive"], Meta(description="law of the signal")]
    modulus_mpa: Annotated[
        Annotated[float, Meta(ge=0.001, le=1e3)] | None,
        Meta(description="capacitive: small-strain modulus of the dielectric"),
    ] = None
    largest_strain: Annotated[
        Annotated[float, Meta(ge=0.01, le=0.95)] | None,
        Meta(description="capacitive: largest strain of the dielectric"),
    ] = None
    a_per_kpa: Annotated[
        Annotated[float, Meta(ge=1e-6, le=1e3)] | None,
        Meta(description="piezoresistive: slope of the conductance at no pressure"),
    ] = None
    b_per_kpa: Annotated[
        Annotated[float, Meta(ge=0.0, le=1e3)] | None,
        Meta(description="piezoresistive: pressure that halves the slope, inverted"),
    ] = None

    def __post_init__(self) -> None:
        capacitive = "modulus_mpa", "largest_strain"
        for name in (*capacitive, "a_per_kpa", "b_per_kpa"):
            is_own = (name in capacitive) == (self.law == "capacitive")
            if is_own == (getattr(self, name) is None):
                way = "needed by" if is_own else "not of"
                raise T2TwinError(f"{name} is {way} the law {self.law}")

    def signal(self, pressure_mpa: np.ndarray) -> np.ndarray:
        """The signal of pressures, same shape; 0 where there is none."""
        pressed = np.maximum(pressure_mpa, 0.0)
        if self.law == "piezoresistive":
            assert self.a_per_kpa is not None and self.b_per_kpa is not None
            pressed = 1e3 * pressed
            return self.a_per_kpa * pressed / (1.0 + self.b_per_kpa * pressed)
        assert self.modulus_mpa is not None and self.largest_strain is not None
        limit = self.largest_strain
        strain = -limit * np.expm1(-pressed / (self.modulus_mpa * limit))
        return strain / (1.0 - strain)


class CountsTable(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The counts that are read."""

    gain: Annotated[float, Meta(gt=0.0, le=1e9, description="counts for a signal of 1")]
    full_scale: Annotated[
        int, Meta(ge=2, le=2**16 - 1, description="count at which a taxel saturates")
    ]
    readings: Annotated[
        int, Meta(ge=1, le=10_000, description="readings averaged for the counts of a press")
    ] = 1
    rate_hz: Annotated[
        Annotated[float, Meta(ge=1e-4, le=1e4)] | None,
        Meta(description="readings per second, for imperfections with a memory"),
    ] = None


class TactileImageTable(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The tactile image, which interpolates the counts."""

    rows: Annotated[int, Meta(ge=8, le=2000, description="rows, along y")]
    columns: Annotated[int, Meta(ge=8, le=2000, description="columns, along x")]
    px_per_mm: Annotated[float, Meta(gt=0.0, le=100.0, description="scale; pixels are square")]


class DenseTable(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The grid of the dense counts."""

    spacing_mm: Annotated[
        float, Meta(ge=0.2, le=50.0, description="distance of neighboring places")
    ]
    grid: Annotated[
        Literal["triangular", "square"], Meta(description="triangular or square grid")
    ] = "triangular"

    @property
    def cell_mm2(self) -> float:
        """Area of the surface for each place."""
        return float(self.spacing_mm**2 * (np.sqrt(0.75) if self.grid == "triangular" else 1.0))


class Imperfections(Struct, frozen=True, forbid_unknown_fields=True):
    """Deviations of an array from an ideal one. Zero, or an empty tuple, disables a term.

    Readings without contact are independent, normal, and clipped to 0. A taxel has the same rank in
    noise_counts and offset_counts, and another in offset_ratios. Noise under load at a level s has
    also the deviation a (1 - exp(-s / b)). The sum of m exp(-t / T) over memory_shares m and
    memory_s T remains after release.
    """

    white_counts: Level = 0.0  # standard deviation of the noise of each reading
    drift_share: Share = 0.0  # of taxels with a wandering baseline
    drift_counts: Level = 0.0  # its standard deviation
    hysteresis: Share = 0.0  # largest share of a count that is missing after loading (assumed)
    crosstalk: Share = 0.0  # of each nearest neighbor's count that is added (assumed)
    line_crosstalk: Share = 0.0  # of those in its row and column: resistive matrix (assumed)
    gain_spread: Share = 0.0  # deviation of the gains around 1, fixed for an array (assumed)
    dead: tuple[int, ...] = ()  # indices of taxels that read 0
    noise_counts: Percentiles = ()  # deviation of a reading before it is clipped to 0
    offset_counts: Percentiles = ()  # its mean without contact, to which
    offset_ratios: Ratios = ()  # these times the deviation are added
    load_noise_counts: Level = 0.0  # median of a
    load_noise_spread: Spread = 0.0  # deviation of the logarithm of a over the taxels
    load_noise_level_counts: Annotated[float, Meta(gt=0.0, le=65_535.0)] = 1.0  # b
    memory_shares: tuple[Share, ...] = ()  # medians over the taxels
    memory_s: tuple[Seconds, ...] = ()
    memory_rise_s: Seconds = 1.0  # with which the memory follows a rising level
    memory_spread: Spread = 0.0  # deviation of the logarithm of the taxels' shares

    def __post_init__(self) -> None:
        for name in ("noise_counts", "offset_counts", "offset_ratios"):
            percentages, values = ([each[n] for each in getattr(self, name)] for n in (0, 1))
            if percentages != sorted(set(percentages)) or values != sorted(values):
                raise T2TwinError(f"{name} must have rising percentages, and no falling values")
        if len(self.memory_shares) != len(self.memory_s):
            raise T2TwinError("memory_shares and memory_s must have one value for each term")

    def check_dead(self, taxels: int, name: str = "dead taxel") -> None:
        """Raises T2TwinError for a dead taxel that is not one of this number."""
        for index in self.dead:
            arguments.whole_number(index, name, 0, taxels - 1)


class TaxelArraySpec(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """A taxel array's file."""

    kind: Annotated[Literal["taxel-array"], Meta(description="kind of the sensor")]
    name: SensorName
    cover: Annotated[LayerTable, Meta(description="the cover")]
    layout: Annotated[LayoutTable, Meta(description="the taxels")]
    transducer: Annotated[TransducerTable, Meta(description="the law of a taxel")]
    counts: Annotated[CountsTable, Meta(description="the counts that are read")]
    tactile_image: Annotated[TactileImageTable, Meta(description="the tactile image")]
    mount: Annotated[MountTable, Meta(description="the sensor as a body")]
    dense: Annotated[DenseTable | None, Meta(description="the grid of the dense counts")] = None
    imperfections: Annotated[
        dict[str, Imperfections], Meta(description="imperfections by name, one table each")
    ] = {}
    about: Annotated[str | None, Meta(description="remark, which is not read")] = None

    def __post_init__(self) -> None:
        for name, flaws in self.imperfections.items():
            if flaws.memory_s and self.counts.rate_hz is None:
                raise T2TwinError(f"imperfections.{name} has a memory, which needs counts.rate_hz")
