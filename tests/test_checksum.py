"""Checksums of cached files: whole files are read, everything else is as if it was not there."""

import os

import pytest

from t2twin.core.cached_files import (
    BLOCK_BYTES,
    TRAILER_BYTES,
    add_checksum,
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
    with (tmp_path / "b").open("w+b") as file:
        file.write(content)
        add_checksum(file, "a")
    assert (tmp_path / "b").read_bytes() == (tmp_path / "a").read_bytes()


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
