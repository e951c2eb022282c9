"""Cases: a command, the files that it finds, and whether it must succeed; images and damages."""

import io
import os
import shlex
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image


@dataclass(frozen=True)
class Base:
    """Valid inputs: a dataset, runs of both translators on it, and their evaluation."""

    data: Path
    touch2touch: Path
    resnet18: Path
    evaluation: Path


Make = Callable[[Path, Base], object]
"""Writes a case's files into its own folder."""


@dataclass(frozen=True)
class Case:
    """One command of t2twin in a folder of its own.

    command: as in a shell; {data}, {touch2touch}, {resnet18} and {evaluation} are paths of the
    Base. make: writes the files. says: part of the expected message. fine: odd but valid input, so
    that the command must succeed.
    """

    name: str
    command: str
    make: Make = lambda box, base: None
    says: str = ""
    fine: bool = False

    def words(self, base: Base) -> list[str]:
        words = shlex.split(self.command)
        for name, path in vars(base).items():
            words = [word.replace(f"{{{name}}}", str(path)) for word in words]
        return words


@dataclass(frozen=True)
class Copy:
    """A copy of a folder of the Base. Its files are hard links, which `put` replaces."""

    name: str


Content = bytes | str | Copy | Callable[[Path], object]
"""A file's content, a copy of a folder, or a function that writes or changes the path."""

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
            elif callable(content):
                content(path)
            else:
                put(path, content)

    return make


def damaged(
    name: str, commands: tuple[str, ...], files: Files, target: str,
    contents: Iterable[tuple[str, Content]], fine: bool = False,
) -> Iterator[Case]:  # fmt: skip
    """A case for each content of the file target, by name, with each of the commands in turn."""
    for number, (what, content) in enumerate(contents):
        make = laid({**files, f"./{target}": content})
        yield Case(f"{name}: {what}", commands[number % len(commands)], make, fine=fine)


def put(path: Path, content: bytes | str) -> None:
    """Writes a file; one that is a hard link is replaced."""
    path.unlink(missing_ok=True)
    path.write_bytes(content.encode() if isinstance(content, str) else content)


def edit(change: Callable[[bytes], bytes]) -> Callable[[Path], object]:
    return lambda path: put(path, change(path.read_bytes()))


DAMAGES: dict[str, Callable[[Path], object]] = {
    "empty": edit(lambda content: b""),
    "text": edit(lambda content: b"hello"),
    "half": edit(lambda content: content[: len(content) // 2]),
    "a folder": lambda path: (path.unlink(missing_ok=True), path.mkdir()),
}
"""Damaged contents of a file, and what may be in its place, by name."""


def frame(seed: int = 0, size: tuple[int, int] = (240, 320)) -> Image.Image:
    """An RGB image with a blurred spot and noise."""
    x, y = np.meshgrid(np.linspace(-1, 1, size[0]), np.linspace(-1, 1, size[1]))
    ball = np.exp(-8 * ((x - 0.1 * (seed % 5)) ** 2 + (y + 0.1 * (seed % 7)) ** 2))
    noise = np.random.default_rng(seed).normal(0, 3, (size[1], size[0], 3))
    pixels = 90 + 60 * ball[..., None] * np.array([1.0, -0.5, 0.7]) + noise
    return Image.fromarray(pixels.clip(0, 255).astype(np.uint8))


def encoded(image: Image.Image, kind: str = "PNG", **options: object) -> bytes:
    file = io.BytesIO()
    image.save(file, kind, **options)
    return file.getvalue()


PNG, JPEG = encoded(frame()), encoded(frame(), "JPEG")
