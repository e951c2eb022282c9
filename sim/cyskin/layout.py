"""Where the taxels lie: a layout is data, one JSON or CSV file."""

import csv
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from t2twin.primitives_cad.errors import T2TwinError

LAYOUTS = Path(__file__).parent / "layouts"
DEFAULT_LAYOUT = "cyskin-20"

PAD_DIAMETER_MM = 4.0
"""Diameter of a taxel's pad, mm (assumed), where a layout names none."""

CLOSEST_MM = 0.1
"""Taxels nearer than this are one place, mm."""


@dataclass(frozen=True)
class Layout:
    """Taxels in the sensor frame.

    x_mm, y_mm: (n,) centres. pad_diameter_mm: (n,).
    """

    name: str
    x_mm: np.ndarray
    y_mm: np.ndarray
    pad_diameter_mm: np.ndarray

    def __post_init__(self) -> None:
        n = self.x_mm.size
        if n < 3:
            raise T2TwinError(f"layout {self.name} has {n} taxels; it needs at least 3")
        values = np.concatenate([self.x_mm, self.y_mm, self.pad_diameter_mm])
        if not np.isfinite(values).all() or (self.pad_diameter_mm <= 0).any():
            raise T2TwinError(
                f"layout {self.name} has a place or pad size that is no positive finite number"
            )
        apart = np.hypot(*(v[:, None] - v[None] for v in (self.x_mm, self.y_mm)))
        apart[np.diag_indices(n)] = np.inf
        if apart.min() < CLOSEST_MM:
            first, second = np.unravel_index(apart.argmin(), apart.shape)
            raise T2TwinError(
                f"layout {self.name} has taxels {first} and {second} in one place; they must be "
                f"at least {CLOSEST_MM:g} mm apart"
            )

    @property
    def size(self) -> int:
        return self.x_mm.size


def load_layout(source: str | Path = DEFAULT_LAYOUT) -> Layout:
    """A layout by its name, or from a user's JSON or CSV file.

    JSON: {"taxels": [{"x_mm": ..., "y_mm": ..., "pad_diameter_mm": ...}, ...]}; CSV: columns x_mm,
    y_mm and, if wanted, pad_diameter_mm. Raises T2TwinError for anything else.
    """
    path = LAYOUTS / f"{source}.json"
    if not path.exists():
        path = Path(source)
    if not path.is_file():
        known = ", ".join(sorted(p.stem for p in LAYOUTS.glob("*.json")))
        raise T2TwinError(
            f"no taxel layout {source}; known are {known}, or a path to .json or .csv"
        )
    try:
        if path.suffix.lower() == ".csv":
            with path.open(newline="") as file:
                rows = list(csv.DictReader(file))
        else:
            rows = json.loads(path.read_text())["taxels"]
        columns = [
            np.array([_number(row.get(key), default) for row in rows])
            for key, default in (
                ("x_mm", "missing"),
                ("y_mm", "missing"),
                ("pad_diameter_mm", PAD_DIAMETER_MM),
            )
        ]
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise T2TwinError(
            f"{path} is no taxel layout; it needs numbers x_mm and y_mm for every taxel, as JSON "
            'under "taxels" or as CSV columns'
        ) from error
    return Layout(path.stem, *columns)


def _number(value: object, default: object) -> float:
    """A cell of a layout; what is left empty is the default, and what is no number an error."""
    return float(str(default if value is None or value == "" else value))
