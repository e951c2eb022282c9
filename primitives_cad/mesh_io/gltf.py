"""Reads GLB, the single-file form of glTF 2.0: meters, y up.

Never opens other files, addresses or images.
"""

import base64
import binascii
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
import trimesh
from msgspec import Meta, Struct

from t2twin.primitives_cad.mesh_io.bodies import (
    MAX_PLACES,
    Body,
    check_corners,
    merged,
    transformed,
)

METER_MM = 1000.0
"""Unit of length of glTF, mm (glTF 2.0, 3.4, Coordinate System and Units)."""

UPRIGHT = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]], dtype=np.float64)
"""Transform from glTF's frame, y up (the same section), to one with z up."""

VERSION = 2
"""The supported version of glTF (glTF 2.0, 4.4.2)."""

FILE_HEADER_BYTES, CHUNK_HEADER_BYTES = 12, 8
"""Three words at the start of the file, two at the start of each chunk (glTF 2.0, 4.4)."""

JSON_CHUNK, BINARY_CHUNK = b"JSON", b"BIN\0"
"""Types of the supported chunks (glTF 2.0, 4.4.3)."""

POINTS_AND_LINES = (0, 1, 2, 3)
"""Modes of primitives without triangles (glTF 2.0, 3.7.2.1)."""

TRIANGLES, STRIP, FAN = 4, 5, 6
"""Modes of primitives with triangles (the same section)."""

TYPES: dict[int, str] = {5121: "<u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
"""Supported component types by their numbers (glTF 2.0, 3.6.2.2)."""

FLOAT = 5126
"""Number of single precision, the type of corners without extensions."""

COMPRESSED = "its triangles are compressed; export it without compression"

APPEARANCE = ("KHR_materials_", "KHR_texture_", "KHR_lights_", "EXT_texture_", "MSFT_texture_")
"""Starts of the names of extensions that leave triangles as they are."""

Index = Annotated[int, Meta(ge=0)]
Size = Annotated[int, Meta(ge=0, le=2**40)]


class Buffer(Struct, frozen=True, rename="camel"):
    byte_length: Size
    uri: str | None = None


class BufferView(Struct, frozen=True, rename="camel"):
    buffer: Index
    byte_length: Size
    byte_offset: Size = 0
    byte_stride: Annotated[int, Meta(ge=1, le=252)] | None = None
    extensions: dict[str, Any] = {}


class Accessor(Struct, frozen=True, rename="camel"):
    component_type: int
    count: Size
    type: str
    buffer_view: Index | None = None
    byte_offset: Size = 0
    sparse: dict[str, Any] | None = None


class Primitive(Struct, frozen=True, rename="camel"):
    attributes: dict[str, Any]
    indices: Index | None = None
    mode: Annotated[int, Meta(ge=0, le=FAN)] = TRIANGLES


class GltfMesh(Struct, frozen=True, rename="camel"):
    primitives: tuple[Primitive, ...]


class Node(Struct, frozen=True, rename="camel"):
    """A placement: matrix, column by column, or translation, rotation (x, y, z, w) and scale."""

    mesh: Index | None = None
    children: tuple[Index, ...] = ()
    matrix: Annotated[tuple[float, ...], Meta(min_length=16, max_length=16)] | None = None
    translation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rotation: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)

    def transform(self) -> np.ndarray:
        """(4, 4) transform from this node's frame to its parent's (glTF 2.0, 3.5.3)."""
        if self.matrix is not None:
            return np.array(self.matrix).reshape(4, 4).T
        x, y, z, w = self.rotation
        transform = trimesh.transformations.quaternion_matrix((w, x, y, z))
        transform[:3, :3] *= self.scale
        transform[:3, 3] = self.translation
        return transform


class GltfScene(Struct, frozen=True, rename="camel"):
    nodes: tuple[Index, ...] = ()


class Description(Struct, frozen=True, rename="camel"):
    """Contents of a file, which refer to each other by indices of these lists."""

    buffers: tuple[Buffer, ...] = ()
    buffer_views: tuple[BufferView, ...] = ()
    accessors: tuple[Accessor, ...] = ()
    meshes: tuple[GltfMesh, ...] = ()
    nodes: tuple[Node, ...] = ()
    scenes: tuple[GltfScene, ...] = ()
    scene: Index = 0
    extensions_required: tuple[str, ...] = ()

    def check(self) -> None:
        """Raises ValueError for a file with compressed data, and for one that requires an extension
        that may change its triangles."""
        for name in self.extensions_required:
            if "compression" in name or "quantization" in name:
                raise ValueError(COMPRESSED)
            if not name.startswith(APPEARANCE):
                raise ValueError(
                    f"it requires the extension {name}, which is not read; export it without"
                )

    def roots(self) -> tuple[int, ...]:
        """The root nodes of the default scene, or of all nodes without a scene."""
        if self.scenes:
            return self.scenes[self.scene].nodes
        below = {child for node in self.nodes for child in node.children}
        return tuple(number for number in range(len(self.nodes)) if number not in below)


