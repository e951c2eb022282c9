"""Errors of translators on solids for the choice of settings, so that the test objects choose none.

    python -m benchmarks.networks.probes RUN [RUN ...] --data data/paper

Nine simple solids with edges, faces and ribs extend beyond the DIGIT's view. They are neither
primitives nor tools. They are pressed as the protocol presses the objects, at 3 x 3 places with 7
orientations. The RMSE in percent of full scale is given for each run, the mean array and the
nearest neighbor of the training set, by solid.
"""

import hashlib
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image
from tqdm import tqdm

from benchmarks import ROOT
from benchmarks.evidence.record import Argument, Benchmark, Figure
from benchmarks.evidence.run import main
from t2twin.core.files import atomic_write
from t2twin.primitives_cad import catalogue, height_map
from t2twin.primitives_cad.shape import Shape
from t2twin.sim.contact.types import PressCommand
from t2twin.sim.sampling import protocol
from t2twin.sim.sensors.pair import SensorPair

if TYPE_CHECKING:
    import cadquery as cq

BENCHMARK = Benchmark(
    module="benchmarks.networks.probes",
    measures="Errors of trained translators on solids for the choice of settings.",
    minutes=2,
    sources=("primitives_cad", "sim", "translate"),
    figures=(Figure("rows.*.all", "%"),),
    arguments=(
        Argument("runs", "folders of t2twin train", Path, nargs="+"),
        Argument("--data", "the dataset of the trivial rows", Path, required=True, metavar="DIR"),
        Argument(
            "--probes",
            "where the presses are kept",
            Path,
            Path("data/probes.npz"),
            metavar="FILE",
        ),
    ),
)

LONG_MM = 60.0
"""Length of what goes on past both sensors, mm."""

TALL_MM = 8.0
"""Height of the solids, mm: deeper than either elastomer."""

SEED = 0

PRESS_SOURCES = ("primitives_cad", "sim")
"""Folders whose files determine the presses, relative to the repository."""


@dataclass(frozen=True)
class Probes:
    """Presses of the solids: images (P, 320, 240, 3) uint8, counts (P, N), names (P,)."""

    images: np.ndarray
    counts: np.ndarray
    names: np.ndarray


def measure(options: Namespace) -> dict[str, Any]:
    probes = kept_probes(options.probes)
    return {"presses": len(probes.names), "rows": rows(probes, options.runs, options.data)}


def rows(probes: Probes, runs: Sequence[Path], data: Path) -> dict[str, dict[str, float]]:
    """The RMSE in percent of full scale, by row and solid; the runs by their models' names."""
    from t2twin.translate.data.images import to_pixels
    from t2twin.translate.data.pairs import load_info, load_pairs
    from t2twin.translate.evaluation.baselines import (
        FEATURE_SIZE,
        MEAN_ARRAY,
        NEAREST_NEIGHBOR,
        mean_array,
        neighbors,
    )
    from t2twin.translate.evaluation.predictions import run_names
    from t2twin.translate.inference.load import load_run

    train = load_pairs(data, "train", FEATURE_SIZE, grey=False)
    small = [to_pixels(Image.fromarray(image), FEATURE_SIZE, grey=False) for image in probes.images]
    loaded = [load_run(run) for run in runs]
    predictions = {
        MEAN_ARRAY: np.broadcast_to(mean_array(train), probes.counts.shape),
        NEAREST_NEIGHBOR: train.counts[neighbors(train.images, np.stack(small)).index[:, 0]],
    }
    for name, run in zip(run_names(loaded), loaded, strict=True):
        predictions[name] = run.predict(probes.images)
    full_scale = load_info(data).array.full_scale_counts
    return {name: errors(predicted, probes, full_scale) for name, predicted in predictions.items()}


def errors(predicted: np.ndarray, probes: Probes, full_scale: float) -> dict[str, float]:
    """The RMSE in percent of full scale, over all and by solid."""
    squares = np.square(predicted - probes.counts).mean(axis=1)
    each = {str(n): squares[probes.names == n].mean() for n in dict.fromkeys(probes.names)}
    return {
        name: round(100.0 * float(np.sqrt(square)) / full_scale, 3)
        for name, square in {"all": squares.mean(), **each}.items()
    }


