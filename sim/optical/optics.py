"""A unit's optics: the parameters of the baked model, and their file."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import is_zipfile

import numpy as np
from msgspec import structs, to_builtins

from t2twin.core.arrays import Record
from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write
from t2twin.core.records import REMARKS
from t2twin.sim.optical.camera import LIMITS, Camera
from t2twin.sim.optical.illumination import COSINE_TERMS, LOBE_PLACES, LOBE_TERMS
from t2twin.sim.optical.response import Noise

PLACE_MM = 8.0  # unit of length of the response's polynomials, mm: half an image of 16 mm
PLACE_DEGREE = 4  # degree of the response's polynomials in the place
PLACE_TERMS = (PLACE_DEGREE + 1) * (PLACE_DEGREE + 2) // 2

FARTHEST_LED_MM = 500.0
"""Largest distance of an LED from the gel's apex along any axis, mm (assumed: known ones are 22 mm
from its axis)."""
MAX_LEDS = 24  # limit on the LEDs (assumed: a ring of single ones)
MIN_LED_MM, MAX_LED_MM = 1e-9, 100.0  # radii of an LED's disc, mm (assumed: known ones are 1.8 mm)
MAX_RESPONSE = 1e4  # largest entry (assumed: 19 in the default optics, for a white of 1)
GAMMAS = (0.5, 4.0)  # exponent between light and grey levels (assumed: cameras have 1 to 2.4)
YOUNGS_MPA = (0.01, 10.0)  # range of the modulus (assumed: soft silicones have 0.05 to 2 MPa)
ALBEDOS = (0.01, 10.0)  # range of the albedo (assumed: worn coatings have 0.3 to 1.5)
SPECS = Path(__file__).parents[1] / "sensors" / "specs"  # bundled sensors' files and optics
NOISE_MIX, NOISE_TAPS = "noise_mix", "noise_taps"  # keys in the file, if the noise was measured


def is_bundled(source: str | None) -> bool:
    """Whether a sensor file's optics are those of a bundled sensor, by its name."""
    return source in [path.stem for path in SPECS.glob("*.npz")]


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
    """(..., places * COSINE_TERMS): one LED's light per unit of each entry of its response. cosine,
    weight: (...) of that LED. places: (..., places) polynomials."""
    entries = [weight[..., None] * cosine[..., None] ** j * places for j in range(COSINE_TERMS)]
    return np.stack(entries, axis=-1).reshape(*cosine.shape, -1)


@dataclass(frozen=True, eq=False)
class Optics(Record):
    """Parameters of the baked model (t2twin.sim.optical.image_renderer).

    Raises T2TwinError for arrays of other shapes and values out of range.
    """

    background: np.ndarray  # (rows, columns, 3) uint8, the background frame
    leds_mm: np.ndarray  # (LEDs, 3) places in the sensor frame
    sizes_mm: np.ndarray  # (LEDs,) radii of the LEDs' discs
    response: np.ndarray  # (LEDs, RGB, PLACE_TERMS, COSINE_TERMS)
    gamma: float  # exponent between light and grey levels
    camera: Camera
    noise: Noise | None = None  # of one frame, if it was measured
    young_mpa: float | None = None  # the gel's modulus, if it was fitted to forces
    lobe: np.ndarray | None = None  # (LEDs, RGB, LOBE_PLACES, LOBE_TERMS); None for no lobe
    # (rows, columns) of a worn coating, relative to a new one; None for an even one. It multiplies
    # changes of the light. The background already contains it.
    albedo: np.ndarray | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        leds = len(self.leds_mm)
        if not 1 <= leds <= MAX_LEDS:
            raise T2TwinError(f"the optics file has {leds} LEDs; it must have 1 to {MAX_LEDS}")
        sizes: dict[int | str, int] = {
            "rows": self.camera.rows,
            "columns": self.camera.columns,
            "leds": leds,
        }
        for name, (dimensions, low, high) in _LIMITS.items():
            given = getattr(self, name)
            if given is None:
                continue
            value = np.asarray(given)
            shape = tuple(sizes.get(each, each) for each in dimensions)
            if value.shape != shape:
                raise T2TwinError(
                    f"the optics file's {name} has shape {value.shape}; it must be {shape}"
                )
            if value.dtype.kind not in "fiu" or not np.isfinite(value).all():
                raise T2TwinError(f"the optics file's {name} must hold finite numbers only")
            for reached in (value.min(), value.max()):
                if not low <= reached <= high:
                    raise T2TwinError(
                        f"the optics file's {name} reaches {reached:g}; it must lie between "
                        f"{low:g} and {high:g}"
                    )
        if self.background.dtype != np.uint8:
            raise T2TwinError(
                f"the optics file's background is {self.background.dtype}; it must be uint8"
            )

    @property
    def stated(self) -> dict[str, dict[str, Any]]:
        """The values of a sensor's file that these optics determine, by table and key."""
        camera = structs.asdict(self.camera)
        if self.noise is not None:
            camera["noise_grey"] = self.noise.grey
        gel = {} if self.young_mpa is None else {"gel": {"young_mpa": self.young_mpa}}
        return {"camera": camera, "light": {"gamma": self.gamma}, **gel}

    def save(self, path: Path) -> None:
        """Write as .npz, atomically. Raises T2TwinError where it cannot be written."""
        values = {name: getattr(self, name) for name in _LIMITS}
        values |= {
            name: value for name, value in to_builtins(self.camera).items() if name in LIMITS
        }
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
            if not is_zipfile(path):
                raise T2TwinError("it is no NPZ file")
            with np.load(path, allow_pickle=False) as file:
                known = {*_LIMITS, *LIMITS, NOISE_MIX, NOISE_TAPS, *REMARKS}
                if unknown := sorted({*file.files} - known):
                    raise T2TwinError(f"its {unknown[0]} is not read")
                values: dict[str, Any] = {
                    name: file[name] if dimensions else float(file[name])
                    for name, (dimensions, _, _) in _LIMITS.items()
                    if name in file
                }
                rows, columns, _ = file["background"].shape
                seen = {name: float(file[name]) for name in LIMITS if name in file}
                if NOISE_MIX in file or NOISE_TAPS in file:
                    values["noise"] = Noise(file[NOISE_MIX], file[NOISE_TAPS])
                return cls(camera=Camera(rows, columns, **seen), **values)
        except Exception as error:  # NumPy raises many types for damaged files
            reason = str(error).rstrip(".")
            raise T2TwinError(
                f"{path} is not an optics file ({reason}); `t2twin calibrate` writes one"
            ) from error


_LIMITS: dict[str, tuple[tuple[int | str, ...], float, float]] = {
    "background": (("rows", "columns", 3), 0, 255),
    "leds_mm": (("leds", 3), -FARTHEST_LED_MM, FARTHEST_LED_MM),
    "sizes_mm": (("leds",), MIN_LED_MM, MAX_LED_MM),
    "response": (("leds", 3, PLACE_TERMS, COSINE_TERMS), -MAX_RESPONSE, MAX_RESPONSE),
    "gamma": ((), *GAMMAS),
    "young_mpa": ((), *YOUNGS_MPA),
    "lobe": (("leds", 3, LOBE_PLACES, LOBE_TERMS), -MAX_RESPONSE, MAX_RESPONSE),
    "albedo": (("rows", "columns"), *ALBEDOS),
}
"""Shape, least and largest value of each field but the camera and the noise, by its key."""
