"""3MF: a ZIP archive of XML models with parts, places and a unit (3MF Core Specification 1.3).

Read with Python's own ZIP and XML: nothing outside the archive, and no more than is allowed here.
"""

import zipfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import trimesh

from t2twin.primitives_cad.formats.bodies import Body, joined, moved

UNITS_MM = {
    "micron": 0.001,
    "millimeter": 1.0,
    "centimeter": 10.0,
    "inch": 25.4,
    "foot": 304.8,
    "meter": 1000.0,
}
"""The units that a model may name, mm; millimeter where it names none."""

MOST_UNPACKED_BYTES = 1_000_000_000
"""Most bytes of models in an archive, unpacked (assumed: what 5 million triangles take)."""

MOST_PLACES = 10_000
"""Most places at which parts may stand, groups of parts included (assumed)."""

CHUNK_BYTES = 1 << 20
"""Bytes that are unpacked and read at once (assumed)."""

CORE = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
ELSEWHERE = "{http://schemas.microsoft.com/3dmanufacturing/production/2015/06}path"
"""The attribute that names another model of the archive."""

START = "/3D/3dmodel.model"
"""The model that says what is built, as every writer names it."""


@dataclass(frozen=True)
class _Place:
    """A part, by the model that holds it and its number, and where it stands, (4, 4)."""

    part: tuple[str, str]
    transform: np.ndarray


@dataclass
class _Part:
    """A part's own triangles, and the parts that it is made of."""

    corners: list[tuple[float, float, float]] = field(default_factory=list)
    faces: list[tuple[int, int, int]] = field(default_factory=list)
    places: list[_Place] = field(default_factory=list)


class _Model:
    """What one model says, taken up as the XML is parsed."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.unit_mm = 1.0
        self.parts: dict[tuple[str, str], _Part] = {}
        self.built: list[_Place] = []
        self.part = _Part()

    def start(self, tag: str, said: dict[str, str]) -> None:
        if not tag.startswith(CORE):
            return
        match tag[len(CORE) :]:
            case "vertex":
                self.part.corners.append((float(said["x"]), float(said["y"]), float(said["z"])))
            case "triangle":
                self.part.faces.append((int(said["v1"]), int(said["v2"]), int(said["v3"])))
            case "object":
                self.part = _Part()
                # Supports and the like are not the solid: they stay empty.
                solid = said.get("type", "model") == "model"
                self.parts[self.name, said["id"]] = self.part if solid else _Part()
            case "component":
                self.part.places.append(self._place(said))
            case "item":
                self.built.append(self._place(said))
            case "model":
                unit = said.get("unit", "millimeter")
                if unit not in UNITS_MM:
                    raise ValueError(f"its unit {unit!r} is not one of {', '.join(UNITS_MM)}")
                self.unit_mm = UNITS_MM[unit]

    def doctype(self, name: str, public: str, system: str) -> None:
        raise ValueError("its XML declares a document type, which 3MF does not allow")

    def close(self) -> None:
        pass

    def _place(self, said: dict[str, str]) -> _Place:
        transform = np.eye(4)
        if "transform" in said:
            numbers = np.array(said["transform"].split(), dtype=np.float64)
            transform[:3] = numbers.reshape(4, 3).T
        return _Place((said.get(ELSEWHERE, self.name), said["objectid"]), transform)


def read(path: Path) -> tuple[trimesh.Trimesh, float]:
    """What a 3MF file builds and its unit in mm; see this package."""
    try:
        with zipfile.ZipFile(path) as archive:
            models = _models(archive)
    except zipfile.BadZipFile as error:
        raise ValueError("it is not a whole ZIP archive, which 3MF is") from error
    except ElementTree.ParseError as error:
        raise ValueError("its model is not whole XML") from error
    except KeyError as error:
        raise ValueError(f"it lacks {error.args[0]}") from error
    start = models[START]
    parts = {name: part for model in models.values() for name, part in model.parts.items()}
    return joined(_bodies(start.built, parts)), start.unit_mm


def _models(archive: zipfile.ZipFile) -> dict[str, _Model]:
    """Every model of the archive by name; what is unpacked of each is what it announces."""
    files = {f"/{each.filename}": each for each in archive.infolist()}
    files = {name: each for name, each in files.items() if name.lower().endswith(".model")}
    start = next((name for name in files if name.lower() == START.lower()), None)
    if start is None:
        raise ValueError(f"it lacks {START[1:]}")
    if sum(each.file_size for each in files.values()) > MOST_UNPACKED_BYTES:
        raise ValueError(
            f"its models are larger than the {MOST_UNPACKED_BYTES / 1e6:,.0f} MB that are allowed"
        )
    models = {}
    for name, each in files.items():
        known = START if name == start else name
        models[known] = _Model(known)
        parser = ElementTree.XMLParser(target=models[known])
        with archive.open(each) as unpacked:
            while chunk := unpacked.read(CHUNK_BYTES):
                parser.feed(chunk)
        parser.close()
    return models


def _bodies(built: list[_Place], parts: dict[tuple[str, str], _Part]) -> Iterator[Body]:
    """The triangles of all that is built, part by part, each where it stands."""
    waiting, seen = list(built), 0
    while waiting:
        place = waiting.pop()
        seen += 1
        if seen > MOST_PLACES:
            raise ValueError(f"its parts stand at more than the {MOST_PLACES:,} allowed places")
        if place.part not in parts:
            raise ValueError(f"it builds part {place.part[1]}, which it lacks")
        part = parts[place.part]
        waiting += [_Place(inner.part, place.transform @ inner.transform) for inner in part.places]
        corners = np.array(part.corners, dtype=np.float64).reshape(-1, 3)
        faces = np.array(part.faces, dtype=np.int64).reshape(-1, 3)
        yield moved((corners, faces), place.transform)
