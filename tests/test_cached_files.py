"""Checksums of cached files: whole files are read, everything else is as if it was not there."""

import os

import numpy as np
import pytest

from t2twin.core.cached_files import (
    BLOCK_BYTES,
    TRAILER_BYTES,
    cached_file,
    is_intact,
    read_checked,
    write_checked,
)


@pytest.mark.parametrize(
    "size", [0, 1, TRAILER_BYTES, BLOCK_BYTES - TRAILER_BYTES, BLOCK_BYTES, BLOCK_BYTES + 3]
)
def test_what_is_written_is_read(tmp_path, size):
    content = os.urandom(size)
    write_checked(tmp_path / "a", content)
    assert read_checked(tmp_path / "a") == content and is_intact(tmp_path / "a")
    cached_file(tmp_path / "b" / "a", (None,), lambda file: file.write(content))
    assert (tmp_path / "b" / "a").read_bytes() == (tmp_path / "a").read_bytes()


def test_an_array_is_computed_once_and_again_for_another_shape_or_after_damage(tmp_path):
    path, calls = tmp_path / "a.npy", []

    def write(file):
        calls.append(file.name)
        np.save(file, np.arange(6).reshape(2, 3))

    for shape in ((2, 3), (None, 3), (2, None)):
        cached_file(path, shape, write)
    assert len(calls) == 1 and np.array_equal(np.load(path), [[0, 1, 2], [3, 4, 5]])
    for shape in ((3, 3), (2,), (None, 2)):
        cached_file(path, shape, write)
    assert len(calls) == 4
    path.write_bytes(path.read_bytes()[:-1])
    cached_file(path, (2, 3), write)
    assert len(calls) == 5 and is_intact(path)


@pytest.mark.parametrize(
    "damage",
    [
        lambda path: path.unlink(),
        lambda path: path.write_bytes(b""),
        lambda path: path.write_bytes(b"short"),
        lambda path: path.write_bytes(path.read_bytes()[:-1]),
        lambda path: path.write_bytes(path.read_bytes()[1:]),
        lambda path: path.write_bytes(path.read_bytes().replace(b"content", b"kontent")),
        lambda path: path.write_bytes(path.read_bytes() + b"\0"),
        lambda path: (write_checked(path.with_name("b"), b"c"), path.with_name("b").replace(path)),
        lambda path: (path.unlink(), path.mkdir()),
        lambda path: (path.unlink(), os.mkfifo(path)),
        lambda path: (path.unlink(), path.symlink_to(path)),
    ],
)
def test_everything_else_is_not(tmp_path, damage):
    path = tmp_path / "a"
    write_checked(path, b"some content")
    damage(path)
    assert read_checked(path) is None and not is_intact(path)
