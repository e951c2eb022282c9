"""A recipe: the distributions of shapes, positions, forces and light; a bundled or a TOML file."""

from collections.abc import Sequence
from math import log
from pathlib import Path
from typing import Annotated, Literal

from msgspec import UNSET, Meta, Struct, UnsetType, structs, to_builtins

from t2twin.core import arguments
from t2twin.core.arguments import MAX_SEED
from t2twin.core.errors import T2TwinError, warn
from t2twin.core.records import convert, read_toml
from t2twin.primitives_cad.tilt import MAX_TILT_DEG
from t2twin.sim.contact.types import FORCE_RANGE_N
from t2twin.sim.optical.artifacts import Artifacts
from t2twin.sim.optical.spec import KIND as GEL_CAMERA
from t2twin.sim.optical.spec import Ranges
from t2twin.sim.optical.units import UnitRanges
from t2twin.sim.sensors.defaults import SOURCE, TARGET
from t2twin.sim.taxels.spec import KIND as TAXEL_ARRAY

RECIPES = Path(__file__).parent / "recipes"
PAPER = "paper"  # the protocol of Grella et al. 2023
RANDOM = "random"
NAMED = (RANDOM, "primitives", "tools")  # values of a part's shapes other than a folder

# Limits that have no source are assumed: beyond them a dataset takes weeks, or presses miss.
MIN_FORCE_SHARE = 0.1  # of a force range that leave_out must leave, in the logarithm of the force
MAX_PRESSES = 10_000  # of a shape
MAX_FORCES = 100  # forces in a list, and ranges in leave_out
SHARE_TOLERANCE = 1e-6  # rounding of a sum of shares

Split = Literal["train", "val", "test"]
Share = Annotated[float, Meta(ge=0.0, le=0.9)]
MotionShare = Annotated[float, Meta(ge=0.0, le=1.0)]
Force = Annotated[float, Meta(ge=FORCE_RANGE_N[0], le=FORCE_RANGE_N[1])]
Reach = Annotated[float, Meta(ge=0.0, le=25.0)]
Tilt = Annotated[float, Meta(ge=0.0, le=MAX_TILT_DEG)]
Length = Annotated[float, Meta(ge=0.01, le=25.0)]
Turn = Annotated[float, Meta(ge=0.1, le=180.0)]
Steps = Annotated[int, Meta(ge=1, le=100)]
Ratio = Annotated[float, Meta(ge=0.1, le=10.0)]
Friction = Annotated[float, Meta(ge=0.01, le=5.0)]
Forces = Annotated[tuple[Force, ...], Meta(min_length=1, max_length=MAX_FORCES)]


class Place(Struct, frozen=True, forbid_unknown_fields=True):
    """Distribution of presses around a shape's middle.

    normal_mm: standard deviation along x and y; or uniform_mm: half the side of a square. tilt_deg:
    angle between the shape's and the press axis, up to a maximum or in a range, in any direction.
    """

    normal_mm: Reach | None = None
    uniform_mm: Reach | None = None
    # A tuple of fixed length next to a constrained number crashes msgspec 0.22.
    tilt_deg: Tilt | Annotated[tuple[Tilt, ...], Meta(min_length=2, max_length=2)] | UnsetType = (
        UNSET
    )

    def __post_init__(self) -> None:
        if (self.normal_mm is None) == (self.uniform_mm is None):
            raise T2TwinError("place must have one of normal_mm and uniform_mm")
        low, high = self.tilt_range_deg
        if low > high:
            raise T2TwinError(f"tilt_deg of place is [{low:g}, {high:g}]; expected low first")

    @property
    def tilt_range_deg(self) -> tuple[float, float]:
        """Least and largest tilt."""
        if isinstance(self.tilt_deg, tuple):
            low, high = self.tilt_deg
            return low, high
        return 0.0, self.tilt_deg or 0.0


class ForceRange(Struct, frozen=True, forbid_unknown_fields=True):
    """Log-uniform forces from low to high, N, except those in the ranges of leave_out."""

    low: Force
    high: Force
    leave_out: Annotated[tuple[tuple[Force, Force], ...], Meta(max_length=MAX_FORCES)] = ()

    def __post_init__(self) -> None:
        if not self.low < self.high:
            raise T2TwinError(f"force_n is {self.low:g} to {self.high:g}; expected low below high")
        for first, last in self.leave_out:
            if not self.low <= first < last <= self.high:
                raise T2TwinError("leave_out of force_n must lie within it, low before high")
        if self.remaining_share() < MIN_FORCE_SHARE:
            raise T2TwinError(
                f"leave_out leaves {100 * self.remaining_share():.3g} % of force_n's range; at "
                f"least {100 * MIN_FORCE_SHARE:g} % must remain, in the logarithm of the force"
            )

    def remaining_share(self) -> float:
        """The share of the range outside leave_out, in the logarithm of the force."""
        omitted, end = 0.0, self.low
        for first, last in sorted(self.leave_out):
            if last > end:
                omitted += log(last / max(first, end))
                end = last
        return 1.0 - omitted / log(self.high / self.low)


