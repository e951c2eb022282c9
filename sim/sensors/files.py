"""Reads sensor files, TOML: bundled ones by name, a user's own by path.

`extends` names another sensor, whose values hold where the file has none. Its ranges of units move
with the camera's values. Optics state the values that they were fitted with. Those with the name of
a bundled sensor state its values; the file of one unit has its camera, noise and modulus. A sensor
file beside them states the same values or none, and has no other light.
"""

import math
from functools import cache
from pathlib import Path
from typing import Any

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError, warn
from t2twin.core.records import convert, nearest, read_toml
from t2twin.sim.contact.elastomer import DOME
from t2twin.sim.optical.camera import LIMITS, Camera
from t2twin.sim.optical.gel_camera import GelCamera
from t2twin.sim.optical.optics import SPECS, Optics, is_bundled
from t2twin.sim.optical.spec import KIND as GEL_CAMERA
from t2twin.sim.optical.spec import NO_OPTICS, GelCameraSpec
from t2twin.sim.sensors.defaults import ALIASES, ROLES
from t2twin.sim.taxels.spec import KIND as TAXEL_ARRAY
from t2twin.sim.taxels.spec import TaxelArraySpec
from t2twin.sim.taxels.taxel_array import TaxelArray

Spec = GelCameraSpec | TaxelArraySpec
Sensor = GelCamera | TaxelArray

KINDS: dict[str, tuple[type[Spec], type[Sensor]]] = {
    GEL_CAMERA: (GelCameraSpec, GelCamera),
    TAXEL_ARRAY: (TaxelArraySpec, TaxelArray),
}
"""The record and the simulated sensor of each kind."""
FITTED = {"camera": Camera.__struct_fields__, "light": ("leds", "ambient", "gamma"), "gel": DOME}
"""Values with which the optics of a bundled sensor's LEDs are fitted."""
RESERVED = ("press", "tactile_image", "tactile_picture", *ROLES, "both", "none")
"""Names of files of a saved touch and of choices of commands, which no sensor may have."""
NEEDS = {
    "drift_share": "drift_counts", "drift_counts": "drift_share", "offset_ratios": "noise_counts",
    "load_noise_spread": "load_noise_counts", "load_noise_level_counts": "load_noise_counts",
    "memory_rise_s": "memory_s", "memory_spread": "memory_s", "seed": "jitter_mm",
    "dome_flat_mm": "dome_length_radius_mm", "frames": "noise_grey",
}  # fmt: skip
"""Keys of any table that have no effect without another one beside them."""


def bundled_sensors() -> tuple[str, ...]:
    """Names of the bundled sensors."""
    return tuple(sorted(path.stem for path in SPECS.glob("*.toml")))


def path_of(source: str | Path, argument: str = "sensor") -> Path:
    """The file of a sensor: a bundled name, or a path to a .toml file. Raises T2TwinError."""
    name = ALIASES.get(str(source), str(source))
    if name in bundled_sensors():
        return SPECS / f"{name}.toml"
    path = arguments.path(source, argument)
    if path.suffix != ".toml":
        near = nearest(name, bundled_sensors())
        meant = f"; did you mean {near}?" if near else ""
        raise T2TwinError(
            f"{argument} is {str(source)!r}; expected {', '.join(bundled_sensors())} or a .toml "
            f"file{meant}"
        )
    return path


def load_sensor(source: str | Path | Sensor, argument: str = "sensor") -> Sensor:
    """A sensor by its name or from a file; a sensor is returned unchanged. argument: for messages.

    Raises T2TwinError for an unknown name, an unreadable file, and values that are missing, unknown
    or not allowed.
    """
    if isinstance(source, Sensor):
        return source
    path = path_of(source, argument)
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
    base, folder = {}, path.parent
    if extends is not None:
        if path.resolve() in extended:
            raise T2TwinError(f"{path} extends itself; remove one `extends`")
        name = arguments.text(extends, f"{path}: extends")
        other = path_of(path.parent / name if name.endswith(".toml") else name, f"{path}: extends")
        base, folder = _content(other, (*extended, path.resolve()))
        if content.get("kind", kind := base.get("kind")) != kind:
            other_kind = f"kind is not that of {name}, {kind}, which it extends"
            raise T2TwinError(f"{path}: {other_kind}; remove `kind` or `extends`")
    if "file" in _table(content, "layout"):
        folder = path.parent
    optics = _table(content, "light").get("optics")
    if isinstance(optics, str) and optics != NO_OPTICS and not is_bundled(optics):
        folder, base = path.parent, {k: v for k, v in base.items() if k not in ("light", "units")}
        try:
            stated = Optics.load(folder / optics).stated
        except T2TwinError as error:
            others = ", ".join(each.stem for each in SPECS.glob("*.npz"))
            allowed = f"expected an optics file, {NO_OPTICS}, or one of {others}"
            raise T2TwinError(f"{path}: light.optics is {optics!r}; {allowed}: {error}") from None
        for table, values in stated.items():
            base[table] = _table(base, table) | values
    moved = _moved_ranges(base, content)
    return _merged(base if moved is None else base | {"units": moved}, content), folder


