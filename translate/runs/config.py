"""A run: its configuration, from which its networks are built, its log, and pretrained runs.

RUN/config.json        model, preset, seed, dataset and layout, epochs, versions
RUN/log.jsonl          one line per epoch
RUN/tensorboard/       the same for TensorBoard
RUN/last.safetensors   state after the last epoch, with the log, from which a training resumes
RUN/best.safetensors   weights of the epoch with the lowest validation RMSE
RUN/README.md          the model card, after the end of the training

Pretrained runs are part of the package; their names are accepted wherever a run's folder is.
`python -m maintenance.publish_pretrained` writes them.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta, Struct

from t2twin.core import arguments
from t2twin.core.arguments import MAX_SEED
from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write, read_file, write_json
from t2twin.core.machine import installed_version
from t2twin.core.records import FORMAT, decode_json, read_json
from t2twin.sim.dataset.info import IMAGE, Sha256, plain
from t2twin.translate.data.pairs import DataInfo
from t2twin.translate.models.presets import (
    IMAGE_TO_COUNTS,
    MAX_BATCH,
    MAX_EPOCHS,
    Model,
    Preset,
    check_direction,
)
from t2twin.translate.uncertainty.ood import OODDetector

# Maximum steps of a training (assumed: more than a machine trains in a month)
MAX_STEPS = 100_000_000
CONFIG = "config.json"
LOG = "log.jsonl"
TENSORBOARD = "tensorboard"
LAST = "last.safetensors"
BEST = "best.safetensors"
FRAME_CHECK = "frames.safetensors"

Steps = Annotated[int, Meta(ge=1, le=MAX_STEPS)]
NotNegative = Annotated[float, Meta(ge=0)]


class RunConfig(Struct, frozen=True):
    """Configuration of a run, and the content of its config.json.

    Raises ValueError for fields that do not fit together. If the contact's layers alone were
    trained, data, ood_detector and the other weights are those of the initial run.
    """

    model: Model
    preset: Preset
    seed: Annotated[int, Meta(ge=0, le=MAX_SEED)]
    data: DataInfo
    # epochs, minutes, and steps below: limits given by the user, or None
    epochs: Annotated[int, Meta(ge=1)] | None
    minutes: Annotated[float, Meta(gt=0)] | None
    # the resulting epochs; with a limit in minutes they depend on the machine and are set once
    planned_epochs: Annotated[int, Meta(ge=1, le=MAX_EPOCHS)]
    bf16: bool  # whether the networks train in bfloat16
    processes: Annotated[int, Meta(ge=1, le=MAX_BATCH)]  # that share a batch
    ood_detector: OODDetector | None = None  # set when training starts, as epoch_steps
    steps: Steps | None = None
    epoch_steps: Steps | None = None  # steps per epoch
    # SHA-256 of the initial weights, None for random ones
    init_from: Sha256 | None = msgspec.field(name="init_from_sha256", default=None)
    # SHA-256 of the info.json that the contact's layers alone were trained on; None for all layers
    contact_data: Sha256 | None = msgspec.field(name="contact_info_sha256", default=None)
    # Ranges of `TrainedTranslator._differences` in validation, by name; set when training ends
    agreement: dict[str, tuple[float, float]] = {}
    format: str = FORMAT

    def __post_init__(self) -> None:
        if self.contact_data is not None and not self.data.has_contact:
            raise ValueError("contact_info_sha256 must be of a run with has_contact")
        check_direction(self.direction, self.model)
        if self.ood_detector is not None:
            self.ood_detector.check(channels=1 if self.preset.grey else 3)

    def __repr__(self) -> str:
        return f"RunConfig({self.model!r}, {self.direction}, preset {self.preset.name})"

    @property
    def budget(self) -> int:
        """Maximum steps, the user's or the preset's; 0 for no limit, as with given epochs."""
        return 0 if self.epochs is not None else self.steps or self.preset.steps

    @property
    def precision(self) -> str:
        """Name of the numbers that the networks train in."""
        return "bf16" if self.bf16 else "fp32"

    @property
    def direction(self) -> str:
        """What the run predicts from what, as "image-to-counts"."""
        return self.data.direction

    @property
    def predicts_images(self) -> bool:
        """Whether the run predicts images, rather than counts."""
        return self.data.target.value == IMAGE

    @property
    def is_image_to_counts(self) -> bool:
        """Whether the run predicts counts from images."""
        return self.direction == IMAGE_TO_COUNTS

    @property
    def has_uncertainty(self) -> bool:
        """Whether it is a field run, which predicts dense counts, force and uncertainty."""
        return self.model == "field"

    @property
    def predicts_contact(self) -> bool:
        """Whether the run predicts the contact."""
        return bool(self.data.has_contact)

    def need(self, has: bool, run_dir: Path, purpose: str, needed: str) -> None:
        """Raises T2TwinError unless the run has what a purpose needs."""
        if not has:
            kind = self.model if self.is_image_to_counts else f"{self.model} {self.direction}"
            raise T2TwinError(f"the run {run_dir} is {kind}; {purpose} needs {needed}")

    def save(self, run_dir: Path) -> None:
        """Writes RUN/config.json."""
        libraries = {name: installed_version(name) for name in ("torch", "numpy")}
        write_json(run_dir / CONFIG, plain(self) | {"versions": libraries})


def load_config(run_dir: Path) -> RunConfig:
    """Reads a run's config.json. Raises T2TwinError for a folder that is not a run, for another
    format, and for missing or invalid fields."""
    path = run_dir / CONFIG
    if not path.is_file():
        found = f"{run_dir} has no {CONFIG}" if run_dir.exists() else f"there is no run {run_dir}"
        raise T2TwinError(f"{found}; give a folder that `t2twin train` has made")
    return read_json(path, RunConfig, "`t2twin train` or `t2twin adapt`")


class EpochRecord(Struct, frozen=True, omit_defaults=True):
    """One epoch."""

    epoch: Annotated[int, Meta(ge=1)]  # its number
    learning_rate: NotNegative
    train: dict[str, float]  # the model's losses, averaged over the steps
    val_rmse_percent: NotNegative  # on the validation split, percent of full scale
    seconds: NotNegative  # duration
    val_rmse_counts: NotNegative | None = None
    val_rmse_grey: NotNegative | None = None  # of a run that predicts images
    val_shear_error: NotNegative | None = None  # see FieldTranslator.further_errors
    val_contact_error_mm: NotNegative | None = None

    @property
    def error(self) -> float:
        """What the best epoch has the least of: the product of the errors there are."""
        others = (self.val_shear_error or 1.0) * (self.val_contact_error_mm or 1.0)
        return self.val_rmse_percent * others

    @property
    def numbers(self) -> dict[str, float]:
        """All numbers by name, with train_NAME for losses."""
        found = msgspec.structs.asdict(self)
        losses = {f"train_{name}": value for name, value in found.pop("train").items()}
        return losses | {name: value for name, value in found.items() if value is not None}


class EpochPart(Struct, frozen=True):
    """The steps that were done of an epoch, in a state saved before its end."""

    steps: Annotated[int, Meta(ge=0)] = 0
    losses: dict[str, float] = {}  # the model's, summed over the steps
    seconds: NotNegative = 0.0  # duration


class TrainingState(Struct, frozen=True):
    """What the saved state of a training contains beside its tensors."""

    history: list[EpochRecord]  # one record per complete epoch
    part: EpochPart  # what has been done of the next one


def best_epoch(history: Sequence[EpochRecord]) -> EpochRecord:
    """The epoch with the lowest validation error, the first of equals. history: not empty."""
    return min(history, key=lambda record: record.error)


def read_log(run_dir: Path) -> list[EpochRecord]:
    """Reads a run's log.jsonl, at least one epoch. Raises T2TwinError for anything else."""
    path = run_dir / LOG
    lines = read_file(path).splitlines() if path.is_file() else []
    if not lines:
        raise T2TwinError(
            f"{run_dir} has no epoch in {LOG}: the first is not finished; `t2twin train` does it"
        )
    return [
        decode_json(line, EpochRecord, f"{path}, line {number}")
        for number, line in enumerate(lines, 1)
    ]


