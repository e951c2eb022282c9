"""The record of a taxel array: pressure sensors under a soft cover.

The sensor frame is that of t2twin.sim.optical.spec, so that a press is given once for two sensors.
"""

from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta, Struct

from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.spec import LayerTable, MountTable, SensorName
from t2twin.sim.taxels.dense import DenseTable
from t2twin.sim.taxels.layout import (
    LARGEST_PAD_MM,
    MAX_TAXELS,
    SQUARE_TO_ROUND,
    Layout,
    grid_layout,
    load_layout,
)
from t2twin.sim.taxels.reading import Imperfections
from t2twin.sim.taxels.transducer import CountsTable, TransducerTable

KIND = "taxel-array"

Line = Annotated[int, Meta(ge=1, le=MAX_TAXELS)]


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
        float | None, Meta(description="distance of neighboring taxels of the grid")
    ] = None
    pad: Annotated[
        Literal["round", "square"] | None, Meta(description="shape of the grid's pads")
    ] = None
    pad_mm: Annotated[float | None, Meta(description="diameter or side of the grid's pads")] = None

    def __post_init__(self) -> None:
        names = ("rows", "columns", "pitch_mm", "pad", "pad_mm")
        given = [name for name in names if getattr(self, name) is not None]
        if (self.file is None) != (len(given) == len(names)) or (self.file and given):
            raise T2TwinError(f"expected file, or all of {', '.join(names)}")
        for name, most in (("pitch_mm", LARGEST_PAD_MM), ("pad_mm", LARGEST_PAD_MM)):
            value = getattr(self, name)
            if value is not None and not 0.05 <= value <= most:
                raise T2TwinError(f"{name} is {value:g}; expected 0.05 to {most:g}")

    def layout(self, name: str, folder: str) -> Layout:
        """The layout. folder: of the sensor's file. Raises T2TwinError as load_layout does."""
        if self.file is not None:
            return load_layout(self.file, Path(folder))
        assert self.rows and self.columns and self.pitch_mm and self.pad_mm
        pad_mm = self.pad_mm * (SQUARE_TO_ROUND if self.pad == "square" else 1.0)
        return grid_layout(name, self.rows, self.columns, self.pitch_mm, float(pad_mm))


class TactileImageTable(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The tactile image, which interpolates the counts."""

    rows: Annotated[int, Meta(ge=8, le=2000, description="rows, along y")]
    columns: Annotated[int, Meta(ge=8, le=2000, description="columns, along x")]
    px_per_mm: Annotated[float, Meta(gt=0.0, le=100.0, description="scale; pixels are square")]


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
