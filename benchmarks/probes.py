"""Translators on shapes made to choose by, so that the test objects choose nothing.

    python -m benchmarks.probes RUN [RUN ...] --data data/paper

Nine plain solids of edges, faces and ribs that leave the DIGIT's view, neither primitives nor
tools, are pressed as the protocol presses the objects: 3 x 3 places by 7 orientations. Prints
sqrt(L3) in percent of full scale for each run and, beside them, for the mean array and the nearest
neighbour of the training set, by solid, and keeps it in benchmarks/results/probes.json. What a
preset or an augmentation is worth is read here.
"""

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image
from tqdm import tqdm

from t2twin.primitives_cad import catalogue, surface
from t2twin.primitives_cad.shape import Shape
from t2twin.primitives_cad.tessellate import tessellate
from t2twin.primitives_cad.writing import whole_file
from t2twin.sim.dataset import protocol
from t2twin.sim.press.records import PressCommand
from t2twin.sim.sensors import SensorPair
from t2twin.translate.data.images import to_pixels
from t2twin.translate.data.pairs import load_info, load_pairs
from t2twin.translate.evaluation.baselines import FEATURE_SIZE, mean_array, nearest_neighbour
from t2twin.translate.predict import load_run

if TYPE_CHECKING:
    import cadquery as cq

LONG_MM = 60.0
"""Length of what goes on past both sensors, mm."""

TALL_MM = 8.0
"""Height of the solids, mm: deeper than either elastomer."""

SEED = 0

RESULTS = Path(__file__).parent / "results" / "probes.json"


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


def presses(name: str) -> list[PressCommand]:
    """The protocol's object presses of a solid: 63."""
    grid = protocol.OBJECT_GRID
    return [
        protocol.press_of(name, catalogue.OBJECT_SPACING_MM, index, grid)
        for index in range(grid.points**2 * grid.orientations)
    ]


def shape_of(name: str, solid: "cq.Workplane") -> Shape:
    """A solid as a shape, its own origin kept: a file's would be moved to its middle."""
    mesh, heights = surface.stand(tessellate(solid.val()))  # pyright: ignore[reportArgumentType]
    return Shape(name, mesh, heights, spacing_mm=catalogue.OBJECT_SPACING_MM)


def make(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Images (P, 320, 240, 3), counts (P, N) and names (P,) of every press, kept in a file."""
    if not path.is_file():
        bench, images, counts, names = SensorPair(), [], [], []
        for place, (name, solid) in enumerate(solids().items()):
            shape = shape_of(name, solid)
            for number, command in enumerate(tqdm(presses(name), name, unit="press")):
                rng = np.random.default_rng((SEED, place, number))
                images.append(
                    bench.digit.see(bench.digit.touch(shape, command), shape, command, rng)
                )
                counts.append(bench.cyskin.feel(bench.cyskin.touch(shape, command), rng))
                names.append(name)
        with whole_file(path) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, images=images, counts=counts, names=names)
    with np.load(path) as found:
        return found["images"], found["counts"].astype(np.float32), found["names"]


def errors(predicted: np.ndarray, true: np.ndarray, names: np.ndarray, full: float) -> dict:
    """sqrt(L3) in percent of full scale, over all and by solid."""
    squares = np.square(predicted - true).mean(axis=1)
    each = {str(n): squares[names == n].mean() for n in dict.fromkeys(names)}
    return {
        name: round(100.0 * float(np.sqrt(square)) / full, 3)
        for name, square in {"all": squares.mean(), **each}.items()
    }


def main() -> None:
    parser = argparse.ArgumentParser(description="Translators on the probes")
    parser.add_argument("runs", nargs="*", type=Path)
    parser.add_argument("--data", type=Path, required=True, help="dataset of the trivial rows")
    parser.add_argument("--probes", type=Path, default=Path("data/probes.npz"))
    options = parser.parse_args()
    info = load_info(options.data)
    images, counts, names = make(options.probes)
    train = load_pairs(options.data, "train", FEATURE_SIZE, grey=False)
    small = np.stack([to_pixels(Image.fromarray(i), FEATURE_SIZE, grey=False) for i in images])
    found = {
        "mean array": np.broadcast_to(mean_array(train), counts.shape),
        "nearest neighbour": nearest_neighbour(train, small),
        **{str(run): load_run(run).predict(images) for run in options.runs},
    }
    percent = {
        name: errors(predicted, counts, names, info.full_scale_counts)
        for name, predicted in found.items()
    }
    for name, each in percent.items():
        print(name, json.dumps(each))
    runs = " ".join(map(str, options.runs))
    command = f"python -m benchmarks.probes {runs} --data {options.data}"
    with whole_file(RESULTS) as temporary:
        temporary.write_text(json.dumps({"command": command, **percent}, indent=1) + "\n")


if __name__ == "__main__":
    main()
