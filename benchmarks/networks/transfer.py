"""Models that are learned on true counts, and fed with counts predicted from images.

    python -m benchmarks transfer FOLDER

Small models are trained on the true counts of the training split: family of the primitive, place
of the contact, force, and slip. Without further training, they are fed with true counts and with
counts that a translator predicts from images. The share kept is the ratio of the two scores (module
small_models). Beside them are models of the same kind that are trained on images, which are the
last map of the translator's encoder, and models that are trained on predicted counts.

FOLDER contains the datasets, runs and readings; the command makes what is missing. Per pair,
`data/PAIR/presses` is the protocol, and `data/PAIR/touches` the recipe touches.toml.
A finished dataset in their place is used as it is.

The family is learned on the presses, the other tasks on the touches. Place is the center of
pressure on the array. A touch slips if at least half of its contact on the array does. The models
of slip get two readings, that of the press from which the path started and that of the touch.
The place is also given for the contacts with nearly all force under the camera's view.
Tools have no family. The translator of the first pair is the pretrained network. That of the second
pair is trained on the touches, and starts from the pretrained network.
"""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.evidence import Argument, Benchmark, Figure

if TYPE_CHECKING:
    from benchmarks.networks.transfer_data import Task

BENCHMARK = Benchmark(
    module="benchmarks.networks.transfer",
    minutes=90,
    sources=("primitives_cad", "sim", "translate"),
    figures=(
        Figure("pairs.*.*.*.kept.percent", "%", least=90.0),
        Figure("pairs.*.*.*.true.score"),
        Figure("pairs.*.*.*.predicted.score"),
        Figure("pairs.*.*.*.images.score"),
        Figure("pairs.*.*.*.adapted.score"),
    ),
    arguments=(
        Argument("folder", "folder of the datasets, runs and readings", Path),
    ),
)  # fmt: skip

PAIRS = (
    {"source": "digit", "target": "cyskin-20", "run": "field", "scale": "paper",
     "random_shapes": 210},
    {"source": "gelsight-mini", "target": "cyskin-20", "run": None, "scale": "small",
     "random_shapes": 60},
)  # fmt: skip
"""The pairs (transfer_data.Pair)."""


def measure(options: Namespace) -> dict[str, Any]:
    from benchmarks.networks import transfer_data as data

    pairs = [data.Pair(**each) for each in PAIRS]
    found = {}
    for pair in pairs:
        data.make_readings(pair, options.folder)
        tasks = data.tasks_of(pair, options.folder)
        found[pair.name] = {name: rows for task in tasks for name, rows in rows_of(task).items()}
    return {"pairs": found, "made_of": PAIRS, "steps": data.STEPS}


def rows_of(task: Task) -> dict[str, dict[str, Any]]:
    """The scores of a task by test and split."""
    from benchmarks.networks.small_models import SmallModels, errors_of, share_kept
    from benchmarks.networks.transfer_data import IMAGES, PREDICTED, TRUE

    labels = task.train.labels
    models = {name: SmallModels(each, labels) for name, each in task.train.inputs.items()}
    fed = {
        TRUE: (TRUE, TRUE),
        PREDICTED: (TRUE, PREDICTED),
        IMAGES: (IMAGES, IMAGES),
        "adapted": (PREDICTED, PREDICTED),
    }
    rows: dict[str, dict[str, Any]] = {name: {} for name in task.tests}
    for name, split, one in ((n, s, each) for n, t in task.tests.items() for s, each in t.items()):
        errors = {
            row: errors_of(models[learned].predict(one.inputs[given]), one.labels, labels)
            for row, (learned, given) in fed.items()
        }
        rows[name][split] = {
            "examples": len(one.labels),
            "kept": share_kept(errors[PREDICTED], errors[TRUE], one.shapes),
        } | {row: each.score(one.shapes) for row, each in errors.items()}
    return rows
