"""The recipe of the dataset that a translator is adapted on."""

from pathlib import Path

from t2twin.core.files import atomic_write

SHAPES_PER_MINUTE = 90
"""Random shapes of the dataset per minute of the adaptation. Pressing them, four times each, takes
a third of the time on two cores of a virtual machine (measured: 0.1 s of a core for a pair)."""

PRIMITIVE_PRESSES_PER_MINUTE = 1.5
"""Presses of each primitive per minute of the adaptation (assumed)."""

WORLD_TEXT = """# Recipe of the dataset that {model} is adapted on, in the light of one unit.
format = 1
name = "adapted"

[[parts]]
shapes = "random"
count = {shapes}
presses = 4
place = {{ normal_mm = 2.5 }}
force_n = {{ low = 0.5, high = 12.0 }}
untouched_share = 0.05
val_share = 0.04

[[parts]]
shapes = "primitives"
presses = {presses}
place = {{ normal_mm = 2.5 }}
force_n = {{ low = 0.5, high = 12.0 }}

[light]
kind = "drawn"
each = "press"
calibration = {calibration}
frames = 1
"""


def write_recipe(file: Path, model: str, minutes: float, calibration: Path) -> None:
    """Writes the recipe of a dataset in the light of one unit.

    file: the recipe. model: named in its comment. minutes: duration of the adaptation, which
    determines the number of presses. calibration: file of the light around which units are
    sampled.
    """
    path = str(calibration.absolute()).replace("\\", "\\\\").replace('"', '\\"')
    text = WORLD_TEXT.format(
        model=model,
        shapes=max(round(SHAPES_PER_MINUTE * minutes), 25),
        presses=max(round(PRIMITIVE_PRESSES_PER_MINUTE * minutes), 2),
        calibration=f'"{path}"',
    )
    with atomic_write(file) as temporary:
        temporary.write_text(text, encoding="utf-8")
