"""Datasets, translators and readings of the benchmark `transfer`, and the tasks on them.

A reading is what a model is fed with for one touch. It is the true counts, the counts predicted
from the image, or the last map of the translator's encoder for the image.

Shape letters: P touches, N taxels, F numbers of a map, E examples of a task.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import structs

from benchmarks import ROOT
from benchmarks.networks.small_models import Labels
from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write, sha256_of
from t2twin.sim.dataset.columns import COUNTS, PATH, TRACTIONS, column
from t2twin.sim.dataset.generate import make_dataset
from t2twin.sim.dataset.store import INFO, lists, read_info, read_split
from t2twin.sim.sampling.recipe import load_recipe
from t2twin.sim.sensors.defaults import ROLES
from t2twin.sim.sensors.pair import SensorPair
from t2twin.translate.evaluation.evaluate import predict_runs, prepare
from t2twin.translate.runs.config import BEST, DEFAULT_RUN, resolve_run
from t2twin.translate.training.train import train

SEED = 0
"""Seed of the presses and of the training of a translator."""

RECIPE = ROOT / "benchmarks" / "networks" / "touches.toml"

STEPS = 700
"""Steps of the training of a translator (assumed: from the pretrained network, a tenth of the steps
of a new one)."""

SETS = PRESSES, TOUCHES = "presses", "touches"
"""Folders of the datasets of a pair."""

SPLITS = ("train", "val", "test")

TRUE, PREDICTED, IMAGES = "true", "predicted", "images"
"""What a model is fed with: true counts, predicted counts, maps of images."""

_, TARGET = ROLES

SLIP_SHARE, PRESSURE = column(TARGET, "slip_share"), column(TARGET, TRACTIONS[0])
"""Columns of the contact on the array."""

IN_VIEW = 0.95
"""Share of the force within the camera's view, from which on a contact is in view (assumed)."""

SLIPS = 0.5
"""Share of the contact that slips, from which on a touch slips (assumed)."""


@dataclass(frozen=True)
class Examples:
    """Examples of a task in one split.

    inputs: (E, n) by what they are, TRUE, PREDICTED and IMAGES. shapes: (E,) names.
    """

    inputs: dict[str, np.ndarray]
    labels: Labels
    shapes: np.ndarray

    def subset(self, which: np.ndarray) -> "Examples":
        """The examples `which`, (E,) bool."""
        inputs = {name: each[which] for name, each in self.inputs.items()}
        labels = Labels(self.labels.values[which], self.labels.classes)
        return Examples(inputs, labels, self.shapes[which])


@dataclass(frozen=True)
class Task:
    """A task: examples to learn from, and those of its tests, by the test's name and the split."""

    train: Examples
    tests: dict[str, dict[str, Examples]]


@dataclass(frozen=True)
class Pair:
    """A pair of sensors.

    run: name of the translator, None for one that is trained. scale: of the presses. random_shapes:
    number of random shapes in the touches.
    """

    source: str
    target: str
    run: str | None
    scale: str
    random_shapes: int

    @property
    def name(self) -> str:
        return f"{self.source}-{self.target}"

    def data(self, folder: Path, name: str) -> Path:
        """The folder of a dataset."""
        return folder / "data" / self.name / name

    def readings(self, folder: Path, name: str, split: str) -> Path:
        """The file of the readings of a split of a dataset."""
        return folder / "readings" / self.name / name / f"{split}.npz"


def make_readings(pair: Pair, folder: Path) -> None:
    """Makes the datasets of a pair, its translator, and the readings of all images.

    Whatever of it exists in the folder is not made again.
    """
    _make_data(pair, *(pair.data(folder, name) for name in SETS))
    run = pair.run or folder / "runs" / pair.name
    if pair.run is None:
        touches = pair.data(folder, TOUCHES)
        train("field", touches, "cpu", run, SEED, steps=STEPS, init_from=DEFAULT_RUN)
    for name, split in product(SETS, SPLITS):
        data, path = pair.data(folder, name), pair.readings(folder, name, split)
        made_of = f"{sha256_of(data / INFO)} {sha256_of(resolve_run(run) / BEST)}"
        if not _was_made_of(path, made_of):
            counts, maps = _predicted(run, data, split, path.parent / "cache")
            with atomic_write(path) as temporary, temporary.open("wb") as file:
                np.savez(file, made_of=np.array(made_of), predicted=counts, images=maps)


def _make_data(pair: Pair, presses: Path, touches: Path) -> None:
    """Makes both datasets of a pair in their folders, if they are not finished."""
    if not _is_finished(presses):
        sensors = SensorPair.of(pair.source, pair.target)
        sensors = sensors.with_imperfections(None)  # as t2twin simdata
        make_dataset(presses, pair.scale, SEED, sensors=sensors)
    if not _is_finished(touches):
        recipe = load_recipe(RECIPE)
        random, *others = recipe.parts
        parts = structs.replace(random, count=pair.random_shapes), *others
        recipe = structs.replace(recipe, source=pair.source, target=pair.target, parts=parts)
        make_dataset(touches, recipe=recipe)


def _is_finished(data: Path) -> bool:
    return (data / INFO).is_file() and read_info(data).complete


def _was_made_of(path: Path, made_of: str) -> bool:
    if not path.is_file():
        return False
    with np.load(path) as kept:
        return str(kept["made_of"]) == made_of


