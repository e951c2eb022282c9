"""A world's recipe: from which distributions shapes, places, turns, forces and light are drawn.

One small TOML file, or the name of one that ships:

    format = 1
    name = "mine"
    seed = 0
    [[parts]]
    shapes = "random"
    count = 1000
    presses = 4
    place = { normal_mm = 2.5 }
    force_n = { low = 0.5, high = 12.0 }
    [light]
    kind = "drawn"

Paths in it are taken from the folder in which the command runs, as the command's own are.
"""

import tomllib
from dataclasses import fields
from math import log
from pathlib import Path
from typing import Annotated, Any, Literal

from msgspec import Meta, Struct, to_builtins
from msgspec.structs import force_setattr

from t2twin.core import arguments
from t2twin.core.arguments import MAX_SEED
from t2twin.core.errors import T2TwinError
from t2twin.core.files import read_file
from t2twin.core.records import convert
from t2twin.core.renames import new_name
from t2twin.sim.contact.types import FORCE_RANGE_N
from t2twin.sim.cyskin.layout import DEFAULT_LAYOUT
from t2twin.sim.digit.optics import FRAMES
from t2twin.sim.digit.randomization.ranges import UnitRanges

RECIPES = Path(__file__).parent / "recipes"
PAPER = "paper"
"""The world that is the protocol of Grella et al. 2023."""

RANDOM = "random"
NAMED = (RANDOM, "primitives", "tools")
"""What a part's shapes are called that are no folder's; the first are the random ones."""

FORMAT = 1

MAX_RECIPE_BYTES = 1_000_000
"""Largest recipe that is read, bytes (assumed: some hundred times a long one)."""

MIN_FORCE_SHARE = 0.1
"""Least share of a range of forces that leave_out must leave, in the logarithm of the force
(assumed: forces are sampled again until one is allowed)."""

MAX_FORCES = 100
"""Most forces in a list, and most ranges that are left out (assumed)."""

MAX_SHAPES, MAX_PRESSES = 1_000_000, 10_000
"""Most random shapes of a part, and most presses of a shape (assumed: weeks of two cores)."""

MAX_FRAMES = 10_000
"""Most frames averaged for a picture (assumed: minutes of a camera)."""

FARTHEST_MM = 25.0
"""Farthest that a press may be meant to lie from a shape's middle, mm (assumed: beyond it most
would miss)."""

Share = Annotated[float, Meta(ge=0.0, le=0.9)]
Force = Annotated[float, Meta(ge=FORCE_RANGE_N[0], le=FORCE_RANGE_N[1])]
Reach = Annotated[float, Meta(ge=0.0, le=FARTHEST_MM)]
Split = Literal["train", "val", "test"]


class Place(Struct, frozen=True, forbid_unknown_fields=True):
    """Where presses lie about a shape's middle, one of the two: standard deviation of a normal
    distribution along x and y, or half the side of a square, mm."""

    normal_mm: Reach | None = None
    uniform_mm: Reach | None = None

    def __post_init__(self) -> None:
        if (self.normal_mm is None) == (self.uniform_mm is None):
            raise T2TwinError("place must have one of normal_mm and uniform_mm")


class ForceRange(Struct, frozen=True, forbid_unknown_fields=True):
    """Forces from low to high, N, log-uniformly, but for the ranges that are left out."""

    low: Force
    high: Force
    leave_out: Annotated[tuple[tuple[Force, Force], ...], Meta(max_length=MAX_FORCES)] = ()

    def __post_init__(self) -> None:
        if not self.low < self.high:
            raise T2TwinError("force_n must have its low below its high")
        for first, last in self.leave_out:
            if not self.low < first < last < self.high:
                raise T2TwinError("what force_n leaves out must lie within it, low before high")
        if self.share_left() < MIN_FORCE_SHARE:
            raise T2TwinError(
                f"force_n leaves {100 * self.share_left():.3g} % of its range; at least "
                f"{100 * MIN_FORCE_SHARE:g} % must be left, in the logarithm of the force"
            )

    def share_left(self) -> float:
        """The share of the range that is not left out, in the logarithm of the force."""
        left_out, end = 0.0, self.low
        for first, last in sorted(self.leave_out):
            if last > end:
                left_out += log(last / max(first, end))
                end = last
        return 1.0 - left_out / log(self.high / self.low)