def _table(content: dict[str, Any], name: str) -> dict[str, Any]:
    """A table of a file's content; empty for anything else."""
    table = content.get(name)
    return table if isinstance(table, dict) else {}


def _moved_ranges(base: dict[str, Any], own: dict[str, Any]) -> dict[str, Any] | None:
    """The ranges of units of an extended file, moved with the camera's values; None without any."""
    try:
        ranges, before, now = base["units"], base["camera"], own["camera"]
        names = ranges.keys() & now.keys()
        return ranges | {
            name: [
                min(max(each * (now[name] / before[name]), LIMITS[name][0]), LIMITS[name][1])
                for each in ranges[name]
            ]
            for name in names
        }
    except (KeyError, TypeError, AttributeError, ZeroDivisionError):
        return None


def _merged(base: dict[str, Any], own: dict[str, Any], table: str = "") -> dict[str, Any]:
    """The values of a table over those of the extended file that they do not exclude."""
    if (table == "transducer" and own.get("law", base.get("law")) != base.get("law")) or (
        table == "layout" and ("file" in own) != ("file" in base)
    ):
        return own
    merged = {
        key: value
        for key, value in base.items()
        if NEEDS.get(key) not in own or _has_effect(own[NEEDS[key]])
    }
    for key, value in own.items():
        both = isinstance(value, dict) and isinstance(base.get(key), dict)
        merged[key] = _merged(base[key], value, key) if both else value
    return merged


def _has_effect(value: object) -> bool:
    """Whether a value enables what other keys describe further."""
    return value not in (None, 0.0, [], math.inf)


def _check_needs(table: dict[str, Any], place: str) -> None:
    """Raises T2TwinError for a key of a table, or of those in it, that has no effect."""
    for key, value in table.items():
        if isinstance(value, dict):
            _check_needs(value, f"{place}{key}.")
        elif key in NEEDS and _has_effect(value) and not _has_effect(table.get(NEEDS[key])):
            other = f"{NEEDS[key]} is {table.get(NEEDS[key], 'missing')}"
            raise T2TwinError(f"{place}{key} has no effect, since {other}; give both or none")


def spec_of(content: dict[str, Any], source: object) -> Spec:
    """The record of a file's content; T2TwinError with the source where a value does not fit."""
    kind = content.get("kind")
    if kind not in KINDS:
        given = "missing" if kind is None else repr(kind)
        raise T2TwinError(f"{source}: kind is {given}; expected {' or '.join(KINDS)}")
    spec = convert(content, KINDS[kind][0], source)
    if spec.name in RESERVED:
        raise T2TwinError(
            f"{source}: name is {spec.name!r}, as a file or a role of a touch has; choose another"
        )
    _check_needs(content, f"{source}: ")
    if isinstance(spec, GelCameraSpec):
        _check_fitted(spec, source)
    elif spec.counts.rate_hz and not any(each.memory_s for each in spec.imperfections.values()):
        warn(f"{source}: counts.rate_hz has no effect without imperfections with a memory")
    return spec


def _check_fitted(spec: GelCameraSpec, source: object) -> None:
    """Raises T2TwinError for optics of a bundled sensor with other values than the file's."""
    name = spec.light.optics
    if not is_bundled(name):
        return
    fitted = convert(_content(SPECS / f"{name}.toml", ())[0], GelCameraSpec, name)
    for table, keys in FITTED.items():
        own, other = getattr(spec, table), getattr(fitted, table)
        for key in keys:
            if getattr(own, key) != getattr(other, key):
                raise T2TwinError(
                    f"{source}: {table}.{key} is not that of {name}, with which its optics were "
                    f'fitted; write optics = "{NO_OPTICS}" in [light], so that its LEDs light the '
                    "gel, or an optics file of `t2twin calibrate`"
                )