class Part(Struct, frozen=True, forbid_unknown_fields=True):
    """Shapes and their presses; docs/reference/file-formats.md lists the keys.

    A grid has each press with each force of a list; other presses sample one. scale: of the grid
    (protocol.SCALES), or of files, mm per unit.
    """

    shapes: str
    split: Literal["train", "val", "test", "by-version"] = "train"
    count: Annotated[int, Meta(ge=1, le=1_000_000)] | None = None
    presses: Annotated[int, Meta(ge=1, le=MAX_PRESSES)] | None = None
    place: Literal["grid"] | Place = "grid"
    scale: Literal["smoke", "light", "small", "paper"] | Annotated[float, Meta(gt=0)] = "paper"
    center: bool | UnsetType = UNSET
    force_n: Force | Forces | ForceRange = 8.0
    background_share: Share = 0.0
    val_share: Share = 0.0

    def __post_init__(self) -> None:
        on_grid, on_catalogue = self.place == "grid", self.shapes in ("primitives", "tools")
        is_random, by_version = self.shapes == RANDOM, self.split == "by-version"
        of_grid = self.scale in ("smoke", "light", "small")
        of_files = bool(self.center) or self.solid_scale is not None
        has_shares, is_tools = self.background_share or self.val_share, self.shapes == "tools"
        for is_wrong, reason in (
            (is_random and self.count is None, "count is missing, the number of random shapes"),
            (not is_random and self.count is not None, "count is for random shapes only"),
            (not on_grid and self.presses is None, "presses is missing, the number for each shape"),
            (on_grid and self.presses is not None, "presses is for a distribution of place only"),
            (on_grid and not on_catalogue, "only primitives and tools have the protocol's grid"),
            (on_grid and has_shares, "the grid must not have background_share or val_share"),
            (by_version and self.shapes != "primitives", "only primitives can be split by-version"),
            (by_version and self.val_share, "split by-version must not have val_share"),
            (self.split == "val" and self.val_share, "split val must not have val_share"),
            (not on_grid and of_grid, f"scale {self.scale} has no effect, as it is of the grid"),
            (self.shapes in NAMED and of_files, "center and mm per unit are for files only"),
            (is_tools and self.split != "test", "the split of tools must be test"),
        ):
            if is_wrong:
                raise T2TwinError(f"the part of {self.shapes} shapes: {reason}")

    @property
    def range_n(self) -> tuple[float, float]:
        """Smallest and largest force of its presses, N."""
        if isinstance(self.force_n, ForceRange):
            return self.force_n.low, self.force_n.high
        listed = self.force_n if isinstance(self.force_n, tuple) else (self.force_n,)
        return min(listed), max(listed)

    @property
    def solid_scale(self) -> float | None:
        """mm per unit of the files; None for their own unit."""
        return None if isinstance(self.scale, str) else float(self.scale)


class Light(Struct, frozen=True, forbid_unknown_fields=True):
    """The light of gel cameras: one unit for all, or a sampled unit for each shape or press.

    optics: a file of `t2twin calibrate`, the fixed unit or the center of the sampled ones, of the
    first gel camera. frames: averaged for an image. fixed_share: of the units that are the fixed
    one, without artifacts. artifacts: of the sampled units.
    """

    kind: Literal["fixed", "drawn"] = "fixed"
    optics: str | None = None
    each: Literal["shape", "press"] = "shape"
    renderer: Literal["baked", "pyrender"] = "baked"
    draw: UnitRanges = UnitRanges()
    fixed_share: Share = 0.0
    frames: Annotated[int, Meta(ge=1, le=10_000)] | None = None
    artifacts: Artifacts | UnsetType = UNSET

    def __post_init__(self) -> None:
        for name, default in _defaults(self.draw).items():
            is_unused = name.startswith("around_") == (self.optics is None)
            if is_unused and getattr(self.draw, name) != default:
                state = "has no" if self.optics is None else "has an"
                raise T2TwinError(
                    f"{name} of light.draw has no effect, as light {state} optics file around "
                    "which units are sampled"
                )


