"""The RMSE regression: both translators trained briefly on a small fixed dataset.

    python -m benchmarks.regression            measure and compare with the baseline
    python -m benchmarks.regression --write    measure and write the baseline anew

The baseline, benchmarks/results/regression.json, holds sqrt(L3) in percent of full scale with the
versions that it was made with. When it moves for a good reason (the physics or a network changed
on purpose), write it anew and say why in the commit.
"""

import json
import sys
import tempfile
from importlib.metadata import version
from pathlib import Path
from typing import Any

from sim.generate import generate
from translate.evaluate import evaluate
from translate.train import train

BASELINE = Path(__file__).parent / "results" / "regression.json"

SCALE = "small"
EPOCHS = {"touch2touch": 16, "resnet18": 8}
"""Epochs of each translator: brief, yet enough to be well below the mean array."""

BAND = 0.2
"""Largest share by which an error may rise above its baseline. Runs on other processors and other
numbers of threads differ by some percent; a broken phi, loss or pairing by a factor."""


def measure(folder: Path, cache: Path | None = None) -> dict[str, Any]:
    """sqrt(L3) in percent of full scale, by split and model, on data and runs made in folder."""
    generate(folder / "data", SCALE, seed=0, cache=cache)
    runs = []
    for model, epochs in EPOCHS.items():
        train(model, folder / "data", "cpu", folder / model, seed=0, epochs=epochs)
        runs.append(folder / model)
    found: dict[str, Any] = {}
    for split in ("val", "test"):
        models = evaluate(runs, folder / "data", split, folder / split)["models"]
        found[split] = {
            name: round(figures["overall"]["rmse_percent"], 3) for name, figures in models.items()
        }
    return found


def failures(found: dict[str, Any], baseline: dict[str, Any]) -> list[str]:
    """What is worse than it may be, a sentence each."""
    worse = []
    for split, models in baseline["rmse_percent"].items():
        for model, before in models.items():
            now = found[split][model]
            if now > before * (1 + BAND):
                worse.append(
                    f"{model} on {split}: sqrt(L3) {now:.2f} % of full scale; the baseline "
                    f"{before:.2f} % allows {before * (1 + BAND):.2f} %"
                )
    for model in EPOCHS:
        val, test = found["val"], found["test"]
        if val[model] > val["mean-array"] / 2:
            worse.append(f"{model} on val is not at half of the mean array's error: {val[model]} %")
        if test[model] > test["mean-array"]:
            worse.append(f"{model} on test is worse than the mean array: {test[model]} %")
    return worse


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        found = measure(Path(folder))
    if "--write" in sys.argv[1:]:
        content = {
            "command": "python -m benchmarks.regression --write",
            "scale": SCALE,
            "epochs": EPOCHS,
            "versions": {name: version(name) for name in ("t2twin", "mujoco", "numpy", "torch")},
            "rmse_percent": found,
        }
        BASELINE.write_text(json.dumps(content, indent=1) + "\n")
    print(json.dumps(found, indent=1))
    worse = failures(found, json.loads(BASELINE.read_text()))
    print("\n".join(worse) or "within the band")
    sys.exit(1 if worse else 0)


if __name__ == "__main__":
    main()
