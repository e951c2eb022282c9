"""Generation rate of the open world's pairs, compared with the protocol's.

    python -m benchmarks.timing.world_rate

Makes scale paper, and as many presses of the open world, with all cores, in turn. The ratio is the
median over the turns. The protocol's shapes are cached before; random shapes are made meanwhile.
"""

import json
import tempfile
from argparse import Namespace
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import structs

from benchmarks.evidence.record import Argument, Benchmark, Figure
from benchmarks.evidence.run import main
from t2twin.primitives_cad import catalogue
from t2twin.sim.dataset.generate import make_dataset
from t2twin.sim.dataset.info import DatasetInfo
from t2twin.sim.dataset.store import LOG
from t2twin.sim.world.recipe import load_recipe

BENCHMARK = Benchmark(
    module="benchmarks.timing.world_rate",
    measures="Generation rate of the open world's pairs, against the protocol's.",
    minutes=8,
    sources=("primitives_cad", "sim"),
    figures=(
        Figure("open_over_protocol", least=0.85),
        Figure("protocol_pairs_a_second", "pairs/s"),
        Figure("open_pairs_a_second", "pairs/s"),
        Figure("kb_a_pair.*", "kB"),
    ),
    arguments=(Argument("--rounds", "turns of both", int, 1),),
)

SCALE = "paper"
SHAPES = 5019
"""Random shapes: with four presses each as many pairs as scale paper. Of fewer, much of the time
would go to MuJoCo's models of all sizes, which each process compiles once, in some five seconds."""

STAGES = ("shape", "light", "field", "press digit", "press cyskin", "picture", "encoding")
"""Whose milliseconds a pair are kept."""


def measure(options: Namespace) -> dict[str, Any]:
    for name in catalogue.NAMES:
        catalogue.load(name)
    recipe = load_recipe("open")
    part = structs.replace(recipe.parts[0], count=SHAPES)
    recipe = structs.replace(recipe, parts=(part,))
    turns = []
    with tempfile.TemporaryDirectory(prefix="t2twin-rate-") as folder:
        for number in range(options.rounds):
            protocol, opened = (Path(folder) / f"{kind}-{number}" for kind in ("protocol", "open"))
            turns.append(
                {
                    "protocol": _record(protocol, make_dataset(protocol, SCALE)),
                    "open": _record(opened, make_dataset(opened, world=recipe)),
                }
            )
    rates = np.array(
        [[turn[kind]["pairs_a_second"] for kind in ("protocol", "open")] for turn in turns]
    )
    protocol, opened = np.median(rates, axis=0)
    return {
        "protocol_pairs_a_second": protocol,
        "open_pairs_a_second": opened,
        "open_over_protocol": np.median(rates[:, 1] / rates[:, 0]),
        "kb_a_pair": {kind: turns[0][kind]["kb_a_pair"] for kind in ("protocol", "open")},
        "turns": turns,
    }


def _record(folder: Path, info: DatasetInfo) -> dict[str, Any]:
    """Rate and size of a dataset that has just been made, and where its time went."""
    (said,) = [json.loads(line) for line in (folder / LOG).read_text().splitlines()]
    size = sum((folder / path).stat().st_size for path in info.shards)
    return {
        "pairs_a_second": said["pairs"] / said["seconds"],
        "kb_a_pair": size / said["pairs"] / 1e3,
        "ms_a_pair": {
            stage: round(1e3 * said["stage_seconds"][stage] / said["pairs"], 2) for stage in STAGES
        },
        "drawn_again": said["rejected"],
    }


if __name__ == "__main__":
    main(BENCHMARK)
