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
from t2twin.sim.world.protocol import FORCE_N
from t2twin.translate.evaluation.certainty import NAMED_LEVEL, certainty
from t2twin.translate.predict import load_run
from t2twin.translate.runs.log import read_log


def measure(options: Namespace) -> dict[str, Any]:
    content: dict[str, Any] = {"runs": {}, "on": {}, "probes": {}}
    probes = kept_probes(options.probes)
    for folder in options.runs:
        name, run, found = _on_probes(folder, probes)
        content["runs"][name], content["probes"][name] = run, found
    for folder in options.evaluations:
        _, splits, trained = figures(folder)
        for name, run in content["runs"].items():
            if name not in trained:
                raise T2TwinError(f"{folder} says nothing of {name}; evaluate that run too")
            run |= trained[name]
        content["on"][folder.name] = {
            split: {name: rows[name] for name in content["runs"]} for split, rows in splits.items()
        }
    return content


def _on_probes(folder: Path, probes: Probes) -> tuple[str, dict[str, Any], dict[str, Any]]:
    """What a run is called, how long its training took, and its figures."""
    run = load_run(folder)
    data = run.config.data
    told = run.estimate(probes.images)
    force_n = np.full(len(probes.names), FORCE_N)
    sure = certainty(told, probes.counts, force_n)
    trained = {"minutes": sum(record.seconds for record in read_log(folder)) / 60.0}
    found = {
        "rmse_percent": errors(told.counts, probes, data.full_scale_counts)["all"],
        "held_percent": 100.0 * sure.held_at(NAMED_LEVEL),
    }
    return f"{run.config.model}-of-{data.world}", trained, found


if __name__ == "__main__":
    main(FIELD)
