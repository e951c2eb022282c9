"""Accuracy of the pretrained network on protocol presses, in any light, and on a real DIGIT.

    t2twin evaluate RUN --data data/paper --split both --out paper
    t2twin evaluate RUN --data data/pretrained-3 --split val --out pretrained-3/val
    python -m benchmarks.pretrained paper pretrained-3 [--frames FOLDER]

RUN is the pretrained network, or the run that it was made of. FOLDER contains background.png and
press_*.png of a ball, as for benchmarks.real; without it the figures of real frames are skipped.
The light is fitted to the first frames; the network predicts the last ones with and without the
background frame.
"""

from argparse import Namespace
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.evidence.record import Argument, Benchmark, Figure
from benchmarks.evidence.run import main
from benchmarks.real import real_references
from benchmarks.world_runs import figures
from t2twin.core.errors import T2TwinError

BENCHMARK = Benchmark(
    name="pretrained",
    measures="Accuracy of the pretrained network: protocol, any light, and a real DIGIT.",
    minutes=2,
    sources=("primitives_cad", "sim", "t2twin/adaptation", "translate"),
    figures=(
        Figure("on.*.*.overall.rmse_percent", "%"),
        Figure("on.*.*.coverage_percent", "%"),
        Figure("on.*.*.falls_by_percent", "%"),
        Figure("on.*.*.certainty.force_median_error_percent", "%"),
        Figure("real.*.rmse_percent", "%"),
        Figure("real.*.force_error"),
        Figure("real.*.interval_coverage_percent", "%"),
    ),
    arguments=(
        Argument("evaluations", "folders of t2twin evaluate with one field run", Path, nargs="+"),
        Argument("--frames", "folder of background.png and press_*.png", Path, default=None),
    ),
)


def measure(options: Namespace) -> dict[str, Any]:
    content: dict[str, Any] = {"on": {}, "run": None, "real": {}}
    for folder in options.evaluations:
        world, splits, runs = figures(folder)
        fields = [name for name in runs if name.startswith("field-of-")]
        if len(fields) != 1:
            raise T2TwinError(f"{folder} has {len(fields)} field runs; expected one")
        content["run"] = runs[fields[0]]
        content["on"][world] = {split: rows[fields[0]] for split, rows in splits.items()}
    if options.frames is None:
        print("figures of real frames are skipped; give --frames FOLDER")
    else:
        content["real"] = _on_real_frames(options.frames)
    return content


def _on_real_frames(folder: Path) -> dict[str, Any]:
    """Scores of the pretrained network on held-out frames of a real DIGIT."""
    from t2twin.adaptation.real_frame_evaluation import evaluate_frames
    from t2twin.adaptation.record import AdaptationScores
    from t2twin.translate.inference.load import load_run

    run = load_run("field")
    references, background = real_references(folder)
    found = {}
    for name, frame in (("with_background", background), ("without_background", None)):
        results = [one.real for one in evaluate_frames(run, references, frame)]
        found[name] = asdict(AdaptationScores.of(results))
    return found


if __name__ == "__main__":
    main(BENCHMARK)