def solids() -> dict[str, "cq.Workplane"]:
    """The solids by name, mm, their pressing side up and the origin under the middle press."""
    import cadquery as cq

    def box(x: float, y: float, at: tuple[float, float] = (0.0, 0.0)) -> "cq.Workplane":
        return cq.Workplane().center(*at).rect(x, y).extrude(TALL_MM)

    def lying(radius: float) -> "cq.Workplane":
        return cq.Workplane("XZ").circle(radius).extrude(LONG_MM / 2, both=True)

    ribs = box(LONG_MM, LONG_MM).faces(">Z").workplane()
    return {
        "bar": box(6.0, LONG_MM),
        "rounded-bar": box(7.0, LONG_MM).edges("|Y and >Z").fillet(2.0),
        "rod": lying(5.0),
        "thick-rod": lying(9.0),
        "half-plane": box(LONG_MM / 2, LONG_MM, (LONG_MM / 4, 0.0)),
        "corner": box(LONG_MM / 2, LONG_MM / 2, (LONG_MM / 4, LONG_MM / 4)),
        "bar-end": box(5.0, LONG_MM / 2, (0.0, LONG_MM / 4)),
        "bend": box(4.0, LONG_MM / 2 + 2.0, (0.0, LONG_MM / 4 - 1.0)).union(
            box(LONG_MM / 2, 4.0, (LONG_MM / 4, 0.0))
        ),
        "ribs": ribs.rarray(4.0, 1.0, 14, 1).rect(2.4, LONG_MM).cutBlind(-3.0),
    }


def shape_of(name: str, solid: "cq.Workplane") -> Shape:
    """A solid as a shape, its own origin kept: a file's would be moved to its middle."""
    from t2twin.primitives_cad.solids import tessellate

    mesh, heights = height_map.aligned(tessellate(solid.val()))  # pyright: ignore[reportArgumentType]
    return Shape(name, mesh, heights, spacing_mm=catalogue.OBJECT_SPACING_MM)


def press_of(name: str, number: int) -> PressCommand:
    """A press of a solid, as the protocol presses objects."""
    return protocol.press_of(name, catalogue.OBJECT_SPACING_MM, number, protocol.OBJECT_GRID)


def press_solids(numbers: Sequence[int]) -> Probes:
    """The presses of these numbers of every solid."""
    sensors, samples = SensorPair(), []
    for place, (name, solid) in enumerate(solids().items()):
        shape = shape_of(name, solid)
        for number in tqdm(numbers, name, unit="press"):
            rng = np.random.default_rng((SEED, place, number))
            samples.append(sensors.press(shape, press_of(name, number), rng))
    return Probes(
        images=np.stack([sample.image for sample in samples]),
        counts=np.stack([sample.counts for sample in samples]).astype(np.float32),
        names=np.array([sample.command.shape for sample in samples]),
    )


def kept_probes(path: Path) -> Probes:
    """All presses, 63 of every solid: those in a file if the present code has made them, else made
    and kept there."""
    digest = _digest()
    if path.is_file():
        with np.load(path) as kept:
            if "digest" in kept and str(kept["digest"]) == digest:
                return Probes(kept["images"], kept["counts"], kept["names"])
    grid = protocol.OBJECT_GRID
    probes = press_solids(range(grid.points**2 * grid.orientations))
    with atomic_write(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(
            file,
            digest=np.array(digest),
            images=probes.images,
            counts=probes.counts,
            names=probes.names,
        )
    return probes


def _digest() -> str:
    """SHA-256 of the code and data files that determine the presses."""
    digest = hashlib.sha256(Path(__file__).read_bytes())
    for folder in PRESS_SOURCES:
        for path in sorted((ROOT / folder).rglob("*")):
            if path.is_file() and "__pycache__" not in path.parts:
                digest.update(path.read_bytes())
    return digest.hexdigest()


if __name__ == "__main__":
    main(BENCHMARK)
