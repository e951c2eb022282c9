"""Reads GLB, the single-file form of glTF 2.0: meters, y up.

Never opens other files, addresses or images.
"""

from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np
import trimesh

from t2twin.primitives_cad.mesh_io import gltf
from t2twin.primitives_cad.mesh_io.bodies import MAX_PLACES, Body, merged, transformed

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
        about = msgspec.json.decode(chunks[JSON_CHUNK], type=gltf.Description)
        about.check()
        buffers = gltf.Buffers(about, chunks.get(BINARY_CHUNK))
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


def _bodies(about: gltf.Description, buffers: gltf.Buffers) -> Iterator[Body]:
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
