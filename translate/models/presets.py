"""Models, directions and presets of the translators.

Each model has three presets: the paper's, one for a CPU and one for tests. Values without comment
are those of Grella et al. 2023 or pix2pix (Isola et al. 2017).
"""

from dataclasses import dataclass, replace
from typing import Annotated, Literal, cast, get_args

from msgspec import Meta

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError

Model = Literal["touch2touch", "resnet18", "field"]
MODELS: tuple[Model, ...] = get_args(Model)
# The models of Grella et al. 2023, which need no dense counts in the dataset
PAPER_MODELS: tuple[Model, ...] = ("touch2touch", "resnet18")
SOURCE_TO_TARGET, TARGET_TO_SOURCE = "source-to-target", "target-to-source"
IMAGE_TO_COUNTS, COUNTS_TO_IMAGE = "image-to-counts", "counts-to-image"
# Of a training: the first two are for any dataset, the others for a gel camera and a taxel array
DIRECTIONS = (SOURCE_TO_TARGET, TARGET_TO_SOURCE, IMAGE_TO_COUNTS, COUNTS_TO_IMAGE)
GENERATES = "touch2touch"  # The model of any direction: its inputs and targets are pictures
# What each model predicts from what
DIRECTIONS_OF: dict[Model, tuple[str, ...]] = {
    GENERATES: (IMAGE_TO_COUNTS, COUNTS_TO_IMAGE, "image-to-image", "counts-to-counts"),
    "resnet18": (IMAGE_TO_COUNTS, "counts-to-counts"),
    "field": (IMAGE_TO_COUNTS,),
}
# Maxima of settings (assumed, as those of Preset: more than a machine trains in a month), so that
# a damaged file cannot allocate all memory
MAX_BATCH, MAX_EPOCHS = 65_536, 1_000_000
FIXED: Literal["fixed"] = "fixed"  # The schedule of a constant learning rate
Positive = Annotated[float, Meta(gt=0)]
NotNegative = Annotated[float, Meta(ge=0)]
Share = Annotated[float, Meta(ge=0, le=1)]
Decay = Annotated[float, Meta(ge=0, lt=1)]


@dataclass(frozen=True)
class Preset:
    """All settings of a training except its data and seed."""

    name: str
    size: Annotated[int, Meta(ge=1, le=2048)]  # side of the square pictures, pixels
    grey: bool  # whether images are converted to grey
    filters: Annotated[int, Meta(ge=1, le=1024)]  # base width of the networks
    batch: Annotated[int, Meta(ge=1, le=MAX_BATCH)]  # pairs per step, over all processes
    learning_rate: Positive  # this and the next: Adam's
    beta1: Decay
    epochs: Annotated[int, Meta(ge=1, le=MAX_EPOCHS)]  # maximum
    patience: Annotated[int, Meta(ge=0)]  # epochs without a better validation before it stops
    steps: Annotated[int, Meta(ge=0)] = 0  # maximum; 0 for no limit
    beta2: Decay = 0.999  # Adam's
    schedule: Literal["fixed", "cosine"] = FIXED  # of the rate: "cosine" to zero over the epochs
    l1_weight: NotNegative = 0.0  # of this loss relative to the adversarial one; touch2touch only
    iou_weight: NotNegative = 0.0  # the same of the soft IoU loss
    discriminator_share: NotNegative = 1.0  # its learning rate relative to the generator's
    weight_decay: NotNegative = 0.0  # AdamW's (Loshchilov and Hutter 2019); 0 is Adam
    averaged_part: Share = 0.0  # see base.weight_average; 0 predicts with the last weights
    bf16: bool = False  # train in bfloat16 if the processor can
    # Augmentation of the image, standard deviations: offset as a fraction of full scale, relative
    # gain, and noise as a fraction of full scale
    brightness: NotNegative = 0.0
    contrast: NotNegative = 0.0
    noise: NotNegative = 0.0
    background_share: Share = 0.0  # of a field run's images that become their background frames
    # Standard deviation of relative changes of each color's level and gradients since the
    # background frame was taken
    drift: NotNegative = 0.0


