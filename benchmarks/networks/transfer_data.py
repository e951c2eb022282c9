"""Datasets, translators and readings of the benchmark `transfer`, and the tasks on them.

A reading is what a model may be fed with for one touch: its true counts, the counts predicted from
its image, or the last map of the translator's encoder for the image.

Shape letters: P touches, N taxels, F numbers of a map, E examples of a task.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from msgspec import structs

from benchmarks import ROOT
from benchmarks.networks.small_models import Labels
from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write
from t2twin.sim.dataset.columns import COUNTS, PATH, TRACTIONS, column
from t2twin.sim.dataset.generate import make_dataset
from t2twin.sim.dataset.store import INFO, lists, read_info, read_split, sha256_of
from t2twin.sim.sampling.recipe import load_recipe
from t2twin.sim.sensors.defaults import ROLES
from t2twin.sim.sensors.pair import SensorPair
from t2twin.translate.evaluation.predictions import predict_runs, prepare
from t2twin.translate.inference.predictor import FieldPredictor, require
from t2twin.translate.runs.config import BEST, DEFAULT_RUN, resolve_run
from t2twin.translate.training.train import train

SEED = 0
"""Seed of the presses and of the training of a translator."""

RECIPE = ROOT / "benchmarks" / "networks" / "touches.toml"

STEPS = 1200
"""Steps of the training of a translator (assumed: from the pretrained network, a tenth of the steps
of a new one)."""

PRESSES, TOUCHES = "presses", "touches"
"""Folders of the datasets of a pair."""

SPLITS = ("train", "val", "test")

TRUE, PREDICTED, IMAGES = "true", "predicted", "images"
"""What a model is fed with: true counts, predicted counts, maps of images."""

_, TARGET = ROLES

SLIP_SHARE, PRESSURE = column(TARGET, "slip_share"), column(TARGET, TRACTIONS[0])
"""Columns of the contact on the array."""

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


Task = dict[str, Examples]
"""The examples of a task by split."""


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


def make_data(pair: Pair, folder: Path) -> None:
    """Makes both datasets of a pair in a folder, if they are not finished."""
    if not _is_finished(folder / PRESSES):
        sensors = SensorPair.of(pair.source, pair.target)
        sensors = sensors.with_imperfections(None)  # as t2twin simdata
        make_dataset(folder / PRESSES, pair.scale, SEED, sensors=sensors)
    if not _is_finished(folder / TOUCHES):
        recipe = load_recipe(RECIPE)
        random, *others = recipe.parts
        parts = structs.replace(random, count=pair.random_shapes), *others
        recipe = structs.replace(recipe, source=pair.source, target=pair.target, parts=parts)
        make_dataset(folder / TOUCHES, recipe=recipe)


def _is_finished(data: Path) -> bool:
    return (data / INFO).is_file() and read_info(data).complete


def make_translator(data: Path, run: Path) -> None:
    """Trains a translator on the touches of a pair from the pretrained one, or continues that."""
    train("field", data / TOUCHES, "cpu", run, SEED, steps=STEPS, init_from=DEFAULT_RUN)


def make_readings(run: str | Path, data: Path, folder: Path) -> None:
    """Writes the predicted counts and maps of all images of both datasets of a pair.

    What a run has predicted for a dataset is not predicted again.
    """
    for name in (PRESSES, TOUCHES):
        made_of = f"{sha256_of(data / name / INFO)} {sha256_of(resolve_run(run) / BEST)}"
        for split in SPLITS:
            path = folder / name / f"{split}.npz"
            if not _was_made_of(path, made_of):
                counts, maps = _predicted(run, data / name, split, folder / name / "cache")
                with atomic_write(path) as temporary, temporary.open("wb") as file:
                    np.savez(file, made_of=np.array(made_of), predicted=counts, images=maps)


def has_readings(folder: Path) -> bool:
    """Whether a folder has the readings of both datasets of a pair."""
    return all(
        (folder / name / f"{s}.npz").is_file() for name in (PRESSES, TOUCHES) for s in SPLITS
    )


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
    network = require(loaded, FieldPredictor, "the benchmark").translator.predictor
    maps = []
    hook = network.pool.register_forward_hook(
        lambda _layer, _inputs, output: maps.append(output.flatten(1).half().numpy())
    )
    try:
        (counts,) = predict_runs(inputs, split, cache)[0].values()
    finally:
        hook.remove()
    return counts, np.concatenate(maps)


def tasks_of(data: Path, readings: Path) -> dict[str, Task]:
    """The tasks of a pair by name. data, readings: folders of `make_data` and `make_readings`."""
    tasks: dict[str, Task] = {"family": _families(data / PRESSES, readings / PRESSES)}
    array = read_info(data / TOUCHES).array
    assert array.dense_x_mm is not None and array.dense_y_mm is not None
    for split in SPLITS:
        inputs = _inputs(data / TOUCHES, readings / TOUCHES, split)
        table = _table(data / TOUCHES, split)
        for name, examples in {
            "place": place_examples(array.dense_x_mm, array.dense_y_mm, table, inputs),
            "force": force_examples(table, inputs),
            "slip": slip_examples(table, inputs),
        }.items():
            tasks.setdefault(name, {})[split] = examples
    return tasks


Columns = Mapping[str, np.ndarray]


def _inputs(data: Path, readings: Path, split: str) -> dict[str, np.ndarray]:
    """The readings of all touches of a split, (P, n) float32, counts as fractions of full scale."""
    name = column(TARGET, COUNTS)
    true = lists(read_split(data, split, [name]), name)
    with np.load(readings / f"{split}.npz") as found:
        predicted, images = found["predicted"], found["images"]
    if len(predicted) != len(true):
        raise T2TwinError(f"{readings} has not the readings of {data}; delete it and repeat")
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


def _families(data: Path, readings: Path) -> Task:
    """The family of the primitive, of the training and the validation split."""
    tables = {s: read_split(data, s, ["shape", "family"]) for s in SPLITS if s != "test"}
    names, examples = np.unique(tables["train"]["family"].to_numpy()), {}
    for split, table in tables.items():
        families = table["family"].to_numpy()
        if not np.isin(families, names).all():
            raise T2TwinError(f"{data} has families in {split} that train lacks; expected the same")
        labels = Labels(np.searchsorted(names, families), names.size)
        shapes = table["shape"].to_numpy()
        examples[split] = Examples(_inputs(data, readings, split), labels, shapes)
    return examples


def place_examples(
    x_mm: Sequence[float], y_mm: Sequence[float], table: Columns, inputs: dict[str, np.ndarray]
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
