"""What a world presses, cut into shards."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.mesh_io import read
from t2twin.primitives_cad.primitive_parameters import PRIMITIVES
from t2twin.sim.world.presses import MAX_SEED, grid_indices, random_name
from t2twin.sim.world.recipe import RANDOM, Part, Recipe, Split

PRESSES_A_SHARD = 500
"""About how many presses go into a shard: some 40 MB, half a minute's work."""


@dataclass(frozen=True)
class Batch:
    """The presses of one shard.

    path: below the dataset's folder. part: its number in the recipe. shapes, numbers: names or
    files of the shapes, and their numbers in the part. indices: of the presses on the grid, of one
    shape; None where the part's place is not the grid. presses: of each shape.
    """

    path: str
    split: Split
    part: int
    shapes: tuple[str, ...]
    numbers: tuple[int, ...]
    indices: tuple[int, ...] | None
    presses: int

    @property
    def pairs(self) -> int:
        return self.presses * len(self.shapes)

    @property
    def press_indices(self) -> Sequence[int]:
        """Indices of the presses of each shape."""
        return range(self.presses) if self.indices is None else self.indices


def file_stem(shape: str) -> str:
    return shape.replace("/", "-")


def shard_path(split: str, shape: str) -> str:
    """A shape's shard below the dataset's folder, where each has its own."""
    return f"{split}/{file_stem(shape)}.parquet"


def name_of(source: str) -> str:
    """What a shape is called in a row: a file goes by its stem."""
    return Path(source).stem if Path(source).suffix.lower() in read.SUFFIXES else source


def plan(recipe: Recipe, names: tuple[str, ...] = catalogue.NAMES) -> list[Batch]:
    """All shards of a world. names: the only primitives and tools that are pressed, in this order
    on a grid.

    Raises T2TwinError for a folder that holds no solids' files.
    """
    batches = [
        batch
        for number, part in enumerate(recipe.parts)
        for batch in _of_part(recipe, number, part, names)
    ]
    on_grid = [batch for batch in batches if batch.indices is not None]
    others = [batch for batch in batches if batch.indices is None]
    return sorted(on_grid, key=lambda batch: names.index(batch.shapes[0])) + others


def solids_in(folder: str) -> tuple[str, ...]:
    """The solids' files in a recipe's folder, sorted. Raises T2TwinError where there are none."""
    found = sorted(
        str(path) for path in Path(folder).glob("*") if path.suffix.lower() in read.SUFFIXES
    )
    if not found:
        raise T2TwinError(
            f"{folder} holds no solids; shapes must be random, primitives, tools, or a folder with "
            f"files of {', '.join(read.SUFFIXES)}"
        )
    return tuple(found)


def _of_part(recipe: Recipe, number: int, part: Part, names: tuple[str, ...]) -> Iterator[Batch]:
    shapes = _shapes(recipe, number, names)
    if part.place == "grid":
        for place, name in enumerate(shapes):
            indices, split = grid_indices(part, name), _split(part, name, place, len(shapes))
            yield Batch(
                shard_path(split, name), split, number, (name,), (place,), indices, len(indices)
            )
        return
    assert part.presses is not None
    a_shard = max(1, round(PRESSES_A_SHARD / part.presses))
    by_split: dict[Split, list[int]] = {}
    for place, name in enumerate(shapes):
        by_split.setdefault(_split(part, name, place, len(shapes)), []).append(place)
    for split, places in by_split.items():
        for nth, start in enumerate(range(0, len(places), a_shard)):
            mine = tuple(places[start : start + a_shard])
            yield Batch(
                path=f"{split}/part-{number}-{nth:05d}.parquet",
                split=split,
                part=number,
                shapes=tuple(shapes[place] for place in mine),
                numbers=mine,
                indices=None,
                presses=part.presses,
            )


def _shapes(recipe: Recipe, number: int, names: tuple[str, ...]) -> tuple[str, ...]:
    """Of a part, by its number."""
    part = recipe.parts[number]
    if part.shapes == RANDOM:
        assert part.count is not None
        if recipe.seed > MAX_SEED:
            raise T2TwinError(
                f"the seed of a world of random shapes is {recipe.seed}; it must be at most "
                f"{MAX_SEED}"
            )
        # No two parts have a shape in common, as they may be of different splits.
        before = sum(earlier.count or 0 for earlier in recipe.parts[:number])
        return tuple(random_name(recipe.seed, before + place) for place in range(part.count))
    if part.shapes in ("primitives", "tools"):
        of = PRIMITIVES if part.shapes == "primitives" else catalogue.OBJECTS
        return tuple(name for name in of if name in names)
    return solids_in(part.shapes)


def _split(part: Part, name: str, place: int, shapes: int) -> Split:
    if part.split == "by-version":
        return catalogue.split(name)  # pyright: ignore[reportReturnType]
    is_last = place >= shapes - round(part.val_share * shapes)
    return "val" if is_last else part.split