RESNET18_CPU = Preset(
    name="cpu",
    size=96,  # assumed
    grey=False,
    filters=32,  # a quarter of the time of 64, equally good (measured)
    batch=32,  # epochs a third faster than with 16 (measured)
    learning_rate=1e-3,
    beta1=0.9,
    schedule="cosine",
    weight_decay=0.5,  # 2.1 % on the probes, without 2.3 % (measured)
    averaged_part=0.1,
    epochs=40,
    steps=5300,  # 12 epochs of the paper's dataset, 35 minutes of one core (measured)
    patience=15,
    bf16=True,
    brightness=0.02,
    contrast=0.05,
    noise=0.01,
)
# With a size of 32 the last stage has one pixel, too few for batch norm
RESNET18_SMOKE = Preset(
    "smoke", size=64, grey=False, filters=16, batch=8, learning_rate=2e-3, beta1=0.9, epochs=10,
    patience=10,
)  # fmt: skip
FIELD_CPU = replace(RESNET18_CPU, steps=15_900, background_share=0.08)  # both assumed

PRESETS: dict[Model, dict[str, Preset]] = {
    "touch2touch": {
        "paper": Preset(
            name="paper",
            size=256,  # Grella et al. 2023
            grey=True,  # Grella et al. 2023
            filters=64,  # Isola et al. 2017
            batch=32,  # Grella et al. 2023
            learning_rate=2e-4,  # Isola et al. 2017
            beta1=0.5,  # Isola et al. 2017
            l1_weight=100.0,  # Isola et al. 2017
            epochs=200,  # Isola et al. 2017, most of their datasets
            patience=20,  # assumed: within 24 epochs, 6 brought nothing better at most
            bf16=True,  # 2.3 times as fast on two cores (measured)
        ),
        "cpu": replace(
            RESNET18_CPU,
            size=64,  # assumed
            grey=True,
            filters=16,  # a third of the time of 32 (measured)
            batch=32,  # Grella et al. 2023
            learning_rate=1e-3,  # better than 4e-4 after equal epochs (measured)
            beta1=0.5,
            l1_weight=100.0,
            discriminator_share=0.05,  # with 0.2, L1 and L3 increase within 24 epochs (measured)
            weight_decay=0.05,  # validation at scale small 2.5 %, with 0.5 3.0 % (measured)
            averaged_part=0.1,  # 0.25 is too slow for decaying weights (measured)
            steps=10_500,  # 24 epochs of the paper's dataset, 52 minutes of one core (measured)
        ),
        "smoke": replace(
            RESNET18_SMOKE,
            size=32,
            grey=True,
            filters=8,
            learning_rate=1e-3,
            beta1=0.5,
            l1_weight=100.0,
        ),
    },
    "resnet18": {
        "paper": Preset(
            name="paper",
            size=256,  # assumed: the same as touch2touch's; the paper gives none
            grey=False,
            filters=64,  # He et al. 2016
            batch=8,  # Grella et al. 2023
            learning_rate=1e-3,  # Grella et al. 2023, fixed
            beta1=0.9,  # assumed: Adam's default; the paper names no optimizer
            epochs=200,  # assumed
            patience=20,  # assumed: within 46 epochs, 10 brought nothing better at most
            bf16=True,  # twice as fast on two cores (measured)
        ),
        "cpu": RESNET18_CPU,
        "smoke": RESNET18_SMOKE,
    },
    "field": {
        "paper": replace(
            FIELD_CPU, name="paper", size=256, filters=64, steps=0, epochs=200, patience=20
        ),
        "cpu": FIELD_CPU,
        "smoke": RESNET18_SMOKE,
    },
}


def find_preset(model: str, preset: str | Preset) -> Preset:
    """The preset of a model by its name."""
    presets = PRESETS[cast(Model, arguments.choice(model, "the model", MODELS))]
    if isinstance(preset, Preset):
        return preset
    return presets[arguments.choice(preset, f"the preset of {model}", tuple(presets))]


def check_direction(direction: str, model: Model) -> None:
    """Raises T2TwinError for a direction, as DataInfo.direction, that the model does not have."""
    if direction not in DIRECTIONS_OF[model]:
        known = ", ".join(DIRECTIONS_OF[model])
        raise T2TwinError(
            f"{model} has no direction {direction}; it has {known}, and {GENERATES} has all"
        )


def is_reverse(direction: str, source: str, target: str) -> bool:
    """Whether a direction exchanges source and target, each "image" or "counts", of a dataset."""
    arguments.choice(direction, "the direction", DIRECTIONS)
    if direction in (SOURCE_TO_TARGET, f"{source}-to-{target}"):
        return False
    if direction in (TARGET_TO_SOURCE, f"{target}-to-{source}"):
        return True
    raise T2TwinError(
        f"the dataset has {source} and {target}, and no direction {direction}; it has "
        f"{SOURCE_TO_TARGET} and {TARGET_TO_SOURCE}"
    )
