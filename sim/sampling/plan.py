"""Plans the presses of a recipe, divided into shards."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad import catalogue, mesh_files
from t2twin.primitives_cad.primitive_parameters import PRIMITIVES
from t2twin.primitives_cad.shape import Shape
from t2twin.sim.sampling.presses import (
    MAX_SHAPE_SEED,
    MotionPath,
    grid_indices,
    random_name,
    sample_paths,
)
from t2twin.sim.sampling.recipe import NAMED, RANDOM, Part, Recipe, Split

PRESSES_PER_SHARD = 500
"""Approximate number of presses of a shard: some 40 MB, made in half a minute."""


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


def paths_of(recipe: Recipe, batch: Batch, number: int) -> tuple[MotionPath, ...]:
    """The paths of a shape of a shard. number: of the shape in the part."""
    if batch.indices is not None:
        return tuple(map(MotionPath, batch.indices))
    if not recipe.motion:
        return tuple(map(MotionPath, range(batch.presses)))
    return sample_paths(recipe.motion, batch.presses, (recipe.seed, batch.part), number)


def file_stem(shape: str) -> str:
    return shape.replace("/", "-")


def shard_path(split: str, shape: str) -> str:
    """Path of a shard of one shape below the dataset's folder."""
    return f"{split}/{file_stem(shape)}.parquet"


def name_of(source: str) -> str:
    """Name of a shape in the dataset: a file's stem, or the name."""
    suffix = Path(source).suffix
    return Path(source).stem if suffix and _is_solid(suffix) else source


def plan(recipe: Recipe, names: tuple[str, ...] = catalogue.NAMES) -> list[Batch]:
    """All shards of a recipe. names: restricts the primitives and tools, and orders the grids.

    Raises T2TwinError for a folder without files of solids, for different files of one name, and
    for a val_share of too few shapes.
    """
    batches = [
        batch
        for number, part in enumerate(recipe.parts)
        for batch in _part_batches(recipe, number, part, names)
    ]
    known: dict[str, str] = {}
    for source in (source for batch in batches for source in batch.shapes):
        other = known.setdefault(name_of(source), source)
        if Path(other) != Path(source):
            raise T2TwinError(
                f"{other} and {source} would both be the shape {name_of(source)!r} of the dataset; "
                "rename one of them"
            )
    # those on the grid first, in the order of the names
    last = len(names)
    return sorted(batches, key=lambda b: last if b.indices is None else names.index(b.shapes[0]))


def solids_in(folder: str) -> tuple[str, ...]:
    """The files of solids in a recipe's folder, sorted. Raises T2TwinError without any."""
    found = sorted(str(path) for path in Path(folder).glob("*") if _is_solid(path.suffix))
    if not found:
        raise T2TwinError(
            f"{folder} contains no solids; shapes must be random, primitives, tools, or a folder "
            f"with files of {', '.join(mesh_files.SUFFIXES)}"
        )
    return tuple(found)


def load_shape(part: Part, source: str, cache_dir: str | Path | None = None) -> Shape:
    """A shape of a part by its name or file. cache_dir and errors: as for catalogue.load."""
    if part.shapes in NAMED:
        return catalogue.load(source, cache_dir)
    hints = mesh_files.Hints(
        scale="scale = {:g} in this part of the recipe", center="center = true in this part"
    )
    return catalogue.load(source, cache_dir, part.solid_scale, bool(part.center), hints)


def _is_solid(suffix: str) -> bool:
    """Whether files of this suffix contain solids."""
    return suffix.lower() in mesh_files.SUFFIXES


def _part_batches(
    recipe: Recipe, number: int, part: Part, names: tuple[str, ...]
) -> Iterator[Batch]:
    shapes = _shapes(recipe, number, names)
    if part.place == "grid":
        for place, name in enumerate(shapes):
            indices, split = grid_indices(part, name), _split(part, name, place, len(shapes))
            yield Batch(
                shard_path(split, name), split, number, (name,), (place,), indices, len(indices)
            )
        return
    assert part.presses is not None
    shapes_per_shard = max(1, round(PRESSES_PER_SHARD / part.presses))
    by_split: dict[Split, list[int]] = {}
    for place, name in enumerate(shapes):
        by_split.setdefault(_split(part, name, place, len(shapes)), []).append(place)
    if part.val_share and "val" not in by_split:
        raise T2TwinError(
            f"val_share of the part of {part.shapes} shapes is {part.val_share:g}, which is "
            "less than half a shape; expected a larger share, or more shapes"
        )
    for split, places in by_split.items():
        for nth, start in enumerate(range(0, len(places), shapes_per_shard)):
            mine = tuple(places[start : start + shapes_per_shard])
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
    """Names or files of the shapes of a part, by its number."""
    part = recipe.parts[number]
    if part.shapes == RANDOM:
        assert part.count is not None
        if recipe.seed > MAX_SHAPE_SEED:
            raise T2TwinError(
                f"the seed of a recipe of random shapes is {recipe.seed}; it must be at most "
                f"{MAX_SHAPE_SEED}"
            )
        # No two parts share a shape, since their splits may differ.
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
