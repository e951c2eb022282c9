"""A unit's optics: the parameters of the baked model, and their file."""

from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import Any
from zipfile import is_zipfile

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write
from t2twin.core.records import REMARKS
from t2twin.sim.optical.camera import LENGTHS, MAX_MISALIGNMENT, Camera
from t2twin.sim.optical.illumination import COSINE_TERMS, LOBE_PLACES, LOBE_TERMS
from t2twin.sim.optical.response import Noise

PLACE_MM = 8.0  # unit of length of the response's polynomials, mm: half an image of 16 mm
PLACE_DEGREE = 4  # degree of the response's polynomials in the place
PLACE_TERMS = (PLACE_DEGREE + 1) * (PLACE_DEGREE + 2) // 2

FARTHEST_LED_MM = 500.0
"""Largest distance of an LED from the gel's apex along any axis, mm (assumed: known ones are 22 mm
from its axis)."""
MAX_LEDS = 24  # limit on the LEDs (assumed: a ring of single ones)
LARGEST_LED_MM = 100.0  # largest radius of an LED's disc, mm (assumed: known ones are 1.8 mm)
MAX_RESPONSE = 1e4
"""Largest entry of the response (assumed: 19 in the default optics, for a white of 1)."""
GAMMAS = (0.5, 4.0)
"""Range of the exponent between light and grey levels (assumed: cameras have 1 to 2.4)."""
YOUNGS_MPA = (0.01, 10.0)  # range of the modulus (assumed: soft silicones have 0.05 to 2 MPa)
ALBEDOS = (0.01, 10.0)  # range of the albedo (assumed: worn coatings have 0.3 to 1.5)
NOISE_MIX, NOISE_TAPS = "noise_mix", "noise_taps"
"""Keys of the noise in the file, present if it was measured."""


def place_terms(x_mm: np.ndarray, y_mm: np.ndarray, degree: int = PLACE_DEGREE) -> np.ndarray:
    """(..., terms): monomials of x and y in units of PLACE_MM, by rising degree; PLACE_TERMS of
    them by default."""
    x, y = ([(values / PLACE_MM) ** n for n in range(degree + 1)] for values in (x_mm, y_mm))
    return np.stack(
        [x[total - power] * y[power] for total in range(degree + 1) for power in range(total + 1)],
        axis=-1,
    )


def place_degrees(degree: int = PLACE_DEGREE) -> np.ndarray:
    """(terms,) degree of each of place_terms."""
    return np.repeat(np.arange(degree + 1), np.arange(1, degree + 2))


