"""The configuration of a run, config.json, from which its networks are built.

RUN/config.json        model, preset, seed, dataset and layout, epochs, versions
RUN/log.jsonl          one line per epoch
RUN/tensorboard/       the same for TensorBoard
RUN/last.safetensors   state after the last epoch, from which a training resumes
RUN/best.safetensors   weights of the epoch with the lowest validation RMSE
RUN/README.md          the model card, after the end of the training
"""

from dataclasses import asdict, dataclass, fields
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from msgspec import Meta

from t2twin.core.arguments import MAX_SEED
from t2twin.core.errors import T2TwinError
from t2twin.core.files import write_json
from t2twin.core.records import convert, read_json
from t2twin.core.renames import translated
from t2twin.sim.cyskin.layout import LARGEST_PAD_MM
from t2twin.sim.dataset.info import MAX_COUNTS, check_layout, is_sha256
from t2twin.translate.data.images import WHITE_GREY
from t2twin.translate.data.pairs import DataInfo, optional_array
from t2twin.translate.models.presets import (
    CYSKIN_TO_DIGIT,
    DIGIT_TO_CYSKIN,
    MODELS,
    Preset,
    check_direction,
)
from t2twin.translate.uncertainty.ood import CELLS, OODDetector

FORMAT = 1
"""Version of config.json; a file without a version has this one."""

MAX_SETTINGS = {"size": 2048, "filters": 1024, "batch": 65_536, "epochs": 1_000_000}
"""Settings of a preset that are 1 or more, and their maxima (assumed: more than a machine trains in
a month), so that a damaged file cannot allocate all memory."""

MAX_STEPS = 100_000_000
"""Maximum steps of a training (assumed, as above)."""

ZERO_OR_MORE = (
    "patience",
    "steps",
    "beta1",
    "beta2",
    "l1_weight",
    "iou_weight",
    "discriminator_share",
    "averaged_part",
    "weight_decay",
    "brightness",
    "contrast",
    "noise",
)
"""Settings of a preset that are 0 or more."""

CONFIG = "config.json"
LOG = "log.jsonl"
TENSORBOARD = "tensorboard"
LAST = "last.safetensors"
BEST = "best.safetensors"


@dataclass(frozen=True)
class RunConfig:
    """Configuration of a run.

    epochs, minutes, steps: limits given by the user, or None. planned_epochs: the resulting number;
    with a limit in minutes it depends on the machine and is set once. processes: number of
    processes that share a batch. Runs of older versions lack the following. ood_detector:
    statistics of the training images. epoch_steps: steps per epoch. init_from: SHA-256 of the
    initial weights, None for random ones. direction: see module presets.
    """

    model: str
    preset: Preset
    seed: int
    data: DataInfo
    epochs: int | None
    minutes: float | None
    planned_epochs: int
    bf16: bool
    processes: int
    ood_detector: OODDetector | None = None
    steps: int | None = None
    epoch_steps: int | None = None
    init_from: str | None = None
    direction: str = DIGIT_TO_CYSKIN
    format: int = FORMAT

    @property
    def budget(self) -> int:
        """Maximum steps, the user's or the preset's; 0 for no limit, as with given epochs."""
        return 0 if self.epochs is not None else self.steps or self.preset.steps

    @property
    def predicts_images(self) -> bool:
        """Whether the run predicts DIGIT images from counts, rather than counts from images."""
        return self.direction == CYSKIN_TO_DIGIT

    @property
    def full_scale(self) -> float:
        """Full scale of the predictions, counts or grey levels."""
        return WHITE_GREY if self.predicts_images else self.data.full_scale_counts

    def save(self, run_dir: Path) -> None:
        """Writes RUN/config.json."""
        data = self.data
        write_json(
            run_dir / CONFIG,
            {
                "format": self.format,
                "model": self.model,
                "direction": self.direction,
                "preset": asdict(self.preset),
                "seed": self.seed,
                "epochs": self.epochs,
                "minutes": self.minutes,
                "steps": self.steps,
                "planned_epochs": self.planned_epochs,
                "epoch_steps": self.epoch_steps,
                "init_from_sha256": self.init_from,
                "bf16": self.bf16,
                "processes": self.processes,
                "data": {
                    "info_sha256": data.sha256,
                    "layout": data.layout,
                    "layout_x_mm": data.x_mm.tolist(),
                    "layout_y_mm": data.y_mm.tolist(),
                    "full_scale_counts": data.full_scale_counts,
                    "world": data.world,
                    "train_pairs": data.train_pairs,
                    "field_x_mm": _list(data.field_x_mm),
                    "field_y_mm": _list(data.field_y_mm),
                    "pad_diameter_mm": _list(data.pad_diameter_mm),
                },
                "ood_detector": None if self.ood_detector is None else _as_json(self.ood_detector),
                "versions": {name: version(name) for name in ("torch", "numpy")},
            },
        )


@dataclass(frozen=True)
class _DataPart:
    """The dataset in config.json; see DataInfo."""

    info_sha256: str
    layout: str
    layout_x_mm: tuple[float, ...]
    layout_y_mm: tuple[float, ...]
    full_scale_counts: Annotated[float, Meta(ge=1, le=MAX_COUNTS)]
    world: str | None = None
    train_pairs: Annotated[int, Meta(ge=0)] | None = None
    field_x_mm: tuple[float, ...] | None = None
    field_y_mm: tuple[float, ...] | None = None
    pad_diameter_mm: tuple[Annotated[float, Meta(gt=0, le=LARGEST_PAD_MM)], ...] | None = None

    def __post_init__(self) -> None:
        check_layout(self.layout_x_mm, self.layout_y_mm)
        if not is_sha256(self.info_sha256):
            raise ValueError("info_sha256 must be 64 hexadecimal digits")
        if self.field_x_mm is not None or self.field_y_mm is not None:
            check_layout(self.field_x_mm or (), self.field_y_mm or ())
        if len(self.pad_diameter_mm or self.layout_x_mm) != len(self.layout_x_mm):
            raise ValueError("pad_diameter_mm must have one for each taxel")


