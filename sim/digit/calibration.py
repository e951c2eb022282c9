"""One unit's optics as data: what the baked model needs, in a file."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from primitives_cad.errors import T2TwinError
from sim.digit.camera import COLUMNS, ROWS, Camera
from sim.digit.kernels import COSINE_TERMS

DEFAULT_PATH = Path(__file__).with_name("default_calibration.npz")
"""The shipped calibration; written by sim.digit.bake."""
PLACE_MM = 8.0
"""Length by which x and y are divided in the response's polynomials, mm: half the picture."""
PLACE_DEGREE = 4
"""Degree of the response's polynomials in the place."""
PLACE_TERMS = (PLACE_DEGREE + 1) * (PLACE_DEGREE + 2) // 2


def place_terms(x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
    """(..., PLACE_TERMS): monomials of x and y over PLACE_MM, by rising degree."""
    x, y = x_mm / PLACE_MM, y_mm / PLACE_MM
    return np.stack(
        [
            x ** (degree - power) * y**power
            for degree in range(PLACE_DEGREE + 1)
            for power in range(degree + 1)
        ],
        axis=-1,
    )


@dataclass(frozen=True)
class Calibration:
    """See sim.digit.baked for the model that these belong to.

    background: (ROWS, COLUMNS, 3) uint8, the untouched gel.
    lamps_mm: (3, 3) places of the lamps in the sensor frame. size_mm: radius of their discs.
    response: (3 lamps, PLACE_TERMS, COSINE_TERMS). colours: (3 lamps, RGB).
    scale_px_per_mm, distance_mm: the camera.
    Raises T2TwinError for arrays of other shapes.
    """

    background: np.ndarray
    lamps_mm: np.ndarray
    size_mm: float
    response: np.ndarray
    colours: np.ndarray
    scale_px_per_mm: float
    distance_mm: float

    def __post_init__(self) -> None:
        for name, shape in (
            ("background", (ROWS, COLUMNS, 3)),
            ("lamps_mm", (3, 3)),
            ("response", (3, PLACE_TERMS, COSINE_TERMS)),
            ("colours", (3, 3)),
        ):
            if np.shape(getattr(self, name)) != shape:
                raise T2TwinError(
                    f"the calibration's {name} has shape {np.shape(getattr(self, name))}; "
                    f"it must be {shape}"
                )
        if self.background.dtype != np.uint8:
            raise T2TwinError(
                f"the calibration's background is {self.background.dtype}; it must be uint8"
            )
        if self.size_mm <= 0:
            raise T2TwinError("the calibration's size_mm must be positive")

    @property
    def camera(self) -> Camera:
        return Camera(self.scale_px_per_mm, self.distance_mm)

    def save(self, path: Path) -> None:
        """Write as .npz, whole or not at all."""
        part = path.with_name(path.name + ".part")
        with part.open("wb") as file:
            np.savez_compressed(file, **{name: getattr(self, name) for name in _FIELDS})
        part.replace(path)

    @classmethod
    def load(cls, path: Path | str = DEFAULT_PATH) -> "Calibration":
        """Read what save wrote. Raises T2TwinError if it is not such a file."""
        try:
            with np.load(path, allow_pickle=False) as file:
                values = {name: file[name] for name in _FIELDS}
        except (OSError, ValueError, KeyError) as error:
            raise T2TwinError(
                f"{path} is not a calibration ({error}); `t2twin calibrate` writes one"
            ) from error
        for name in ("size_mm", "scale_px_per_mm", "distance_mm"):
            values[name] = float(values[name])
        return cls(**values)


_FIELDS = tuple(Calibration.__dataclass_fields__)