def led_columns(cosine: np.ndarray, weight: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(..., places * COSINE_TERMS): one LED's light per unit of each entry of its response.

    cosine, weight: (...) of that LED. places: (..., places) polynomials.
    """
    entries = [weight[..., None] * cosine[..., None] ** j * places for j in range(COSINE_TERMS)]
    return np.stack(entries, axis=-1).reshape(*cosine.shape, -1)


@dataclass(frozen=True)
class Optics:
    """Parameters of the baked model (t2twin.sim.optical.image_renderer).

    background: (rows, columns, 3) uint8, the background frame.
    leds_mm: (LEDs, 3) places of the LEDs in the sensor frame. sizes_mm: (LEDs,) radii of their
    discs. response: (LEDs, RGB, PLACE_TERMS, COSINE_TERMS).
    lobe: (LEDs, RGB, LOBE_PLACES, LOBE_TERMS), optional in the file; None for no lobe.
    gamma: exponent between light and grey levels.
    scale_px_per_mm, distance_mm, shift_x_px, shift_y_px, tilt_x_deg, tilt_y_deg: the camera. The
    last four are optional in the file and default to 0.
    noise: of one frame, if it was measured; noise_mix and noise_taps in the file.
    young_mpa: the gel's modulus, if it was fitted to forces.
    albedo: (rows, columns) of a worn coating, relative to a new one; None for an even one. It
    multiplies changes of the light. The background already contains it.
    Raises T2TwinError for arrays of other shapes and values out of range.
    """

    background: np.ndarray
    leds_mm: np.ndarray
    sizes_mm: np.ndarray
    response: np.ndarray
    gamma: float
    scale_px_per_mm: float
    distance_mm: float
    shift_x_px: float = 0.0
    shift_y_px: float = 0.0
    tilt_x_deg: float = 0.0
    tilt_y_deg: float = 0.0
    noise: Noise | None = None
    young_mpa: float | None = None
    lobe: np.ndarray | None = None
    albedo: np.ndarray | None = None

    def __post_init__(self) -> None:
        sizes = _sizes(np.asarray(self.background), np.asarray(self.leds_mm))
        for name, (dimensions, low, high) in _LIMITS.items():
            given = getattr(self, name)
            if given is None:
                continue
            value, key = np.asarray(given), _KEYS[name]
            shape = tuple(sizes.get(each, each) for each in dimensions)
            if value.shape != shape:
                raise T2TwinError(
                    f"the optics file's {key} has shape {value.shape}; it must be {shape}"
                )
            is_scalar = shape == ()
            if value.dtype.kind not in "fiu" or not (is_scalar or np.isfinite(value).all()):
                raise T2TwinError(f"the optics file's {key} must hold finite numbers only")
            for reached in (value.min(), value.max()):
                if not low <= reached <= high:  # nor is nan
                    raise T2TwinError(
                        f"the optics file's {key} reaches {reached:g}; it must lie between "
                        f"{low:g} and {high:g}"
                    )
        if self.background.dtype != np.uint8:
            raise T2TwinError(
                f"the optics file's background is {self.background.dtype}; it must be uint8"
            )
        if not (np.asarray(self.sizes_mm) > 0).all():
            raise T2TwinError("the optics file's sizes_mm must be positive")

    @property
    def camera(self) -> Camera:
        rows, columns = self.background.shape[:2]
        names = (*LENGTHS, *MAX_MISALIGNMENT)
        return Camera(rows, columns, **{name: getattr(self, name) for name in names})

    def save(self, path: Path) -> None:
        """Write as .npz, atomically. Raises T2TwinError where it cannot be written."""
        values = {key: getattr(self, name) for name, key in _KEYS.items()}
        if not any(values[name] for name in MAX_MISALIGNMENT):
            values = {key: value for key, value in values.items() if key not in MAX_MISALIGNMENT}
        if self.noise is not None:
            values |= {NOISE_MIX: self.noise.mix, NOISE_TAPS: self.noise.taps}
        content = {key: value for key, value in values.items() if value is not None}
        with atomic_write(path) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, **content)

    @classmethod
    def load(cls, path: Path | str) -> "Optics":
        """Read a file of save. Raises T2TwinError for any other file."""
        if not Path(path).is_file():
            raise T2TwinError(f"{path} does not exist; `t2twin calibrate` writes an optics file")
        try:
            return cls(**_read(path))
        except Exception as error:  # NumPy raises many types for damaged files
            reason = str(error).rstrip(".")
            raise T2TwinError(
                f"{path} is not an optics file ({reason}); `t2twin calibrate` writes one"
            ) from error


def _read(path: Path | str) -> dict[str, Any]:
    """Values of the fields by name. Raises T2TwinError, or any error of NumPy."""
    if not is_zipfile(path):
        raise T2TwinError("it is not an .npz file")
    with np.load(path, allow_pickle=False) as file:
        if unknown := sorted({*file.files} - {*_KEYS.values(), NOISE_MIX, NOISE_TAPS, *REMARKS}):
            raise T2TwinError(f"its {unknown[0]} is not read")
        for field in fields(Optics):
            if field.default is MISSING and _KEYS[field.name] not in file:
                raise T2TwinError(f"its {_KEYS[field.name]} is missing")
        values: dict[str, Any] = {
            name: file[key] if _LIMITS[name][0] else float(file[key])
            for name, key in _KEYS.items()
            if key in file
        }
        if NOISE_MIX in file or NOISE_TAPS in file:
            values["noise"] = Noise(file[NOISE_MIX], file[NOISE_TAPS])
    return values


def _sizes(background: np.ndarray, leds_mm: np.ndarray) -> dict[int | str, int]:
    """Rows, columns and number of LEDs. Raises T2TwinError for arrays of other dimensions."""
    if background.ndim != 3 or 0 in background.shape or any(n % 2 for n in background.shape[:2]):
        raise T2TwinError(
            f"the optics file's background has shape {background.shape}; it must be (rows, "
            "columns, 3), of even numbers"
        )
    leds = leds_mm.shape[0] if leds_mm.ndim else 0
    if not 1 <= leds <= MAX_LEDS:
        raise T2TwinError(f"the optics file has {leds} LEDs; it must have 1 to {MAX_LEDS}")
    return {"rows": background.shape[0], "columns": background.shape[1], "leds": leds}


_LIMITS: dict[str, tuple[tuple[int | str, ...], float, float]] = {
    "background": (("rows", "columns", 3), 0, 255),
    "leds_mm": (("leds", 3), -FARTHEST_LED_MM, FARTHEST_LED_MM),
    "sizes_mm": (("leds",), 0.0, LARGEST_LED_MM),
    "response": (("leds", 3, PLACE_TERMS, COSINE_TERMS), -MAX_RESPONSE, MAX_RESPONSE),
    "gamma": ((), *GAMMAS),
    **{name: ((), low, high) for name, (low, high) in LENGTHS.items()},
    **{name: ((), -limit, limit) for name, limit in MAX_MISALIGNMENT.items()},
    "young_mpa": ((), *YOUNGS_MPA),
    "lobe": (("leds", 3, LOBE_PLACES, LOBE_TERMS), -MAX_RESPONSE, MAX_RESPONSE),
    "albedo": (("rows", "columns"), *ALBEDOS),
}
"""Shape, least and largest value of each field but the noise."""
_KEYS = {name: name for name in _LIMITS} | {"leds_mm": "lamps_mm"}
"""Key of each field in the file; the LEDs' places have the key of the first optics files."""