def _predicted(
    run: str | Path, data: Path, split: str, cache: Path
) -> tuple[np.ndarray, np.ndarray]:
    """(P, N) counts and (P, F) float16 maps. cache: of decoded images."""
    inputs = prepare([run], data, [split])
    (loaded,) = inputs.applied.values()
    network: Any = loaded.translator.predictor
    maps = []
    hook = network.pool.register_forward_hook(
        lambda _layer, _inputs, output: maps.append(output.flatten(1).half().numpy())
    )
    try:
        (counts,) = predict_runs(inputs, split, cache)[0].values()
    finally:
        hook.remove()
    return counts, np.concatenate(maps)[-len(counts) :]  # the first ones are of the classification


def tasks_of(pair: Pair, folder: Path) -> list[Task]:
    """The tasks of a pair. folder: as for `make_readings`."""
    presses, touches = (pair.data(folder, name) for name in SETS)
    found: dict[str, dict[str, Examples]] = {}
    for split, labels in family_labels(presses).items():
        inputs = _inputs(presses, split, pair.readings(folder, PRESSES, split))
        found.setdefault("family", {})[split] = Examples(inputs, *labels)
    info = read_info(touches)
    x_mm, y_mm = info.array.dense_x_mm, info.array.dense_y_mm
    view_mm = info.camera.view_mm
    assert x_mm is not None and y_mm is not None
    in_view = (np.abs(x_mm) <= view_mm[0]) & (np.abs(y_mm) <= view_mm[1])
    for split in SPLITS:
        inputs = _inputs(touches, split, pair.readings(folder, TOUCHES, split))
        table = _table(touches, split)
        place = place_examples(x_mm, y_mm, table, inputs)
        share = table[PRESSURE] @ in_view / table[PRESSURE].sum(axis=1)
        for name, examples in {
            "place": place,
            "place_in_view": place.subset(share >= IN_VIEW),
            "force": force_examples(table, inputs),
            "slip": slip_examples(table, inputs),
        }.items():
            found.setdefault(name, {})[split] = examples
    tests = {name: {s: splits[s] for s in splits if s != "train"} for name, splits in found.items()}
    return [
        Task(found[first]["train"], {name: tests[name] for name in (first, *others)})
        for first, *others in (("family",), ("place", "place_in_view"), ("force",), ("slip",))
    ]


Columns = Mapping[str, np.ndarray]


def _inputs(data: Path, split: str, readings: Path) -> dict[str, np.ndarray]:
    """The readings of all touches of a split, (P, n) float32, counts as fractions of full scale."""
    name = column(TARGET, COUNTS)
    true = lists(read_split(data, split, [name]), name)
    with np.load(readings) as found:
        predicted, images = found["predicted"], found["images"]
    if len(predicted) != len(true):
        raise T2TwinError(f"{readings} is not of {data}; delete it and repeat")
    full_scale = read_info(data).array.full_scale_counts
    assert full_scale is not None
    return {
        TRUE: (true / full_scale).astype(np.float32),
        PREDICTED: (predicted / full_scale).astype(np.float32),
        IMAGES: images.astype(np.float32),
    }


def _table(data: Path, split: str) -> Columns:
    """The columns of the touches that labels follow from."""
    names = ["shape", "index", PATH, "force_n", SLIP_SHARE, PRESSURE]
    table = read_split(data, split, names)
    return {n: lists(table, n) if n == PRESSURE else table[n].to_numpy() for n in names}


def family_labels(data: Path) -> dict[str, tuple[Labels, np.ndarray]]:
    """The family of the primitives of training and validation, and their shapes, by split."""
    tables = {s: read_split(data, s, ["shape", "family"]) for s in SPLITS if s != "test"}
    families = {s: table["family"].to_numpy() for s, table in tables.items()}
    names, labels = np.unique(families["train"]), {}
    for split, each in families.items():
        if not np.isin(each, names).all():
            raise T2TwinError(f"{data} has families in {split} that train lacks; expected the same")
        own = Labels(np.searchsorted(names, each), names.size)
        labels[split] = own, tables[split]["shape"].to_numpy()
    return labels


def place_examples(
    x_mm: np.ndarray, y_mm: np.ndarray, table: Columns, inputs: dict[str, np.ndarray]
) -> Examples:
    """The center of pressure on the array, mm.

    x_mm, y_mm: places at which the table has the pressure. inputs: of all touches.
    """
    pressure = table[PRESSURE].astype(float)
    center_mm = pressure @ np.column_stack([x_mm, y_mm]) / pressure.sum(axis=1, keepdims=True)
    return Examples(inputs, Labels(center_mm), table["shape"])


def force_examples(table: Columns, inputs: dict[str, np.ndarray]) -> Examples:
    """The force, N. inputs: of all touches."""
    return Examples(inputs, Labels(table["force_n"][:, None]), table["shape"])


def slip_examples(table: Columns, inputs: dict[str, np.ndarray]) -> Examples:
    """Whether touches that follow a press slip. Inputs are the press's, then the touch's.

    inputs: of all touches.
    """
    shapes, index, path = table["shape"], table["index"], table[PATH]
    row_of = {key: row for row, key in enumerate(zip(shapes, index, strict=True))}
    now = np.flatnonzero(index > path)
    start = np.array([row_of[shapes[row], path[row]] for row in now])
    slips = (table[SLIP_SHARE][now] >= SLIPS).astype(int)
    both = {name: np.hstack([each[start], each[now]]) for name, each in inputs.items()}
    return Examples(both, Labels(slips, classes=2), shapes[now])
