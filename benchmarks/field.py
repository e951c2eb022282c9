"""Field runs on presses of many kinds, from folders of `t2twin evaluate`, and on the probes.

    for data in paper forces open-8n dense; do
        t2twin evaluate RUN... --data data/$data --split both --out runs/field/$data; done
    python -m benchmarks.field runs/field/* --runs RUN...

The errors, what intervals of 90 % hold, what leaving out the least sure fifth is worth, and how far
the force is off. open-8n are random shapes, dense the protocol's presses read by 63 taxels. Runs go
by the world that they were trained in.
"""

from argparse import Namespace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.declared import FIELD
from benchmarks.evidence.run import main
from benchmarks.probes import Probes, errors, kept_probes
from benchmarks.world_runs import figures
from t2twin.primitives_cad.errors import T2TwinError
from t2twin.translate.evaluation.certainty import NAMED_LEVEL, certainty
from t2twin.translate.predict import load_run
from t2twin.translate.runs.log import read_log

PROTOCOL_N = 8.0
"""Force of the probes' presses, N."""


def measure(options: Namespace) -> dict[str, Any]:
    content: dict[str, Any] = {"runs": {}, "on": {}, "probes": {}}
    probes = kept_probes(options.probes)
    for folder in options.runs:
        name, run, found = _on_probes(folder, probes)
        content["runs"][name], content["probes"][name] = run, found
    for folder in options.evaluations:
        _, splits, trained = figures(folder)
        missing = sorted(set(content["runs"]) - set(trained))
        if missing:
            raise T2TwinError(f"{folder} says nothing of {missing[0]}; evaluate that run too")
        content["on"][folder.name] = {
            split: {name: rows[name] for name in content["runs"]} for split, rows in splits.items()
        }
    return content


def _on_probes(folder: Path, probes: Probes) -> tuple[str, dict[str, Any], dict[str, Any]]:
    """What a run is called, what it was trained on and for how long, and its figures."""
    run = load_run(folder)
    config, log = run.config, read_log(folder)
    told = run.estimate(probes.images)
    force_n = np.full(len(probes.names), PROTOCOL_N)
    sure = certainty(told, probes.counts, force_n)
    trained = {
        "world": config.data.world,
        "pairs": config.data.train_pairs,
        "steps": len(log) * (config.epoch_steps or 0),
        "minutes": sum(record.seconds for record in log) / 60.0,
    }
    found = {
        "rmse_percent": errors(told.counts, probes, config.data.full_scale_counts)["all"],
        "held_percent": 100.0 * sure.held_at(NAMED_LEVEL),
    }
    return f"{config.model}-of-{config.data.world}", trained, found


if __name__ == "__main__":
    main(FIELD)