@dataclass(frozen=True)
class _OODPart:
    """The statistics of the training images in config.json; see OODDetector."""

    mean_grey: tuple[Annotated[float, Meta(ge=0, le=255)], ...]
    std_grey: tuple[Annotated[float, Meta(gt=0, le=255)], ...]
    max_distance: Annotated[float, Meta(ge=0)]

    def detector(self, channels: int, source: Path) -> OODDetector:
        values = CELLS * CELLS * channels
        if not len(self.mean_grey) == len(self.std_grey) == values:
            raise T2TwinError(
                f"{source}: ood_detector must have {values} values in mean_grey and in std_grey"
            )
        return OODDetector(np.array(self.mean_grey), np.array(self.std_grey), self.max_distance)


@dataclass(frozen=True)
class _ConfigFile:
    """The content of config.json; see RunConfig."""

    model: str
    preset: dict[str, Any]
    seed: Annotated[int, Meta(ge=0, le=MAX_SEED)]
    epochs: Annotated[int, Meta(ge=1)] | None
    minutes: Annotated[float, Meta(gt=0)] | None
    planned_epochs: Annotated[int, Meta(ge=1, le=MAX_SETTINGS["epochs"])]
    bf16: bool
    processes: Annotated[int, Meta(ge=1, le=MAX_SETTINGS["batch"])]
    data: _DataPart
    ood_detector: _OODPart | None = None
    steps: Annotated[int, Meta(ge=1, le=MAX_STEPS)] | None = None
    epoch_steps: Annotated[int, Meta(ge=1, le=MAX_STEPS)] | None = None
    init_from_sha256: str | None = None
    direction: str = DIGIT_TO_CYSKIN

    def __post_init__(self) -> None:
        if self.init_from_sha256 is not None and not is_sha256(self.init_from_sha256):
            raise ValueError("init_from_sha256 must be 64 hexadecimal digits")
        if self.model not in MODELS:
            raise ValueError(f"model is {self.model!r}; it must be one of {', '.join(MODELS)}")
        try:
            check_direction(self.direction, self.model)
        except T2TwinError as error:
            raise ValueError(str(error)) from None


def load_config(run_dir: Path) -> RunConfig:
    """Reads a run's config.json, of this version or of 0.2.

    Raises T2TwinError if the folder is not a run, if its config has another format, and for missing
    or invalid fields.
    """
    path = run_dir / CONFIG
    if not path.is_file():
        raise T2TwinError(f"{run_dir} has no config.json; give a folder that `train` has made")
    content = translated("json", read_json(path, dict[str, Any], FORMAT))
    there = convert(content, _ConfigFile, path)
    preset, ood = _preset(there.preset, path), there.ood_detector
    channels = 1 if preset.grey else 3
    return RunConfig(
        model=there.model,
        preset=preset,
        seed=there.seed,
        data=DataInfo(
            sha256=there.data.info_sha256,
            layout=there.data.layout,
            x_mm=np.array(there.data.layout_x_mm),
            y_mm=np.array(there.data.layout_y_mm),
            full_scale_counts=there.data.full_scale_counts,
            world=there.data.world,
            train_pairs=there.data.train_pairs,
            field_x_mm=optional_array(there.data.field_x_mm),
            field_y_mm=optional_array(there.data.field_y_mm),
            pad_diameter_mm=optional_array(there.data.pad_diameter_mm),
        ),
        epochs=there.epochs,
        minutes=there.minutes,
        planned_epochs=there.planned_epochs,
        bf16=there.bf16,
        processes=there.processes,
        ood_detector=None if ood is None else ood.detector(channels, path),
        steps=there.steps,
        epoch_steps=there.epoch_steps,
        init_from=there.init_from_sha256,
        direction=there.direction,
    )


def _as_json(detector: OODDetector) -> dict[str, Any]:
    return {
        "mean_grey": detector.mean.round(3).tolist(),
        "std_grey": detector.std.round(3).tolist(),
        "max_distance": detector.max_distance,
    }


def _list(values: np.ndarray | None) -> list[float] | None:
    return None if values is None else values.tolist()


def _preset(content: dict[str, Any], path: Path) -> Preset:
    """The preset in config.json. Raises T2TwinError for unknown keys and values out of range."""
    unknown = sorted(set(content) - {field.name for field in fields(Preset)})
    if unknown:
        raise T2TwinError(f"{path}: preset.{unknown[0]} is no setting of this version")
    preset = convert(content, Preset, f"{path}, preset")
    for name, most in MAX_SETTINGS.items():
        if not 1 <= getattr(preset, name) <= most:
            raise T2TwinError(f"{path}, preset: {name} must be from 1 to {most}")
    for name in ZERO_OR_MORE:
        if getattr(preset, name) < 0:
            raise T2TwinError(f"{path}, preset: {name} must be 0 or more")
    if not preset.learning_rate > 0:
        raise T2TwinError(f"{path}, preset: learning_rate must be above 0")
    if preset.averaged_part > 1:
        raise T2TwinError(f"{path}, preset: averaged_part must be at most 1")
    if preset.beta1 >= 1 or preset.beta2 >= 1:
        raise T2TwinError(f"{path}, preset: beta1 and beta2 must be below 1")
    return preset