def write_log(run_dir: Path, history: Sequence[EpochRecord]) -> None:
    """Writes RUN/log.jsonl; replaces an earlier one."""
    with atomic_write(run_dir / LOG) as temporary:
        temporary.write_bytes(b"".join(msgspec.json.encode(each) + b"\n" for each in history))


# Folder of the pretrained runs
HOME = Path(__file__).parents[1] / "weights"

DEFAULT_RUN = "field"  # The pretrained run that commands, `load` and the studio use by default
# Versions of the pretrained runs, 1 unless given. Another training predicts other counts
VERSIONS = {"field": 3}


def pretrained_runs() -> tuple[str, ...]:
    """Names of the pretrained runs."""
    return tuple(sorted(path.parent.name for path in HOME.glob(f"*/{CONFIG}")))


def versioned(name: str) -> str:
    """Name and version of a pretrained run, such as field@2."""
    return f"{name}@{VERSIONS.get(name, 1)}"


def resolve_run(run: str | Path) -> Path:
    """The folder of a run, given as a folder or as the name of a pretrained run.

    A text equal to the name of a pretrained run refers to that run; a folder of that name is given
    as ./NAME or as a Path. Raises T2TwinError for neither, and for another version in NAME@VERSION.
    """
    names, path = pretrained_runs(), arguments.path(run, "run")
    name = str(run).partition("@")[0]
    if name in names and (isinstance(run, str) or not path.exists()):
        if str(run) not in (name, versioned(name)):
            raise T2TwinError(f"there is no run {run}; this t2twin contains {versioned(name)}")
        return HOME / name
    if not path.exists():
        known = f", or the name of a pretrained run: {', '.join(names)}" if names else ""
        raise T2TwinError(f"there is no run {run}; give a folder of `t2twin train`{known}")
    return path
