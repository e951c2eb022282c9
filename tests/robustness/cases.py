"""Cases: a command or call, the files it finds, and the end that is expected; shared damages."""

import os
import shlex
import shutil
import socket
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

REFUSED, BROKEN = 2, 1
"""Exit status of refused input, and of a dataset that fails --verify."""


@dataclass(frozen=True)
class Base:
    """Valid inputs: a dataset, runs of both translators on it, and their evaluation."""

    data: Path
    touch2touch: Path
    resnet18: Path
    evaluation: Path


Make = Callable[[Path, Base], object]
"""Writes a case's files into its own folder, or calls the code under test from there."""


@dataclass(frozen=True)
class Case:
    """One call of t2twin from within a folder of its own.

    command: as in a shell; {data}, {touch2touch}, {resnet18} and {evaluation} are paths of the
    Base. make: writes the files. says: part of the expected sentence, in any case. fine: odd but
    valid input, so that the call must succeed. call: Python to call instead of a command.
    """

    name: str
    command: str = ""
    make: Make = lambda box, base: None
    says: str = ""
    fine: bool = False
    call: Make | None = None

    @property
    def statuses(self) -> tuple[int, ...]:
        """Allowed exit statuses of a refusal."""
        return (REFUSED, BROKEN) if "--verify" in self.command else (REFUSED,)

    def words(self, base: Base) -> list[str]:
        words = shlex.split(self.command)
        for name, path in vars(base).items():
            words = [word.replace(f"{{{name}}}", str(path)) for word in words]
        return words


@dataclass(frozen=True)
class Copy:
    """A copy of a folder of the Base, without caches. Its files are hard links: `put` replaces
    them, and nothing may write into them."""

    name: str


Content = bytes | str | Copy | Callable[[Path], object] | None
"""A file's content, a copy of a folder, a function that writes or changes the path, or None to
delete it."""

Files = dict[str, Content]


def laid(files: Mapping[str, Content]) -> Make:
    """Writes files, in order, below a case's folder."""

    def make(box: Path, base: Base) -> None:
        for name, content in files.items():
            path = box / name
            path.parent.mkdir(parents=True, exist_ok=True)
            if isinstance(content, Copy):
                ignore = shutil.ignore_patterns("cache", "tensorboard")
                source = getattr(base, content.name)
                shutil.copytree(source, path, copy_function=os.link, ignore=ignore)
            elif content is None:
                path.unlink()
            elif callable(content):
                content(path)
            else:
                put(path, content)

    return make


def damaged(
    name: str, commands: Sequence[str], files: Files, target: str,
    contents: Iterable[tuple[str, Content]], says: str = "", fine: bool = False,
) -> Iterator[Case]:  # fmt: skip
    """A case for each content of the file target, by name, with each of the commands in turn.
    files: the others, and what a function as content changes."""
    for number, (what, content) in enumerate(contents):
        make = laid({**files, f"./{target}": content})
        yield Case(f"{name}: {what}", commands[number % len(commands)], make, says, fine)


def put(path: Path, content: bytes | str) -> None:
    """Writes a file; one that is a hard link is replaced."""
    path.unlink(missing_ok=True)
    path.write_bytes(content.encode() if isinstance(content, str) else content)


def edit(change: Callable[[bytes], bytes]) -> Callable[[Path], object]:
    return lambda path: put(path, change(path.read_bytes()))


def instead(make: Callable[[Path], object]) -> Callable[[Path], object]:
    """Puts something else in the place of a file."""
    return lambda path: (path.unlink(missing_ok=True), make(path))


def link(target: str) -> Callable[[Path], object]:
    return instead(lambda path: path.symlink_to(target))


def bind_socket(path: Path) -> None:
    before = Path.cwd()
    os.chdir(path.parent)  # the path of a socket has at most some hundred characters
    try:
        with socket.socket(socket.AF_UNIX) as end:
            end.bind(path.name)
    finally:
        os.chdir(before)


NOISE = np.random.default_rng(0).bytes(5000)

DAMAGES: dict[str, Callable[[Path], object]] = {
    "empty": edit(lambda content: b""),
    "text": edit(lambda content: b"hello"),
    "bytes that are not text": edit(lambda content: b"\xff\xfe\x00\x01,\x02"),
    "noise": edit(lambda content: NOISE),
    "zeros": edit(lambda content: bytes(len(content))),
    "half": edit(lambda content: content[: len(content) // 2]),
    "a pipe": instead(os.mkfifo),
    "a folder": instead(Path.mkdir),
    "a socket": instead(bind_socket),
    "a link to a device": link("/dev/zero"),
    "a link to nothing": link("gone"),
    "a link to itself": instead(lambda path: path.symlink_to(path.name)),
}
"""Damaged contents of a file, and what may be in its place, by name."""


class Unpickled:
    """Unpickling it creates a file, which is found afterwards."""

    def __reduce__(self) -> tuple:
        return Path.touch, (Path("pickled"),)
