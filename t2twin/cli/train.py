"""t2twin train

t2twin temper
"""

from pathlib import Path
from typing import Annotated, Literal

import tyro


def train(
    model: tyro.conf.Positional[Annotated[str, tyro.conf.arg(metavar="MODEL")]],
    data: Annotated[Path, tyro.conf.arg(metavar="DIR")],
    preset: str = "cpu",
    out: Annotated[Path | None, tyro.conf.arg(metavar="RUN")] = None,
    seed: int = 0,
    epochs: Annotated[int | None, tyro.conf.arg(metavar="INT")] = None,
    minutes: Annotated[float | None, tyro.conf.arg(metavar="FLOAT")] = None,
    steps: Annotated[int | None, tyro.conf.arg(metavar="INT")] = None,
    start: Annotated[Path | None, tyro.conf.arg(metavar="RUN")] = None,
    direction: Literal["digit-to-cyskin", "cyskin-to-digit"] = "digit-to-cyskin",
    shape_weight: Annotated[float | None, tyro.conf.arg(metavar="FLOAT")] = None,
) -> None:
    """Train a translator, or go on with a training that was stopped.

    Args:
        model: touch2touch, resnet18 or field, which needs pairs that hold the field.
        data: Folder of the dataset.
        preset: cpu (two cores), paper (as published; wants a GPU) or smoke (seconds).
        out: Folder of the run; runs/MODEL unless given, or runs/MODEL-cyskin-to-digit.
        seed: Seed of weights, order, dropout and augmentation.
        epochs: Most epochs; the preset's unless given.
        minutes: Most minutes; the epochs are planned to fit.
        steps: Most steps, in whole epochs; the preset's unless given.
        start: Another run of the same model, whose weights this one begins with.
        direction: digit-to-cyskin, or, of touch2touch, the other way: DIGIT pictures from counts.
        shape_weight: Weight of the loss of the tactile image's shape beside L1's 100; the preset's,
            none, unless given; touch2touch only.
    """
    from t2twin.translate.training.train import train as run

    way = "" if direction == "digit-to-cyskin" else f"-{direction}"
    folder = out or Path("runs") / f"{model}{way}"
    run(
        model, data, preset, folder, seed=seed, epochs=epochs, minutes=minutes, steps=steps,
        start=start, direction=direction, shape_weight=shape_weight,
    )  # fmt: skip


def temper(
    run: tyro.conf.Positional[Annotated[Path, tyro.conf.arg(metavar="RUN")]],
    data: Annotated[
        tuple[Path, ...], tyro.conf.arg(metavar="DIR", help_behavior_hint="(one or more)")
    ],
) -> None:
    """Put a field run's standard deviations right anew, on validation presses of several worlds.

    Args:
        run: Folder of a trained field run; its best weights keep what is found.
        data: Folders of datasets whose pairs hold the field, the run's own among them. Each one's
            validation presses have the same say.
    """
    from t2twin.core.errors import T2TwinError
    from t2twin.translate.models.distributed import use_all_cores
    from t2twin.translate.training.recalibrate import temper as fit

    if not data:
        raise T2TwinError("there is no dataset to temper on; give folders with --data")
    use_all_cores()
    presses = fit(run, data)
    print(f"standard deviations fitted on {presses:,} presses; written to {run}")
