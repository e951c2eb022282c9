"""Presses of 5,125 random shapes, and whether they cover the presses of the tools.

    python -m benchmarks random_presses

The shapes have seeds of no published recipe, with four presses each, sampled as in the open recipe.
Counts failed, repeated and unsettled presses.

Writes docs/pictures/random_shapes.png and docs/pictures/open_recipe.png. The latter has
distributions of force, depth, contact area and largest taxel, next to those of the tools.
"""

from __future__ import annotations

import multiprocessing
import time
from argparse import Namespace
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from msgspec import structs
from PIL import Image, ImageDraw
from tqdm import tqdm

from benchmarks import ROOT
from benchmarks.evidence import Argument, Benchmark, Figure
from t2twin.core.files import atomic_write
from t2twin.core.machine import cores
from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.random_shapes import random_shape
from t2twin.primitives_cad.shape import Shape
from t2twin.sim.contact.types import PressCommand
from t2twin.sim.dataset.shard import press_until_accepted
from t2twin.sim.sampling import protocol
from t2twin.sim.sampling.plan import SEEDS_PER_RECIPE, MotionPath, path_attempts, sample_force
from t2twin.sim.sampling.recipe import Recipe, load_recipe
from t2twin.sim.sensors.pair import SensorPair
from t2twin.sim.touch import Touch

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Page

BENCHMARK = Benchmark(
    module="benchmarks.datasets.random_presses",
    minutes=10,
    sources=("primitives_cad", "sim"),
    figures=(
        Figure("presses"),
        Figure("exceptions", most=0),
        Figure("unsettled", most=0),
        Figure("drawn_again_percent", "%"),
        Figure("tail.press.p99_over_median", most=3.0),
        Figure("spread.*.tools_inside_percent", "%", least=95.0),
    ),
    arguments=(
        Argument("--presses", "how many; keeps nothing unless 20,500", int, 20_500, partial=True),
    ),
)

SHAPES_PICTURE = ROOT / "docs" / "pictures" / "random_shapes.png"
SPREAD_PICTURE = ROOT / "docs" / "pictures" / "open_recipe.png"

SEED = 4_321
"""A recipe's seed that no shipped recipe has."""

A_SHAPE = 4
CHUNK = 50
"""Presses of a shape, and shapes that a process takes at once."""

QUANTITIES = ("force_n", "depth_mm", "area_mm2", "largest_taxel_counts")
AXES = {
    "force_n": "force, N",
    "depth_mm": "depth in the DIGIT's gel, mm",
    "area_mm2": "contact area on the CySkin, mm²",
    "largest_taxel_counts": "largest taxel, counts",
}
"""What is compared with the tools', and how the picture calls it."""

INNER_PERCENT = (0.5, 99.5)
"""Percentiles of the random presses between which a tool's press counts as inside."""

SHEET = (6, 10)
TILE_PX = (170, 150)
"""Rows and columns of shapes in their picture, and a shape's pixels."""

FORCES_N = (0.5, 1.0, 2.0, 4.0, 8.0, 12.0)
"""Edges of the forces for which saturation is stated, N."""

BARS = 30
"""Bars of a histogram, even in the logarithm."""


@dataclass
class Pressed:
    """What came of some shapes. values: of each press, by QUANTITIES. again: presses that were
    sampled again, by why. exceptions: what was raised that is no refusal. press_ms: the processor's
    time of each pair."""

    values: list[tuple[float, ...]] = field(default_factory=list)
    again: Counter[str] = field(default_factory=Counter)
    exceptions: list[str] = field(default_factory=list)
    press_ms: list[float] = field(default_factory=list)

    def add(self, other: Pressed) -> None:
        self.values += other.values
        self.again += other.again
        self.exceptions += other.exceptions
        self.press_ms += other.press_ms


def measure(options: Namespace) -> dict[str, Any]:
    shapes = options.presses // A_SHAPE
    everything, starts = Pressed(), range(0, shapes, CHUNK)
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(cores(), mp_context=context) as pool:
        work = partial(press_some, last=shapes)
        for some in tqdm(pool.map(work, starts), total=len(starts), unit="50 shapes"):
            everything.add(some)
        tools = np.array([row for rows in pool.map(press_tool, catalogue.OBJECTS) for row in rows])
    values = np.array(everything.values)
    if not options.keep_nothing:
        draw_shapes()
        draw_spread(values, tools)
    return {
        "shapes": shapes,
        "presses": len(values),
        "exceptions": len(everything.exceptions),
        "unsettled": everything.again["not settled"],
        "drawn_again": dict(sorted(everything.again.items())),
        "drawn_again_percent": 100.0 * sum(everything.again.values()) / len(values),
        "tail": {"press": tail(everything.press_ms)},
        "spread": spread(values, tools),
        "by_force": {"random": by_force(values), "tools": by_force(tools)},
    }


def tail(times_ms: list[float]) -> dict[str, float]:
    """How long the slowest presses take beside the usual one."""
    median, p99 = np.percentile(times_ms, [50, 99])
    return {
        "median_ms": float(median),
        "p99_ms": float(p99),
        "most_ms": max(times_ms),
        "p99_over_median": float(p99 / median),
    }


def press_some(first: int, last: int) -> Pressed:
    """The shapes of a chunk that begins with the first, four presses each."""
    sensors, made = SensorPair(), Pressed()
    recipe = structs.replace(load_recipe("open"), seed=SEED)
    sensors.press(random_shape(0), PressCommand("", 0.0, 0.0, 0.0, 8.0))  # compiled, laid out
    for number in range(first, min(first + CHUNK, last)):
        shape = catalogue.load(f"random-{SEED * SEEDS_PER_RECIPE + number}")
        for press in range(A_SHAPE):
            _press(recipe, shape, number, press, sensors, made)
    return made