class Buffers:
    """The arrays of a file. binary: its binary chunk."""

    def __init__(self, about: Description, binary: memoryview | None) -> None:
        self._about = about
        self._binary = binary
        self._decoded: dict[int, memoryview] = {}

    def triangles(self, part: Primitive) -> Body:
        """The corners and triangles of a primitive; empty for points and lines."""
        if part.mode in POINTS_AND_LINES:
            return np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)
        corners = self._array(part.attributes["POSITION"], "VEC3").astype(np.float64)
        if part.indices is None:
            index = np.arange(len(corners))
        else:
            index = self._array(part.indices, "SCALAR").astype(np.int64)
        if part.mode == TRIANGLES:
            return corners, index[: len(index) // 3 * 3].reshape(-1, 3)
        ahead = np.stack([index[:-2], index[1:-1], index[2:]], axis=-1)
        if part.mode == STRIP:
            ahead[1::2] = ahead[1::2, [1, 0, 2]]
        else:
            ahead[:, 0] = index[:1]
        return corners, ahead

    def _array(self, number: int, kind: Literal["VEC3", "SCALAR"]) -> np.ndarray:
        """The array of an accessor, (count, 3) float32 or (count,) unsigned.

        Raises ValueError for a compressed one, and KeyError for one that lies outside its buffer.
        """
        accessor = self._about.accessors[number]
        wanted = (
            accessor.component_type == FLOAT
            if kind == "VEC3"
            else (accessor.component_type in TYPES and accessor.component_type != FLOAT)
        )
        if accessor.buffer_view is None or accessor.sparse is not None or not wanted:
            raise ValueError(COMPRESSED)
        view = self._about.buffer_views[accessor.buffer_view]
        if view.extensions:
            raise ValueError(COMPRESSED)
        if accessor.type != kind:
            raise KeyError(kind)
        columns = 3 if kind == "VEC3" else 1
        dtype = np.dtype(TYPES[accessor.component_type])
        width = columns * dtype.itemsize
        stride = view.byte_stride or width
        end = accessor.byte_offset + stride * max(accessor.count - 1, 0) + width
        data = self._buffer(view.buffer)
        # NumPy accepts an empty buffer for any size.
        if end > view.byte_length or view.byte_offset + view.byte_length > len(data):
            raise KeyError(number)
        check_corners(accessor.count)
        start = view.byte_offset + accessor.byte_offset
        array = np.ndarray((accessor.count, columns), dtype, data, start, (stride, dtype.itemsize))
        return array if kind == "VEC3" else array[:, 0]

    def _buffer(self, number: int) -> memoryview:
        """The bytes of a buffer, from the binary chunk or a data URI (glTF 2.0, 3.6.1)."""
        if number in self._decoded:
            return self._decoded[number]
        buffer = self._about.buffers[number]
        if buffer.uri is None:
            if self._binary is None:
                raise KeyError(number)
            data = self._binary
        elif buffer.uri.startswith("data:"):
            try:
                data = memoryview(base64.b64decode(buffer.uri.partition(",")[2], validate=True))
            except (binascii.Error, ValueError):
                raise KeyError(number) from None
        else:
            raise ValueError("it keeps its triangles in another file; all must be in one")
        if len(data) < buffer.byte_length:
            raise KeyError(number)
        self._decoded[number] = data
        return data


def read(path: Path) -> tuple[trimesh.Trimesh, float]:
    """The triangles of a GLB file with z up, and METER_MM; see this package."""
    content = path.read_bytes()
    if not content.startswith(b"glTF"):
        raise ValueError("it is not GLB: it does not begin with the word glTF")
    version = int.from_bytes(content[4:8], "little")
    if version != VERSION:
        raise ValueError(f"it is of version {version} of glTF; version {VERSION} is read")
    try:
        chunks = dict(_chunks(content))
        about = msgspec.json.decode(chunks[JSON_CHUNK], type=Description)
        about.check()
        buffers = Buffers(about, chunks.get(BINARY_CHUNK))
        return merged(_bodies(about, buffers)), METER_MM
    except (msgspec.DecodeError, IndexError, KeyError, TypeError, RecursionError) as error:
        raise ValueError("it is damaged: its parts do not hold together") from error


def _chunks(content: bytes) -> Iterator[tuple[bytes, memoryview]]:
    """Each chunk's type and data."""
    if len(content) < int.from_bytes(content[8:FILE_HEADER_BYTES], "little"):
        raise ValueError("it is damaged: it is shorter than it announces")
    start = FILE_HEADER_BYTES
    while start + CHUNK_HEADER_BYTES <= len(content):
        length = int.from_bytes(content[start : start + 4], "little")
        data = memoryview(content)[start + CHUNK_HEADER_BYTES :][:length]
        if len(data) < length:
            raise ValueError("it is damaged: it is shorter than it announces")
        yield content[start + 4 : start + CHUNK_HEADER_BYTES], data
        start += CHUNK_HEADER_BYTES + length


def _bodies(about: Description, buffers: Buffers) -> Iterator[Body]:
    """The triangles of the default scene, part by part, in its frame."""
    if about.meshes and not about.nodes:
        raise ValueError("it is damaged: it has no nodes, which place its triangles")
    waiting = [(node, UPRIGHT) for node in about.roots()]
    seen: set[int] = set()
    while waiting:
        number, above = waiting.pop()
        if number in seen:
            raise ValueError("it is damaged: a node stands below two others, or below itself")
        seen.add(number)
        if len(seen) > MAX_PLACES:
            raise ValueError(f"its parts stand at more than the {MAX_PLACES:,} allowed places")
        node = about.nodes[number]
        with np.errstate(over="ignore", invalid="ignore"):
            transform = above @ node.transform()
        waiting += [(child, transform) for child in node.children]
        if node.mesh is not None:
            for part in about.meshes[node.mesh].primitives:
                yield transformed(buffers.triangles(part), transform)
