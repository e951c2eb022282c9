"""Taxel layouts, which are JSON or CSV files."""

from dataclasses import dataclass, fields
from functools import lru_cache
from pathlib import Path

import numpy as np

from t2twin.core import arguments
from t2twin.core.arrays import Record
from t2twin.core.errors import T2TwinError, warn
from t2twin.core.records import REMARKS, check_names, convert, read_json
from t2twin.sim.tables import read_rows

# Diameter of the disc with the area of a square, over its side. A square pad is computed as this
# disc (assumed: the cover blurs the difference).
SQUARE_TO_ROUND = 2.0 / np.sqrt(np.pi)
LAYOUTS = Path(__file__).parent / "layouts"
DEFAULT_LAYOUT = "cyskin-20"

PAD_DIAMETER_MM = 4.0  # default diameter of a taxel's pad, mm (assumed)
LARGEST_PAD_MM = 50.0  # largest diameter of a pad, mm (assumed: more than the cover is wide)
CLOSEST_MM = 0.1  # least distance between taxels, mm
# Limits on the taxels of a layout (assumed: more than any published array of this size)
MIN_TAXELS, MAX_TAXELS = 3, 2000


@dataclass(frozen=True)
class _Taxel:
    """One taxel in a layout file."""

    x_mm: float
    y_mm: float
    pad_diameter_mm: float = PAD_DIAMETER_MM


@dataclass(frozen=True, eq=False)
class Layout(Record):
    """Positions and pad diameters of taxels in the sensor frame.

    x_mm, y_mm, pad_diameter_mm: (n,). Raises T2TwinError for fewer than 3 or more than MAX_TAXELS
    taxels, for values that are not finite numbers, and for taxels closer than CLOSEST_MM.
    """

    name: str
    x_mm: np.ndarray
    y_mm: np.ndarray
    pad_diameter_mm: np.ndarray

    def __repr__(self) -> str:
        return f"Layout({self.name!r}, {self.x_mm.size} taxels)"

    def __post_init__(self) -> None:
        arguments.text(self.name, "the layout's name")
        size = arguments.vector(self.x_mm, f"x_mm of layout {self.name}").size
        for name in ("x_mm", "y_mm", "pad_diameter_mm"):
            values = arguments.vector(getattr(self, name), f"{name} of layout {self.name}", size)
            vars(self)[name] = values
        super().__post_init__()
        if not MIN_TAXELS <= size <= MAX_TAXELS:
            raise T2TwinError(
                f"layout {self.name} has {size} taxels; expected at least {MIN_TAXELS}, at most "
                f"{MAX_TAXELS}"
            )
        if not 0 < self.pad_diameter_mm.min() <= self.pad_diameter_mm.max() <= LARGEST_PAD_MM:
            raise T2TwinError(
                f"layout {self.name} has a pad that is not larger than 0 and at most "
                f"{LARGEST_PAD_MM:g} mm"
            )
        apart = self.distances_mm(self) + np.diag(np.full(size, np.inf))
        if apart.min() < CLOSEST_MM:
            first, second = np.unravel_index(apart.argmin(), apart.shape)
            raise T2TwinError(
                f"layout {self.name} has taxels {first} and {second} in one place; they must be "
                f"at least {CLOSEST_MM:g} mm apart"
            )

    def __eq__(self, other: object) -> bool:
        """Whether the taxels are the same; names may differ."""
        return isinstance(other, Layout) and self._content == other._content

    def __hash__(self) -> int:
        return hash(self._content)

    @property
    def _content(self) -> tuple[bytes, ...]:
        return self.x_mm.tobytes(), self.y_mm.tobytes(), self.pad_diameter_mm.tobytes()

    @property
    def size(self) -> int:
        return self.x_mm.size

    def distances_mm(self, other: "Layout") -> np.ndarray:
        """(n, m) distances from the taxels of another layout, mm."""
        return np.hypot(self.x_mm[:, None] - other.x_mm, self.y_mm[:, None] - other.y_mm)


@lru_cache(maxsize=64)  # warns once of each
def check_layout(layout: Layout) -> None:
    """Raises T2TwinError for a user's taxels on one line, and warns of pads that would overlap even
    as squares of their area, which a file may have."""
    places = np.column_stack([layout.x_mm, layout.y_mm])
    across = np.linalg.svd(places - places.mean(axis=0), full_matrices=False)[2][1]
    if np.ptp(places @ across) < CLOSEST_MM:
        raise T2TwinError(f"the taxels of layout {layout.name} lie on one line; move one off it")
    sizes_mm = layout.pad_diameter_mm / SQUARE_TO_ROUND
    free_mm = layout.distances_mm(layout) - (sizes_mm[:, None] + sizes_mm) / 2
    np.fill_diagonal(free_mm, np.inf)
    if free_mm.min() < -CLOSEST_MM:
        one, other = np.unravel_index(free_mm.argmin(), free_mm.shape)
        warn(
            f"the pads of taxels {one} and {other} of layout {layout.name} overlap; each count is "
            "computed as if the other pad were not there; the pads are probably too large"
        )


def layout_names() -> tuple[str, ...]:
    """Names of the bundled layouts."""
    return tuple(sorted(path.stem for path in LAYOUTS.glob("*.json")))


def load_layout(source: str | Path | Layout = DEFAULT_LAYOUT, folder: Path | None = None) -> Layout:
    """A layout by its name, from a JSON or CSV file, or as it is, checked.

    source: its name, its path, or a Layout. folder: that a relative path starts from; None for the
    working directory.
    JSON: {"taxels": [{"x_mm": ..., "y_mm": ..., "pad_diameter_mm": ...}, ...]}, with REMARKS; CSV:
    columns x_mm, y_mm and optionally pad_diameter_mm. Raises T2TwinError for anything else, and
    warns, as check_layout.
    """
    if isinstance(source, Layout):
        check_layout(source)
        return source
    path = LAYOUTS / f"{arguments.path(source, 'layout')}.json"
    base = Path() if folder is None else arguments.path(folder, "folder")
    if not path.exists():
        path = base / source
    if not path.is_file():
        raise T2TwinError(
            f"no taxel layout {source}; known are {', '.join(layout_names())}, or a path to .json "
            "or .csv"
        )
    names = [field.name for field in fields(_Taxel)]
    if path.suffix.lower() == ".csv":
        rows = read_rows(path, _Taxel)
    elif path.suffix.lower() != ".json":
        raise T2TwinError(
            f"{path} is no layout; expected a .csv file with the columns {', '.join(names)}, or a "
            ".json file with a list of taxels that have these keys"
        )
    else:
        content = read_json(path, dict)
        # unknown keys would have no effect, such as a gain
        check_names(content, ["taxels", "format", *REMARKS], path, what="key")
        rows = convert(content.get("taxels"), tuple[_Taxel, ...], f"{path}, taxels")
        given = sorted({key for taxel in content["taxels"] for key in taxel})
        check_names(given, [*names, *REMARKS], f"{path}: a taxel", what="key")
    layout = Layout(path.stem, *(np.array([getattr(row, name) for row in rows]) for name in names))
    check_layout(layout)
    return layout
