"""The configuration of a run, config.json, from which its networks are built, and pretrained runs.

RUN/config.json        model, preset, seed, dataset and layout, epochs, versions
RUN/log.jsonl          one line per epoch
RUN/tensorboard/       the same for TensorBoard
RUN/last.safetensors   state after the last epoch, from which a training resumes
RUN/best.safetensors   weights of the epoch with the lowest validation RMSE
RUN/README.md          the model card, after the end of the training

Pretrained runs are part of the package; their names are accepted wherever a run's folder is.
`python -m maintenance.publish_pretrained` writes them.
"""

from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta, Struct

from t2twin.core import arguments
from t2twin.core.arguments import MAX_SEED
from t2twin.core.errors import T2TwinError
from t2twin.core.files import write_json
from t2twin.core.machine import installed_version
from t2twin.core.records import read_json
from t2twin.sim.dataset.info import IMAGE, Sha256, plain
from t2twin.translate.data.pairs import DataInfo
from t2twin.translate.models.presets import (
    IMAGE_TO_COUNTS,
    MAX_BATCH,
    MAX_EPOCHS,
    MODELS,
    Preset,
    check_direction,
    find_model,
)
from t2twin.translate.uncertainty.ood import OODDetector

FORMAT = 3  # Version of config.json
# Maximum steps of a training (assumed: more than a machine trains in a month)
MAX_STEPS = 100_000_000
CONFIG = "config.json"
LOG = "log.jsonl"
TENSORBOARD = "tensorboard"
LAST = "last.safetensors"
BEST = "best.safetensors"
FRAME_CHECK = "frames.safetensors"

Steps = Annotated[int, Meta(ge=1, le=MAX_STEPS)]


class RunConfig(Struct, frozen=True):
    """Configuration of a run, and the content of its config.json.

    epochs, minutes, steps: limits given by the user, or None. planned_epochs: the resulting number;
    with a limit in minutes it depends on the machine and is set once. bf16: whether the networks
    train in bfloat16. processes: number of processes that share a batch. ood_detector: statistics
    of the training images, and epoch_steps: steps per epoch; both are set when training starts.
    init_from: SHA-256 of the initial weights, None for random ones. contact_data: SHA-256 of the
    info.json that the contact's layers alone were trained on; None if all layers were trained
    together. data, ood_detector and the other weights are then those of the initial run.
    """

    model: str
    preset: Preset
    seed: Annotated[int, Meta(ge=0, le=MAX_SEED)]
    data: DataInfo
    epochs: Annotated[int, Meta(ge=1)] | None
    minutes: Annotated[float, Meta(gt=0)] | None
    planned_epochs: Annotated[int, Meta(ge=1, le=MAX_EPOCHS)]
    bf16: bool
    processes: Annotated[int, Meta(ge=1, le=MAX_BATCH)]
    ood_detector: OODDetector | None = None
    steps: Steps | None = None
    epoch_steps: Steps | None = None
    init_from: Sha256 | None = msgspec.field(name="init_from_sha256", default=None)
    contact_data: Sha256 | None = msgspec.field(name="contact_info_sha256", default=None)
    format: int = FORMAT

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

    def need(self, has: bool, run_dir: Path, purpose: str, needed: str) -> None:
        """Raises T2TwinError unless the run has what a purpose needs."""
        if not has:
            kind = self.model if self.is_image_to_counts else f"{self.model} {self.direction}"
            raise T2TwinError(f"the run {run_dir} is {kind}; {purpose} needs {needed}")

    @property
    def full_scale(self) -> float:
        """Full scale of the predictions, counts or grey levels."""
        return self.data.target.full_scale

    def check(self) -> None:
        """Raises ValueError for fields that do not fit together."""
        if self.contact_data is not None and not self.data.has_contact:
            raise ValueError("contact_info_sha256 must be of a run with has_contact")
        if self.model not in MODELS:
            raise ValueError(f"model is {self.model!r}; it must be one of {', '.join(MODELS)}")
        check_direction(self.direction, find_model(self.model))
        if self.ood_detector is not None:
            self.ood_detector.check(channels=1 if self.preset.grey else 3)

    def save(self, run_dir: Path) -> None:
        """Writes RUN/config.json."""
        libraries = {name: installed_version(name) for name in ("torch", "numpy")}
        write_json(run_dir / CONFIG, plain(self) | {"versions": libraries})


def load_config(run_dir: Path) -> RunConfig:
    """Reads a run's config.json.

    Raises T2TwinError if the folder is not a run, if its config has another format, and for missing
    or invalid fields.
    """
    path = run_dir / CONFIG
    if not path.is_file():
        raise T2TwinError(f"{run_dir} has no config.json; give a folder that `train` has made")
    config = read_json(path, RunConfig, FORMAT)
    try:
        config.check()
    except ValueError as error:
        raise T2TwinError(f"{path}: {error}") from None
    return config


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
    as ./NAME or as a Path. NAME@VERSION refers to that version of a pretrained run.
    Raises T2TwinError if there is neither, and for a version that is not part of the package.
    """
    names, path = pretrained_runs(), arguments.path(run, "run")
    name = str(run).partition("@")[0]
    if name in names and (isinstance(run, str) or not path.exists()):
        if str(run) not in (name, versioned(name)):
            raise T2TwinError(f"there is no run {run}; this t2twin contains {versioned(name)}")
        return HOME / name
    if not path.exists():
        known = f", or the name of a pretrained run: {', '.join(names)}" if names else ""
        raise T2TwinError(f"there is no run {run}; give a folder that `train` has made{known}")
    return path