def _press(
    recipe: Recipe, shape: Shape, number: int, press: int, sensors: SensorPair, made: Pressed
) -> None:
    """One press, drawn until it touches the features, as a dataset's."""
    took_ms = 0.0

    def press_it(shape: Shape, commands: Sequence[PressCommand], rng: Any) -> list[Touch]:
        nonlocal took_ms
        start = time.thread_time()
        touch = sensors.press(shape, commands[0], rng)
        took_ms = 1e3 * (time.thread_time() - start)
        return [touch]

    attempts = path_attempts(recipe, 0, shape.name, number, MotionPath(press))
    try:
        (touch,), _ = press_until_accepted(attempts, shape, press_it, made.again)
    except Exception as error:
        made.exceptions.append(f"{shape.name}: {type(error).__name__}: {error}")
        return
    if not touch.contacts:
        return
    made.press_ms.append(took_ms)
    made.values.append(_values(touch))


def _values(sample: Touch) -> tuple[float, ...]:
    """By QUANTITIES."""
    return (
        sample.command.force_n,
        sample.digit.depth_mm,
        sample.cyskin.contact_area_mm2,
        float(sample.counts.max()),
    )


def press_tool(name: str) -> list[tuple[float, ...]]:
    """A tool's presses on the protocol's grid at a keypoint, with forces of the open recipe."""
    sensors, shape = SensorPair(), catalogue.load(name)
    forces = load_recipe("open").parts[0].force_n
    place, rows = catalogue.NAMES.index(name), []
    for index in protocol.indices(name, protocol.SCALES["paper"]):
        rng = np.random.default_rng((SEED, place, index))
        at = protocol.press_of(name, shape.spacing_mm, index)
        force_n = sample_force(rng, forces)
        command = PressCommand(name, at.x_mm, at.y_mm, at.yaw_rad, force_n)
        rows.append(_values(sensors.press(shape, command, rng)))
    return rows


def spread(values: np.ndarray, tools: np.ndarray) -> dict[str, dict[str, Any]]:
    """Percentiles of both, and the share of the tools' presses that lie inside, by quantity."""
    percents = (INNER_PERCENT[0], 50.0, INNER_PERCENT[1])
    content = {}
    for column, name in enumerate(QUANTITIES):
        low, middle, high = np.percentile(values[:, column], percents)
        inside = (tools[:, column] >= low) & (tools[:, column] <= high)
        content[name] = {
            "random": [float(low), float(middle), float(high)],
            "tools": [float(each) for each in np.percentile(tools[:, column], percents)],
            "tools_inside_percent": 100.0 * float(inside.mean()),
        }
    return content


def by_force(values: np.ndarray) -> list[dict[str, float]]:
    """What the largest taxel counts, and how many presses saturate one, by force."""
    force, largest = values[:, QUANTITIES.index("force_n")], values[:, -1]
    full_scale = SensorPair().array.full_scale
    content = []
    for low, high in pairwise(FORCES_N):
        chosen = largest[(force >= low) & (force < high)]
        saturated = float((chosen >= full_scale - 1).mean())
        content.append(
            {
                "low_n": low,
                "high_n": high,
                "median_counts": float(np.median(chosen)),
                "saturated_percent": 100.0 * saturated,
            }
        )
    return content


def draw_spread(values: np.ndarray, tools: np.ndarray) -> None:
    """The distributions side by side, each as a share of its presses."""
    from t2twin.core.draw import figure

    def draw(page: Page) -> None:
        axes = page.subplots(1, len(QUANTITIES))
        for column, (name, axis) in enumerate(zip(QUANTITIES, axes, strict=True)):
            low, high = np.percentile(values[:, column], (0.2, 99.9))
            edges = np.geomspace(max(low, 1e-2), high, BARS + 1)
            for of, label in ((values[:, column], "random shapes"), (tools[:, column], "tools")):
                weights = np.full(of.size, 100.0 / of.size)
                axis.hist(of, edges, weights=weights, histtype="step", label=label, linewidth=1.6)
            axis.set_xscale("log")
            axis.set_xlabel(AXES[name])
        axes[0].set_ylabel("share of the presses, %")
        axes[0].legend()

    with atomic_write(SPREAD_PICTURE) as temporary:
        temporary.write_bytes(figure("png", 13.0, 3.2, draw))


def draw_shapes() -> None:
    """The first random shapes of all, from above and aside."""
    from t2twin.primitives_cad import export

    rows, columns = SHEET
    page = Image.new("RGB", (columns * TILE_PX[0], rows * TILE_PX[1]), tuple(export.PAPER.tolist()))
    pen = ImageDraw.Draw(page)
    for seed in range(rows * columns):
        left, top = seed % columns * TILE_PX[0], seed // columns * TILE_PX[1]
        tile, _ = export.draw(random_shape(seed).mesh, export.PRIMITIVE_VIEW, TILE_PX, export.RESIN)
        page.paste(Image.fromarray(tile), (left, top))
        at = left + 6, top + TILE_PX[1] - 18
        pen.text(at, f"random-{seed}", fill=export.INK, font_size=11)
    with atomic_write(SHAPES_PICTURE) as temporary:
        page.save(temporary, format="PNG", optimize=True)
