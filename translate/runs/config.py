"""What a run's folder says of it: config.json, enough to build its networks again.

RUN/config.json        model, preset, seed, data set and layout, epochs, versions
RUN/log.jsonl          one line an epoch
RUN/tensorboard/       the same for TensorBoard
RUN/last.safetensors   state after the last epoch, to go on from
RUN/best.safetensors   weights of the epoch with the lowest validation RMSE
RUN/README.md          the model card, once the training is done
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
from t2twin.sim.cyskin.layout import LARGEST_PAD_MM
from t2twin.sim.dataset.info import MAX_COUNTS, check_layout, is_sha256
from t2twin.translate.data.pairs import DataInfo, known
from t2twin.translate.models.presets import DIGIT_TO_CYSKIN, MODELS, Preset, check_direction
from t2twin.translate.uncertainty.ood import CELLS, OODDetector

FORMAT = 1
"""Version of config.json; a file that names none is of this one."""

MOST = {"size": 2048, "filters": 1024, "batch": 65_536, "epochs": 1_000_000}
"""Settings of a preset that are 1 or more, and the most that they may be (assumed: far beyond what
any machine trains in a month), so that a damaged file cannot ask for all memory."""

MAX_STEPS = 100_000_000
"""The most steps of a training (assumed: as above)."""

ZERO_OR_MORE = (
    "patience",
    "steps",
    "beta1",
    "beta2",
    "l1_weight",
    "shape_weight",
    "discriminator_share",
    "averaged_part",
    "weight_decay",
    "brightness",
    "contrast",
    "noise",
)
"""Settings of a preset that are 0 or more; the learning rate is above 0."""

CONFIG = "config.json"
LOG = "log.jsonl"
TENSORBOARD = "tensorboard"
LAST = "last.safetensors"
BEST = "best.safetensors"


@dataclass(frozen=True)
class RunConfig:
    """What a run was asked to do.

    epochs, minutes, steps: as asked for, None where the preset decides. planned_epochs: how many
    that came to; with a limit in minutes it depends on the machine, so it is decided once.
    processes: how many share each batch. Runs of older versions do not know what follows.
    pictures: what those look like that it was trained on. epoch_steps: steps of an epoch. start:
    SHA-256 of the weights that it began with, None of fresh ones. direction: which way it goes.
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
    pictures: OODDetector | None = None
    steps: int | None = None
    epoch_steps: int | None = None
    start: str | None = None
    direction: str = DIGIT_TO_CYSKIN
    format: int = FORMAT

    @property
    def budget(self) -> int:
        """Most steps, asked for or the preset's; 0 for any number, as where epochs are given."""
        return 0 if self.epochs is not None else self.steps or self.preset.steps

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
                "start_sha256": self.start,
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
                "pictures": None
                if self.pictures is None
                else {
                    "mean_grey": self.pictures.mean.round(3).tolist(),
                    "spread_grey": self.pictures.spread.round(3).tolist(),
                    "farthest": self.pictures.farthest,
                },
                "versions": {name: version(name) for name in ("torch", "numpy")},
            },
        )


@dataclass(frozen=True)
class _DataPart:
    """What config.json says of the data set; see DataInfo."""

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
class _PicturesPart:
    """What config.json says of the training pictures; see OODDetector."""

    mean_grey: tuple[Annotated[float, Meta(ge=0, le=255)], ...]
    spread_grey: tuple[Annotated[float, Meta(gt=0, le=255)], ...]
    farthest: Annotated[float, Meta(ge=0)]

    def familiar(self, channels: int, source: Path) -> OODDetector:
        wanted = CELLS * CELLS * channels
        if not len(self.mean_grey) == len(self.spread_grey) == wanted:
            raise T2TwinError(f"{source}: pictures must have {wanted} means and as many spreads")
        return OODDetector(np.array(self.mean_grey), np.array(self.spread_grey), self.farthest)


@dataclass(frozen=True)
class _ConfigFile:
    """config.json as it is written; see RunConfig."""

    model: str
    preset: dict[str, Any]
    seed: Annotated[int, Meta(ge=0, le=MAX_SEED)]
    epochs: Annotated[int, Meta(ge=1)] | None
    minutes: Annotated[float, Meta(gt=0)] | None
    planned_epochs: Annotated[int, Meta(ge=1, le=MOST["epochs"])]
    bf16: bool
    processes: Annotated[int, Meta(ge=1, le=MOST["batch"])]
    data: _DataPart
    pictures: _PicturesPart | None = None
    steps: Annotated[int, Meta(ge=1, le=MAX_STEPS)] | None = None
    epoch_steps: Annotated[int, Meta(ge=1, le=MAX_STEPS)] | None = None
    start_sha256: str | None = None
    direction: str = DIGIT_TO_CYSKIN

    def __post_init__(self) -> None:
        if self.start_sha256 is not None and not is_sha256(self.start_sha256):
            raise ValueError("start_sha256 must be 64 hexadecimal digits")
        if self.model not in MODELS:
            raise ValueError(f"model is {self.model!r}; it must be one of {', '.join(MODELS)}")
        try:
            check_direction(self.direction, self.model)
        except T2TwinError as error:
            raise ValueError(str(error)) from None


def load_config(run_dir: Path) -> RunConfig:
    """A run's config.json. The only place where it is read.

    Raises T2TwinError where the folder holds no run, its config is of another format, or a field is
    missing or wrong.
    """
    path = run_dir / CONFIG
    if not path.is_file():
        raise T2TwinError(f"{run_dir} holds no config.json; give a folder that `train` has made")
    there = read_json(path, _ConfigFile, FORMAT)
    preset, pictures = _preset(there.preset, path), there.pictures
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
            field_x_mm=known(there.data.field_x_mm),
            field_y_mm=known(there.data.field_y_mm),
            pad_diameter_mm=known(there.data.pad_diameter_mm),
        ),
        epochs=there.epochs,
        minutes=there.minutes,
        planned_epochs=there.planned_epochs,
        bf16=there.bf16,
        processes=there.processes,
        pictures=None if pictures is None else pictures.familiar(channels, path),
        steps=there.steps,
        epoch_steps=there.epoch_steps,
        start=there.start_sha256,
        direction=there.direction,
    )


def _list(values: np.ndarray | None) -> list[float] | None:
    return None if values is None else values.tolist()


def _preset(content: dict[str, Any], path: Path) -> Preset:
    """A preset of config.json; a key that Preset does not have is refused, not left out."""
    unknown = sorted(set(content) - {field.name for field in fields(Preset)})
    if unknown:
        raise T2TwinError(f"{path}: preset.{unknown[0]} is no setting of this version")
    preset = convert(content, Preset, f"{path}, preset")
    for name, most in MOST.items():
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
