"""t2twin train

t2twin calibrate-uncertainty
"""

from pathlib import Path
from typing import Literal

import tyro


def train(
    model: tyro.conf.Positional[str],
    data: Path,
    preset: str = "cpu",
    out: Path | None = None,
    seed: int = 0,
    epochs: int | None = None,
    minutes: float | None = None,
    steps: int | None = None,
    init_from: str | None = None,
    direction: Literal[
        "source-to-target", "target-to-source", "image-to-counts", "counts-to-image"
    ] = "source-to-target",
    iou_weight: float | None = None,
    contact_alone: bool = False,
) -> None:
    """Train a translator, or resume a stopped training.

    Args:
        model: touch2touch (any pair of sensors), resnet18 (to counts), or field (from images to
            counts; needs a dataset with dense counts).
        data: Folder of the dataset.
        preset: cpu (two cores), paper (as published; for a GPU) or smoke (seconds).
        out: Folder of the run. Default: runs/MODEL, or runs/MODEL-DIRECTION.
        seed: Seed of weights, order, dropout and augmentation.
        epochs: Maximum epochs. Default: the preset's.
        minutes: Maximum minutes. The epochs are planned to fit; with a fixed learning rate, the
            epoch in which they are over is the last.
        steps: Maximum steps, rounded to whole epochs. Default: the preset's.
        init_from: Run of the same model, whose weights are the initial weights.
        direction: Of the dataset's sensors; image-to-counts and counts-to-image are for a gel
            camera and a taxel array, whichever is the source.
        iou_weight: Weight of the soft IoU loss of the tactile image; that of L1 is 100. touch2touch
            only. Default: the preset's, 0.
        contact_alone: Train only the layers that predict the contact, on those of the field run of
            --init-from, whose other predictions stay as they are.
    """
    from t2twin.translate.training.train import train as run

    suffix = "" if direction in ("source-to-target", "image-to-counts") else f"-{direction}"
    folder = out or Path("runs") / f"{model}{suffix}"
    run(
        model, data, preset, folder, seed=seed, epochs=epochs, minutes=minutes, steps=steps,
        init_from=init_from, direction=direction, iou_weight=iou_weight,
        contact_alone=contact_alone,
    )  # fmt: skip


def calibrate_uncertainty(run: tyro.conf.Positional[Path], data: tuple[Path, ...]) -> None:
    """Recalibrate the predicted uncertainty of a field run on validation presses of several
    datasets.

    Args:
        run: Folder of a trained field run; the calibration is written into its best weights.
        data: Folders of datasets with dense counts, including the run's own. Each contributes the
            same number of validation presses.
    """
    from t2twin.core.errors import T2TwinError
    from t2twin.translate.models.distributed import use_all_cores
    from t2twin.translate.training.train import recalibrate

    if not data:
        raise T2TwinError("there is no dataset to calibrate on; give folders with --data")
    use_all_cores()
    presses = recalibrate(run, data)
    print(f"standard deviations calibrated on {presses:,} presses; written to {run}")
