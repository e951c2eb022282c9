"""Reads PLY: corners, faces and strips of triangles, as text or binary, without units.

trimesh's reader (5.2, 2026-11-26) is not used: it reads no strips, and neither binary files with
faces of different numbers of corners nor faces with notches.
"""

import struct
from array import array
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import trimesh

from t2twin.primitives_cad.mesh_io.bodies import (
    Body,
    check_corners,
    check_triangles,
    merged,
    triangles_of_faces,
)
from t2twin.primitives_cad.mesh_io.stl import numbers

TYPES = (
    {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"}
    | {"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"}
    | {"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"}
)
"""NumPy's names of the types of PLY."""

CODES = {"i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I", "f4": "f", "f8": "d"}
"""Python's codes of the same types, for `struct`."""

ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
"""NumPy's byte orders of the formats of PLY; empty for text."""

CORNERS = ("vertex_indices", "vertex_index")
"""Names of the list of a face's corners, both in use."""

STRIP_END = -1
"""Index between two strips of triangles."""

DAMAGED = "it is damaged: its content does not match its header"


@dataclass(frozen=True)
class _Property:
    """A property of an element. length: type of a list's length; None for a single value."""

    name: str
    kind: str
    length: str | None = None


@dataclass(frozen=True)
class _Element:
    name: str
    count: int
    properties: list[_Property] = field(default_factory=list)


def read(path: Path) -> tuple[trimesh.Trimesh, float]:
    """The faces of a PLY file, and 1 mm; see this package. Ignores textures."""
    content = path.read_bytes()
    if not content.startswith(b"ply"):
        raise ValueError("it is not PLY: it does not begin with the word ply")
    head, end, body = content.partition(b"end_header")
    if not end:
        raise ValueError("it is damaged: its header has no end")
    try:
        order, elements = _header(head)
        body = body[2:] if body.startswith(b"\r\n") else body[1:]
        if not order:
            body, elements = _as_doubles(body, elements)
        return merged([_body_of(elements, _Body(body, order or "<"))]), 1.0
    except (IndexError, KeyError, OverflowError) as error:
        raise ValueError(DAMAGED) from error


def _body_of(elements: list[_Element], content: "_Body") -> Body:
    """The corners and triangles. Corners without a face are left out, which in scans may be NaN."""
    places, faces = np.zeros((0, 3)), list[np.ndarray]()
    for element in elements:
        rows = content.rows(element)
        corners = next((_indices(rows[name]) for name in CORNERS if name in rows), [])
        if element.name == "vertex" and rows:
            check_corners(element.count)
            places = np.hstack([rows[axis][0] for axis in "xyz"]).astype(np.float64)
        elif element.name == "face":
            faces += [each for each in corners if each.shape[1] >= 3]
        elif element.name == "tristrips":
            faces += _strips(corners)
    check_triangles(sum(len(each) * (each.shape[1] - 2) for each in faces))
    triangles = triangles_of_faces(faces, places)
    used, numbered = np.unique(triangles, return_inverse=True)
    return places[used], numbered.reshape(-1, 3)


def _header(head: bytes) -> tuple[str, list[_Element]]:
    """The byte order, and the elements."""
    order, elements = None, list[_Element]()
    for line in head.decode("latin-1").splitlines():
        match line.split():
            case ["format", name, *_]:
                order = ORDERS[name]
            case ["element", name, count]:
                elements.append(_Element(name, int(count)))
            case ["property", "list", length, kind, name]:
                elements[-1].properties.append(_Property(name, TYPES[kind], TYPES[length]))
            case ["property", kind, name]:
                elements[-1].properties.append(_Property(name, TYPES[kind]))
    if order is None:
        raise ValueError(DAMAGED)
    return order, elements


def _as_doubles(text: bytes, elements: list[_Element]) -> tuple[bytes, list[_Element]]:
    """A text as binary, little-endian, and the elements of that."""
    doubles = [
        replace(
            element,
            properties=[
                _Property(each.name, "f8", each.length and "f8") for each in element.properties
            ],
        )
        for element in elements
    ]
    return numbers(text).astype("<f8").tobytes(), doubles


class _Body:
    """The binary content of a file. start: of the next element."""

    def __init__(self, content: bytes, order: str) -> None:
        self._content = content
        self._order = order
        self._start = 0

    def rows(self, element: _Element) -> dict[str, list[np.ndarray]]:
        """The properties of an element by name: arrays (k, n) of the k lists of n values, of single
        values (count, 1)."""
        if not element.count:
            return {}
        fields, sizes = [], self._lengths(element)
        for each, size in zip(element.properties, sizes, strict=True):
            if each.length is not None:
                fields.append((f"length of {each.name}", self._order + each.length))
            fields.append((each.name, self._order + each.kind, (size,)))
        row = np.dtype(fields)
        end = self._start + element.count * row.itemsize
        if end <= len(self._content):
            rows = np.frombuffer(self._content, row, element.count, self._start)
            if all(
                (rows[f"length of {each.name}"] == size).all()
                for each, size in zip(element.properties, sizes, strict=True)
                if each.length is not None
            ):
                self._start = end
                return {each.name: [rows[each.name]] for each in element.properties}
        return self._uneven_rows(element)

    def _lengths(self, element: _Element) -> list[int]:
        """Of the next row: the lengths of its lists, 1 for single values."""
        lengths, at = [], self._start
        for each in element.properties:
            size = 1
            if each.length is not None:
                size, at = self._length(each.length, at)
            lengths.append(size)
            at += size * np.dtype(each.kind).itemsize
        return lengths

    def _length(self, kind: str, at: int) -> tuple[int, int]:
        """The length of a list at a place, and the place after it."""
        try:
            (length,) = struct.unpack_from(self._order + CODES[kind], self._content, at)
        except struct.error as error:
            raise ValueError(DAMAGED) from error
        if not 0 <= length <= len(self._content):
            raise ValueError(DAMAGED)
        return int(length), at + struct.calcsize(CODES[kind])

    def _uneven_rows(self, element: _Element) -> dict[str, list[np.ndarray]]:
        """`rows` where lists differ in length: those lists only."""
        places: dict[str, dict[int, array]] = {}
        at = self._start
        items = [(each, np.dtype(each.kind).itemsize) for each in element.properties]
        if all(each.length is None for each, _ in items):
            raise ValueError(DAMAGED)  # they are of one length and end too early
        for _ in range(element.count):
            for each, itemsize in items:
                size = 1
                if each.length is not None:
                    size, at = self._length(each.length, at)
                    places.setdefault(each.name, {}).setdefault(size, array("q")).append(at)
                at += size * itemsize
        if at > len(self._content):
            raise ValueError(DAMAGED)
        self._start = at
        content = np.frombuffer(self._content, np.uint8)
        return {
            each.name: [
                content[np.array(starts)[:, None] + np.arange(size * itemsize)]
                .view(self._order + each.kind)
                .reshape(-1, size)
                for size, starts in sorted(places[each.name].items())
                if size
            ]
            for each, itemsize in items
            if each.name in places
        }


def _indices(lists: list[np.ndarray]) -> list[np.ndarray]:
    """Lists of whole numbers, int64."""
    whole = [each.astype(np.int64) for each in lists if np.isfinite(each).all()]
    if len(whole) < len(lists) or any((a != b).any() for a, b in zip(whole, lists, strict=True)):
        raise ValueError("it has faces whose corners are not whole numbers")
    return whole


def _strips(lists: list[np.ndarray]) -> list[np.ndarray]:
    """The triangles (m, 3) of strips, each list with STRIP_END between its strips."""
    found = []
    for row in (row for each in lists for row in each):
        for strip in np.split(row, np.flatnonzero(row == STRIP_END)):
            corners = strip[strip != STRIP_END]
            ahead = np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=-1)
            ahead[1::2] = ahead[1::2, [1, 0, 2]]
            found.append(ahead)
    return [np.concatenate(found)] if found else []
