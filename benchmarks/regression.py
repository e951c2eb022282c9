"""The regression: both translators trained briefly on a small fixed dataset.

    python -m benchmarks.regression            measure and compare with the baseline
    python -m benchmarks.regression --write    measure and write the baseline anew

The baseline, benchmarks/results/regression.json, holds sqrt(L3) in percent of full scale and the
translators' contact IoU, with the versions that it was made with. When it moves for a good reason
(the physics or a network changed on purpose), write it anew and say why in the commit.
"""

import json
import sys
import tempfile
from importlib.metadata import version
from pathlib import Path

from t2twin.sim.dataset.generate import generate
from t2twin.translate.evaluation.evaluate import evaluate
from t2twin.translate.train import train

BASELINE = Path(__file__).parent / "results" / "regression.json"

SCALE = "small"
EPOCHS = {"touch2touch": 36, "resnet18": 12}
"""Epochs of each translator: brief, yet enough to be well below the mean array."""

BAND = 0.2
"""Largest share by which an error may rise above its baseline. Runs on other processors and other
numbers of threads differ by some percent; a broken phi, loss or pairing by a factor."""

IOU_BAND = 0.05
"""Largest drop of a contact IoU below its baseline."""

Found = dict[str, dict[str, dict[str, float]]]
"""Figures by name ("rmse_percent", "contact_iou"), split and model."""


def measure(folder: Path, cache: Path | None = None) -> Found:
    """The figures on data and runs made in folder; contact IoU of the translators alone."""
    generate(folder / "data", SCALE, seed=0, cache=cache)
    runs = []
    for model, epochs in EPOCHS.items():
        train(model, folder / "data", "cpu", folder / model, seed=0, epochs=epochs)
        runs.append(folder / model)
    found: Found = {"rmse_percent": {}, "contact_iou": {}}
    for split in ("val", "test"):
        models = evaluate(runs, folder / "data", split, folder / split)["models"]
        for figure, which in (("rmse_percent", tuple(models)), ("contact_iou", tuple(EPOCHS))):
            found[figure][split] = {
                name: round(models[name]["overall"][figure], 3) for name in which
            }
    return found


def failures(found: Found, baseline: Found) -> list[str]:
    """What is worse than it may be, a sentence each."""
    worse = []
    for split, models in baseline["rmse_percent"].items():
        now = found["rmse_percent"][split]
        for model, before in models.items():
            if now[model] > before * (1 + BAND):
                worse.append(
                    f"{model} on {split}: sqrt(L3) {now[model]:.2f} % of full scale; the baseline "
                    f"{before:.2f} % allows {before * (1 + BAND):.2f} %"
                )
        for model in EPOCHS:
            most = now["mean-array"] / 2 if split == "val" else now["mean-array"]
            if now[model] > most:
                worse.append(
                    f"{model} on {split}: sqrt(L3) {now[model]:.2f} % of full scale; the mean "
                    f"array's allows {most:.2f} %"
                )
    for split, models in baseline["contact_iou"].items():
        for model, before in models.items():
            now = found["contact_iou"][split][model]
            if now < before - IOU_BAND:
                worse.append(
                    f"{model} on {split}: contact IoU {now:.3f}; the baseline {before:.3f} allows "
                    f"{before - IOU_BAND:.3f}"
                )
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
            **found,
        }
        BASELINE.write_text(json.dumps(content, indent=1) + "\n")
    print(json.dumps(found, indent=1))
    worse = failures(found, json.loads(BASELINE.read_text()))
    print("\n".join(worse) or "within the band")
    sys.exit(1 if worse else 0)


if __name__ == "__main__":
    main()
