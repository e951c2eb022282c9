"""Sizes and settings of the translators: the paper's, one for a CPU, one for tests.

Settings that Grella et al. 2023 give are theirs; pix2pix's own are Isola et al. 2017's; the rest
says "assumed" or "measured".

Which way a run goes: from the DIGIT to the CySkin, as the paper's translators, or the other.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError

Model = Literal["touch2touch", "resnet18", "field"]
MODELS: tuple[Model, ...] = ("touch2touch", "resnet18", "field")

PAPER_MODELS: tuple[Model, ...] = ("touch2touch", "resnet18")
"""Those of Grella et al. 2023, which learn from any pairs; the field is not in all data sets."""


@dataclass(frozen=True)
class Preset:
    """Everything that decides a training besides its data and seed.

    size: side of the square images, pixels. grey: whether the DIGIT image is turned to grey.
    filters: base width of the networks. batch: pairs a step, over all processes.
    learning_rate, beta1, beta2: Adam's. weight_decay: AdamW's (Loshchilov and Hutter 2019), in
        parts of the learning rate a step; Adam without. schedule: "fixed", or "cosine" down to
        zero over the epochs.
    l1_weight: lambda of the L1 loss beside the adversarial one; touch2touch only.
    shape_weight: the same of the loss of the tactile image's shape (shape_loss), 0 for none;
        touch2touch from the DIGIT to the CySkin only.
    discriminator_share: the discriminator's learning rate in parts of the generator's.
    epochs: most epochs. steps: most steps, rounded to whole epochs, which is what bounds a training
        on many pairs; zero for any number. An epoch is all pairs, or a part of very many
        (loop.steps_of_epoch).
    patience: epochs without a better validation RMSE before it stops.
    averaged_part: part of the steps so far over which the weights that predict are a mean
        (averaging.running_mean); 0 for the last step's weights.
    bf16: compute in bfloat16 where the processor has it.
    brightness, contrast, noise: augmentation of the DIGIT image, standard deviations: an offset and
        noise in parts of full scale, a relative gain. Geometry is never changed: it would break
        the pairing.
    """

    name: str
    size: int
    grey: bool
    filters: int
    batch: int
    learning_rate: float
    beta1: float
    epochs: int
    patience: int
    steps: int = 0
    beta2: float = 0.999
    schedule: Literal["fixed", "cosine"] = "fixed"
    l1_weight: float = 0.0
    shape_weight: float = 0.0
    discriminator_share: float = 1.0
    weight_decay: float = 0.0
    averaged_part: float = 0.0
    bf16: bool = False
    brightness: float = 0.0
    contrast: float = 0.0
    noise: float = 0.0


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
            epochs=200,  # Isola et al. 2017, most of their data sets
            patience=20,  # assumed
        ),
        "cpu": Preset(
            name="cpu",
            size=64,  # assumed
            grey=True,
            filters=16,  # a third of the work of 32 (measured)
            batch=32,  # Grella et al. 2023
            learning_rate=1e-3,  # better than 4e-4 after as many epochs (measured)
            beta1=0.5,
            l1_weight=100.0,
            discriminator_share=0.05,  # at 0.2 it wins in 24 epochs, and L1 and L3 grow (measured)
            schedule="cosine",
            weight_decay=0.05,  # at 0.5 scale small's validation is 3.0 %, not 2.5 (measured)
            averaged_part=0.1,  # at 0.25 the mean falls behind weights that decay (measured)
            epochs=40,
            steps=10_500,  # 24 epochs of the paper's dataset, 52 minutes of one core (measured)
            patience=15,
            bf16=True,
            brightness=0.02,
            contrast=0.05,
            noise=0.01,
        ),
        "smoke": Preset(
            name="smoke",
            size=32,
            grey=True,
            filters=8,
            batch=8,
            learning_rate=1e-3,
            beta1=0.5,
            l1_weight=100.0,
            epochs=10,
            patience=10,
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
            beta1=0.9,  # assumed: Adam as it comes; the paper names no optimizer
            epochs=200,  # assumed
            patience=20,  # assumed
        ),
        "cpu": Preset(
            name="cpu",
            size=96,  # assumed
            grey=False,
            filters=32,  # a quarter of the work, as good in as many epochs (measured)
            batch=32,  # a third faster an epoch than 16 (measured)
            learning_rate=1e-3,
            beta1=0.9,
            schedule="cosine",
            weight_decay=0.5,  # 2.1 % on the probes where none leaves 2.3 (measured)
            averaged_part=0.1,
            epochs=40,
            steps=5300,  # 12 epochs of the paper's dataset, 35 minutes of one core (measured)
            patience=15,
            bf16=True,
            brightness=0.02,
            contrast=0.05,
            noise=0.01,
        ),
        "smoke": Preset(
            name="smoke",
            size=64,  # at 32 the last stage has one pixel, too few for batch norm's statistics
            grey=False,
            filters=16,
            batch=8,
            learning_rate=2e-3,
            beta1=0.9,
            epochs=10,
            patience=10,
        ),
    },
    "field": {
        "paper": Preset(
            name="paper",
            size=256,
            grey=False,
            filters=64,  # He et al. 2016
            batch=32,  # assumed
            learning_rate=1e-3,
            beta1=0.9,
            schedule="cosine",
            weight_decay=0.5,
            averaged_part=0.1,
            epochs=200,
            patience=20,
            bf16=True,
            brightness=0.02,
            contrast=0.05,
            noise=0.01,
        ),
        "cpu": Preset(
            name="cpu",
            size=96,
            grey=False,
            filters=32,
            batch=32,
            learning_rate=1e-3,
            beta1=0.9,
            schedule="cosine",
            weight_decay=0.5,
            averaged_part=0.1,
            epochs=40,
            steps=15_900,
            patience=15,
            bf16=True,
            brightness=0.02,
            contrast=0.05,
            noise=0.01,
        ),
        "smoke": Preset(
            name="smoke",
            size=64,
            grey=False,
            filters=16,
            batch=8,
            learning_rate=2e-3,
            beta1=0.9,
            epochs=10,
            patience=10,
        ),
    },
}


def find_preset(model: str, preset: str | Preset) -> Preset:
    """The preset of that name for that model. Raises T2TwinError that lists the valid names."""
    arguments.text(model, "model")
    if model not in PRESETS:
        raise T2TwinError(f"there is no model {model!r}; it must be one of {', '.join(MODELS)}")
    if isinstance(preset, Preset):
        return preset
    arguments.text(preset, "preset")
    if preset not in PRESETS[model]:
        names = ", ".join(PRESETS[model])
        raise T2TwinError(f"{model} has no preset {preset!r}; it must be one of {names}")
    return PRESETS[model][preset]


Direction = Literal["digit-to-cyskin", "cyskin-to-digit"]

DIGIT_TO_CYSKIN: Direction = "digit-to-cyskin"
CYSKIN_TO_DIGIT: Direction = "cyskin-to-digit"
DIRECTIONS = (DIGIT_TO_CYSKIN, CYSKIN_TO_DIGIT)

TURNS_ROUND = "touch2touch"
"""The model that goes either way: both of its sides are images."""


def check_direction(direction: str, model: str) -> None:
    """Raises T2TwinError for a direction that is none, and for one that the model does not go."""
    if arguments.text(direction, "direction") not in DIRECTIONS:
        raise T2TwinError(
            f"the direction is {direction!r}; it must be one of {', '.join(DIRECTIONS)}"
        )
    if direction == CYSKIN_TO_DIGIT and model != TURNS_ROUND:
        raise T2TwinError(
            f"{model} does not go {direction}; {TURNS_ROUND} goes both ways, the other models "
            f"{DIGIT_TO_CYSKIN} only"
        )


def check_gives_counts(run_dir: Path, direction: str) -> None:
    """Raises T2TwinError for a run that draws DIGIT pictures, where counts are asked for."""
    if direction != DIGIT_TO_CYSKIN:
        raise T2TwinError(
            f"{run_dir} is a {direction} run, which draws DIGIT pictures of counts and gives no "
            f"counts; use a {DIGIT_TO_CYSKIN} run here, or t2twin.load(RUN).picture_of(counts)"
        )