class Part(Struct, frozen=True, forbid_unknown_fields=True):
    """Some shapes, and how they are pressed.

    shapes: "random", "primitives", "tools", or a folder of solids' files. count: how many random
    ones; all there are of the others. presses: how many of each shape, where place is no grid.
    place: "grid", the protocol's with its orientations, or a distribution. scale: of the grid (see
    protocol.SCALES). force_n: one, a list, or a range; on a grid of a list, every press with each;
    else each press draws one. untouched_share: of the presses, in which nothing touches. split:
    where the shapes go; of the primitives "by-version" as the protocol has it. val_share: of the
    shapes, which go to validation instead, the last ones.
    """

    shapes: str
    split: Literal["train", "val", "test", "by-version"] = "train"
    count: Annotated[int, Meta(ge=1, le=MAX_SHAPES)] | None = None
    presses: Annotated[int, Meta(ge=1, le=MAX_PRESSES)] | None = None
    place: Literal["grid"] | Place = "grid"
    scale: Literal["smoke", "small", "paper"] = "paper"
    force_n: Force | Annotated[tuple[Force, ...], Meta(max_length=MAX_FORCES)] | ForceRange = 8.0
    untouched_share: Share = 0.0
    val_share: Share = 0.0

    def __post_init__(self) -> None:
        named = f"the part of {self.shapes} shapes"
        if (self.shapes == RANDOM) != (self.count is not None):
            raise T2TwinError(f"{named}: count belongs to random shapes, which need it")
        if (self.place == "grid") == (self.presses is not None):
            raise T2TwinError(f"{named}: presses belongs to a place that is no grid")
        if self.place == "grid" and self.shapes not in ("primitives", "tools"):
            raise T2TwinError(f"{named}: the grid is the protocol's, of primitives and tools")
        if self.place == "grid" and (self.untouched_share or self.val_share):
            raise T2TwinError(f"{named}: a grid has no untouched_share and no val_share")
        if self.split == "by-version" and self.shapes != "primitives":
            raise T2TwinError(f"{named}: only primitives are split by-version")
        if self.split == "by-version" and self.val_share:
            raise T2TwinError(f"{named}: by-version leaves no val_share")
        if self.force_n == ():
            raise T2TwinError(f"{named}: force_n is an empty list")
        if self.shapes == "tools" and self.split != "test":
            raise T2TwinError("the tools are the test's, for all worlds alike; their split is test")


class Light(Struct, frozen=True, forbid_unknown_fields=True):
    """The DIGIT's light.

    kind: "fixed", one unit for all; "drawn", another unit for each shape or press.
    calibration: a file of `t2twin calibrate`, the fixed unit or the middle of the draw; without it
    the one that ships, or the shipped distribution. draw: the distribution's ranges. optics:
    "baked", or "pyrender", seconds a picture. frames: how many are averaged for a picture, which
    lowers their noise: 30 in the protocol, 1 for who translates single frames.
    """

    kind: Literal["fixed", "drawn"] = "fixed"
    calibration: str | None = None
    each: Literal["shape", "press"] = "shape"
    optics: Literal["baked", "pyrender"] = "baked"
    draw: UnitRanges = UnitRanges()
    frames: Annotated[int, Meta(ge=1, le=MAX_FRAMES)] = FRAMES


class Recipe(Struct, frozen=True, forbid_unknown_fields=True):
    """A world.

    name: what it is called in tables. seed: of everything that is drawn. layout, imperfections:
    the CySkin's. field: whether each pair holds the field (t2twin.sim.cyskin.field).
    untouched_frames: whether each pair holds a picture of its DIGIT untouched.
    """

    name: Annotated[str, Meta(min_length=1, max_length=60)]
    parts: Annotated[tuple[Part, ...], Meta(min_length=1, max_length=50)]
    format: Literal[1] = FORMAT
    seed: Annotated[int, Meta(ge=0, le=MAX_SEED)] = 0
    layout: str = DEFAULT_LAYOUT
    imperfections: Literal["none", "white", "baseline", "all", "untouched"] = "white"
    light: Light = Light()
    field: bool = True
    untouched_frames: bool = True

    def __post_init__(self) -> None:
        for number, part in enumerate(arguments.instance(self.parts, "parts", tuple)):
            arguments.instance(part, f"parts[{number}]", Part)
        if renamed := new_name("value", self.imperfections):
            force_setattr(self, "imperfections", renamed)
        own = [part.shapes for part in self.parts if part.place == "grid"]
        if len(own) != len(set(own)):
            raise T2TwinError(
                "two parts press the same shapes on the grid; each may be pressed so once"
            )

    @property
    def has_more(self) -> bool:
        """Whether its pairs hold more than the protocol's do."""
        return self.field or self.untouched_frames


def shipped() -> tuple[str, ...]:
    """Names of the worlds that ship."""
    return tuple(sorted(path.stem for path in RECIPES.glob("*.toml")))


def load_recipe(source: str | Path) -> Recipe:
    """A recipe by its name, or from a user's TOML file.

    Raises T2TwinError for an unknown name, a file that cannot be read, and a field that is
    missing, unknown or wrong.
    """
    path = RECIPES / f"{arguments.path(source, 'world')}.toml"
    if str(source) not in shipped():
        path = Path(source)
        if path.suffix != ".toml":
            raise T2TwinError(
                f"there is no world {str(source)!r}; those that ship are {', '.join(shipped())}, "
                "and a .toml file is also allowed"
            )
    text = read_file(path, MAX_RECIPE_BYTES)
    try:
        content = tomllib.loads(text.decode("utf-8-sig"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise T2TwinError(f"{path} is not TOML ({error})") from error
    recipe = convert(content, Recipe, path)
    _check_draw(content.get("light", {}).get("draw", {}), path)
    return recipe


def checked(recipe: Recipe) -> Recipe:
    """A recipe that was made in Python, whose fields have the right types and bounds.

    Raises T2TwinError as `load_recipe` does.
    """
    try:
        content = to_builtins(recipe)
    except TypeError:  # a value that JSON does not have
        raise T2TwinError("the recipe holds values that are no numbers, text or lists") from None
    return convert(content, Recipe, "the recipe")


def _check_draw(given: dict[str, Any], path: Path) -> None:
    """A dataclass takes any key without a word; one that is misspelt shall not pass."""
    known = [field.name for field in fields(UnitRanges)]
    for name in given:
        if name not in known:
            raise T2TwinError(
                f"{path}: light.draw has no {name}; it may have {', '.join(sorted(known))}"
            )