class Motion(Ranges, frozen=True):
    """Distribution of the paths of sampled presses; presses on the grid stay still.

    still, slide, twist: shares of the paths. Ranges are log-uniform, steps uniform. steps: touches
    of a path after its press. force_change: force at the end over that at the start. gel_friction,
    cover_friction: of a shape. markers: share of the units with markers. Defaults are assumed.
    """

    still: MotionShare = 0.4
    slide: MotionShare = 0.4
    twist: MotionShare = 0.2
    slide_mm: tuple[Length, Length] = (0.1, 4.0)
    twist_deg: tuple[Turn, Turn] = (1.0, 20.0)
    steps: tuple[Steps, Steps] = (1, 4)
    force_change: tuple[Ratio, Ratio] = (0.7, 1.4)
    gel_friction: tuple[Friction, Friction] = (0.4, 1.5)
    cover_friction: tuple[Friction, Friction] = (0.5, 1.5)
    markers: MotionShare = 0.0

    def __post_init__(self) -> None:
        if abs(self.still + self.slide + self.twist - 1.0) > SHARE_TOLERANCE:
            raise T2TwinError(
                f"still, slide and twist of motion are {self.still:g}, {self.slide:g} and "
                f"{self.twist:g}; expected shares whose sum is 1"
            )
        super().__post_init__()


EFFECTS = (
    ("light", "kind", "fixed", "each draw fixed_share artifacts"),
    ("motion", "slide", 0, "slide_mm"),
    ("motion", "twist", 0, "twist_deg"),
    ("motion", "slide twist", 0, "steps force_change gel_friction cover_friction"),
    ("light.draw", "linear_amount", 0, "linear_gamma"),
    ("light.draw", "linear_amount", 1, "gamma"),
    ("light.draw", "leak_amount", 0, "leak_part"),
    ("light.draw", "follow_amount", 1, "gradient_part"),
    ("light.draw", "edge_dark_amount", 0, "edge_px edge_soft_px"),
    ("light.draw", "specks", 0, "speck_px speck_grey"),
    ("light.artifacts", "streaks", 0, "streak_grey streak_px streak_length_px streak_off_deg"),
    ("light.artifacts", "streaks", 0, "streak_bend_part streak_moved_px"),
    ("light.artifacts", "glares", 0, "glare_grey glare_px"),
    ("light.artifacts", "streaks glares", 0, "changed_part other_color_part"),
    ("light.artifacts", "worn", 0, "wear_part speckle_part"),
    ("light.artifacts", "drift_grey", 0, "drift_even_part"),
)
"""Of a table, the amounts of an effect, the value of all that disables it, and its details."""
# Keys that have an effect on sensors of a kind only; each is valid without those before it
KINDS = {
    GEL_CAMERA: (
        "contact_maps", "background_frames", "motion.markers", "motion.gel_friction", "light",
    ),
    TAXEL_ARRAY: ("dense_counts", "motion.cover_friction"),
}  # fmt: skip
NEEDS = {0: "above 0", 1: "below 1", "fixed": '= "drawn"'}  # by the value that disables an effect


def _defaults(record: Struct) -> dict[str, object]:
    """The default of each field of a record that has one."""
    return dict(zip(record.__struct_fields__[::-1], record.__struct_defaults__[::-1], strict=False))


def _check_effects(table: str, record: Struct) -> None:
    """Raises T2TwinError for a detail of an effect that the record disables."""
    for of, amounts, off, details in EFFECTS:
        values = [getattr(record, name) for name in amounts.split()] if of == table else []
        if values and all(value in (off, (off, off)) for value in values):
            for name in details.split():
                if getattr(record, name) != _defaults(record)[name]:
                    needed = f"{amounts.replace(' ', ' or ')} {NEEDS[off]}"
                    raise T2TwinError(f"{name} of {table} needs {needed}")


def for_pair(recipe: "Recipe", kinds: Sequence[str]) -> "Recipe":
    """The recipe, complete, for a pair of sensors of these kinds.

    Keys without effect on them are left out of a bundled recipe, with a T2TwinWarning; of any other
    recipe they raise T2TwinError.
    """
    own, is_bundled = {"source": SOURCE, "target": TARGET, "seed": 0}, False
    if recipe.name in bundled_recipes():
        bundled = structs.replace(load_recipe(recipe.name), **own)
        is_bundled = structs.replace(recipe, **own) == bundled
    for key, needed in ((key, kind) for kind in KINDS if kind not in kinds for key in KINDS[kind]):
        *table, name = key.split(".")
        record = getattr(recipe, table[0]) if table else recipe
        if not record or getattr(record, name) in (False, default := _defaults(record)[name]):
            continue
        found = f"{key} needs a {needed.replace('-', ' ')}; neither sensor is one"
        if not is_bundled:
            raise T2TwinError(found)
        warn(f"{found}, so it is left out of the recipe {recipe.name}")
        record = structs.replace(record, **{name: default})
        recipe = structs.replace(recipe, **{table[0]: record}) if table else record
    has = {"dense_counts": TAXEL_ARRAY in kinds, "background_frames": GEL_CAMERA in kinds}
    return structs.replace(recipe, **{k: v for k, v in has.items() if getattr(recipe, k) is UNSET})


