"""A bad input, or a good but odd one: what is laid out, what is asked, and how it has to end."""

import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

REFUSED, BROKEN = 2, 1
"""Exit statuses of what cannot be used, and of a dataset that --verify finds broken."""


@dataclass(frozen=True)
class Base:
    """Good inputs to spoil copies of: a dataset, both runs trained on it, their evaluation."""

    data: Path
    touch2touch: Path
    resnet18: Path
    evaluation: Path


Make = Callable[[Path, Base], object]
"""Lays a case's inputs out in its own folder."""


def nothing(box: Path, base: Base) -> None:
    """For cases that need no file of their own."""


@dataclass(frozen=True)
class Case:
    """One call of t2twin from within a folder of its own, the box.

    arguments: of t2twin; paths are below the box, {data}, {touch2touch}, {resnet18} and
    {evaluation} are those of the Base. make: lays out the inputs. says: what the sentence must
    hold, in small letters. fine: valid though odd, so that it must succeed. statuses: that a
    refusal may end with.
    call: Python to run in place of a command line, with the box and the base; a T2TwinError that it
    raises ends the case as it would end a command.
    """

    name: str
    arguments: tuple[str, ...]
    make: Make = nothing
    says: str = ""
    fine: bool = False
    statuses: tuple[int, ...] = (REFUSED,)
    call: Make | None = None

    def words(self, base: Base) -> list[str]:
        """The arguments with the Base's paths in place."""
        places = {f"{{{name}}}": str(path) for name, path in vars(base).items()}
        return [places.get(word, word) for word in self.arguments]


def holding(name: str, content: bytes | str) -> Make:
    """Lays out one file."""

    def make(box: Path, base: Base) -> None:
        replaced(box / name, content)

    return make


class LeavesFile:
    """Unpickled, it leaves a file: what reads pickles is found out by it."""

    def __reduce__(self) -> tuple:
        return Path.touch, (Path("pickled"),)


def copied(folder: Path, to: Path, without: tuple[str, ...] = ("cache", "tensorboard")) -> Path:
    """A copy whose files are links to the same content: replace them, never write into them."""
    ignore = shutil.ignore_patterns(*without)
    shutil.copytree(folder, to, copy_function=os.link, ignore=ignore)
    return to


def replaced(path: Path, content: bytes | str) -> None:
    """Gives a copied file a content of its own."""
    path.unlink(missing_ok=True)
    path.write_bytes(content.encode() if isinstance(content, str) else content)
