"""Reads sensor files, TOML: bundled ones by name, a user's own by path.

`extends` names another sensor, whose values hold where the file has none. Its ranges of units move
with the camera's values.
"""

from functools import cache
from pathlib import Path
from typing import Any

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.records import convert, nearest, read_toml
from t2twin.sim.optical.gel_camera import GelCamera
from t2twin.sim.optical.spec import KIND as GEL_CAMERA
from t2twin.sim.optical.spec import GelCameraSpec
from t2twin.sim.sensors.defaults import ALIASES
from t2twin.sim.taxels.spec import KIND as TAXEL_ARRAY
from t2twin.sim.taxels.spec import TaxelArraySpec
from t2twin.sim.taxels.taxel_array import TaxelArray

Spec = GelCameraSpec | TaxelArraySpec
Sensor = GelCamera | TaxelArray

SPECS = Path(__file__).parent / "specs"
KINDS: dict[str, tuple[type[Spec], type[Sensor]]] = {
    GEL_CAMERA: (GelCameraSpec, GelCamera),
    TAXEL_ARRAY: (TaxelArraySpec, TaxelArray),
}
"""The record and the simulated sensor of each kind."""


def bundled_sensors() -> tuple[str, ...]:
    """Names of the bundled sensors."""
    return tuple(sorted(path.stem for path in SPECS.glob("*.toml")))


def path_of(source: str | Path) -> Path:
    """The file of a sensor: a bundled name, or a path to a .toml file. Raises T2TwinError."""
    name = ALIASES.get(str(source), str(source))
    if name in bundled_sensors():
        return SPECS / f"{name}.toml"
    path = Path(arguments.path(source, "sensor"))
    if path.suffix != ".toml":
        near = nearest(name, bundled_sensors())
        meant = f"; did you mean {near}?" if near else ""
        raise T2TwinError(
            f"there is no sensor {str(source)!r}; allowed are {', '.join(bundled_sensors())} and "
            f".toml files{meant}"
        )
    return path


def load_sensor(source: str | Path | Sensor) -> Sensor:
    """A sensor by its name or from a file; a sensor is returned unchanged.

    Raises T2TwinError for an unknown name, an unreadable file, and values that are missing, unknown
    or not allowed.
    """
    if isinstance(source, Sensor):
        return source
    path = path_of(source)
    return _bundled(path) if path.parent == SPECS else _read(path)


def _read(path: Path) -> Sensor:
    content, folder = _content(path, ())
    return sensor_of(spec_of(content, path), str(folder), path)


_bundled = cache(_read)


def sensor_of(spec: Spec, folder: str, source: object) -> Sensor:
    """The simulated sensor of a record. folder: of its file; source: for messages."""
    try:
        return KINDS[spec.kind][1](spec, folder)  # pyright: ignore[reportArgumentType]
    except T2TwinError as error:
        raise T2TwinError(f"{source}: {error}") from None


def _content(path: Path, extended: tuple[Path, ...]) -> tuple[dict[str, Any], Path]:
    """The values of a file over those of the file that it extends, and the folder for its paths."""
    content = read_toml(path)
    extends = content.pop("extends", None)
    if extends is None:
        return content, path.parent
    if path.resolve() in extended:
        raise T2TwinError(f"{path} extends itself; remove one `extends`")
    name = arguments.text(extends, f"{path}: extends")
    other = path_of(path.parent / name if name.endswith(".toml") else name)
    base, folder = _content(other, (*extended, path.resolve()))
    own_files = any(
        isinstance(content.get(table), dict) and key in content[table]
        for table, key in (("light", "optics"), ("layout", "file"))
    )
    if own_files and folder != path.parent:
        light = base.get("light")
        if isinstance(light, dict) and isinstance(light.get("optics"), str):
            light["optics"] = str((folder / light["optics"]).absolute())
        folder = path.parent
    moved = _moved_ranges(base, content)
    return _merged(base if moved is None else base | {"units": moved}, content), folder


def _moved_ranges(base: dict[str, Any], own: dict[str, Any]) -> dict[str, Any] | None:
    """The ranges of units of an extended file, moved with the camera's values; None without any."""
    try:
        ranges, before, now = base["units"], base["camera"], own["camera"]
        names = ranges.keys() & now.keys()
        return ranges | {
            name: [each * (now[name] / before[name]) for each in ranges[name]] for name in names
        }
    except (KeyError, TypeError, AttributeError, ZeroDivisionError):
        return None


# Tables that replace the extended file's as a whole, since their keys exclude each other
REPLACED = ("layout", "transducer", "markers")


def _merged(base: dict[str, Any], own: dict[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for key, value in own.items():
        both = isinstance(value, dict) and isinstance(base.get(key), dict) and key not in REPLACED
        merged[key] = _merged(base[key], value) if both else value
    return merged


def spec_of(content: dict[str, Any], source: object) -> Spec:
    """The record of a file's content; T2TwinError with the source where a value does not fit."""
    kind = content.get("kind")
    if kind not in KINDS:
        given = "missing" if kind is None else repr(kind)
        raise T2TwinError(f"{source}: kind is {given}; expected {' or '.join(KINDS)}")
    return convert(content, KINDS[kind][0], source)