class Recipe(Struct, frozen=True, forbid_unknown_fields=True):
    """What is sampled into a dataset; docs/reference/file-formats.md lists the keys.

    source, target: names or files of sensors. layout, imperfections: of taxel arrays; None for
    those of the sensor's file. Fields that are UNSET are left out of info.json.
    """

    name: Annotated[str, Meta(min_length=1, max_length=60)]
    parts: Annotated[tuple[Part, ...], Meta(min_length=1, max_length=50)]
    seed: Annotated[int, Meta(ge=0, le=MAX_SEED)] = 0
    source: str = SOURCE
    target: str = TARGET
    layout: str | None = None
    imperfections: str | None = None
    light: Light = Light()
    dense_counts: bool | UnsetType = UNSET  # unless given: whether the pair has such a sensor
    background_frames: bool | UnsetType = UNSET  # the same
    motion: Motion | UnsetType = UNSET
    contact_maps: bool | UnsetType = UNSET

    def __post_init__(self) -> None:
        _check_effects("light", self.light)
        _check_effects("light.draw", self.light.draw)
        if self.light.artifacts:
            _check_effects("light.artifacts", self.light.artifacts)
        if self.motion:
            _check_effects("motion", self.motion)
        own = [part.shapes for part in self.parts if part.place == "grid"]
        if len(own) != len(set(own)):
            raise T2TwinError("two parts press the same shapes on the grid; expected at most one")
        if self.motion and len(own) == len(self.parts):
            raise T2TwinError("motion needs a part whose place is a distribution, not the grid")
        moves = self.motion and self.motion.still < 1.0
        for part in (each for each in self.parts if moves and each.presses):
            assert self.motion and part.presses
            if part.presses <= (most := self.motion.steps[1]):
                needed = f"motion needs {most + 1} presses or more, by its steps"
                raise T2TwinError(f"{needed}; a part has {part.presses}")
            ends = [n * f for n, f in zip(part.range_n, self.motion.force_change, strict=True)]
            if ends[0] < FORCE_RANGE_N[0] or ends[1] > FORCE_RANGE_N[1]:
                raise T2TwinError(
                    f"force_n times force_change of motion is {ends[0]:g} to {ends[1]:g}; expected "
                    f"{FORCE_RANGE_N[0]:g} to {FORCE_RANGE_N[1]:g}"
                )
        if self.motion and self.light.kind == "fixed" and self.motion.markers not in (0.0, 1.0):
            raise T2TwinError(
                f"markers of motion is {self.motion.markers:g}; expected 0 or 1, as a fixed light "
                "has one unit"
            )

    @property
    def has_tilt(self) -> bool:
        """Whether a part samples a tilt; its pairs then have the columns of the tilt."""
        return any(
            isinstance(part.place, Place) and part.place.tilt_deg is not UNSET
            for part in self.parts
        )

    @property
    def force_range_n(self) -> tuple[float, float]:
        """Smallest and largest force of its presses, N, before a path changes it."""
        lows, highs = zip(*(part.range_n for part in self.parts), strict=True)
        return min(lows), max(highs)


def bundled_recipes() -> tuple[str, ...]:
    """Names of the bundled recipes."""
    return tuple(sorted(path.stem for path in RECIPES.glob("*.toml")))


def load_recipe(source: str | Path) -> Recipe:
    """A bundled recipe by its name, or a recipe from a TOML file.

    source: its name or path. Raises T2TwinError for an unknown name, an unreadable file, and a
    missing, unknown or invalid field.
    """
    path = arguments.path(source, "recipe")
    if str(source) in bundled_recipes():
        path = RECIPES / f"{source}.toml"
    elif path.suffix != ".toml":
        raise T2TwinError(
            f"there is no recipe {str(source)!r}; allowed are {', '.join(bundled_recipes())} "
            "and .toml files"
        )
    return convert(read_toml(path), Recipe, path)


def checked(recipe: Recipe) -> Recipe:
    """Validates a recipe that was constructed in Python. Raises as `load_recipe` does."""
    try:
        content = to_builtins(recipe)
    except TypeError:  # a value that JSON cannot represent
        raise T2TwinError("the recipe has values other than numbers, text and lists") from None
    return convert(content, Recipe, "the recipe")
