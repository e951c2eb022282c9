"""A file that a user names is read only where it is one, and not larger than is allowed."""

import os
import socket

import pytest

from t2twin.core.errors import T2TwinError
from t2twin.core.files import read_file


def bind_socket(path, monkeypatch):
    monkeypatch.chdir(path.parent)  # the path of a socket is short
    with socket.socket(socket.AF_UNIX) as end:
        end.bind(path.name)


def test_a_file_is_read(tmp_path):
    (tmp_path / "it").write_bytes(b"content")
    (tmp_path / "link").symlink_to("it")
    assert read_file(tmp_path / "it") == read_file(tmp_path / "link") == b"content"
    assert read_file(tmp_path / "it", max_bytes=7) == b"content"


LAID = {
    "pipe": (lambda path, _: os.mkfifo(path), "is not a file but a pipe or a device"),
    "socket": (bind_socket, "is not a file but a pipe or a device"),
    "device": (lambda path, _: path.symlink_to("/dev/zero"), "is not a file but a pipe"),
    "folder": (lambda path, _: path.mkdir(), "is a folder"),
    "nothing": (lambda path, _: None, "there is no file .*nothing; give another"),
    "dangling": (lambda path, _: path.symlink_to("gone"), "there is no file"),
    "circle": (lambda path, _: path.symlink_to(path.name), "cannot be read"),
    "large": (lambda path, _: path.write_bytes(bytes(1001)), "at most 0 MB"),
    "null\0": (lambda path, _: None, "cannot be read"),
}


@pytest.mark.parametrize("name", LAID)
def test_anything_else_is_refused_at_once(name, tmp_path, monkeypatch):
    lay, words = LAID[name]
    lay(tmp_path / name, monkeypatch)
    with pytest.raises(T2TwinError, match=words):
        read_file(tmp_path / name, max_bytes=1000, otherwise="give another")
