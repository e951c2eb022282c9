"""A run's model card, RUN/README.md: for people, and for the Hugging Face hub.

What the model card of a run from the CySkin to the DIGIT says of its own.
"""

import json
from dataclasses import fields
from pathlib import Path

from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write
from t2twin.sim.dataset.info import SPLITS, DatasetInfo
from t2twin.sim.dataset.store import read_info, split_shards
from t2twin.translate.data.pairs import load_info
from t2twin.translate.models.presets import CYSKIN_TO_DIGIT, Preset
from t2twin.translate.runs import card
from t2twin.translate.runs.config import BEST, RunConfig, load_config
from t2twin.translate.runs.log import EpochRecord, best_epoch, read_log

CARD = "README.md"

LIMITS = "## What it is not good for"
"""Heading of a card's section."""

TITLES = {"touch2touch": "touch2touch", "resnet18": "ResNet18", "field": "Field"}

WHAT = {
    "touch2touch": """\
It is pix2pix (a U-Net generator, trained against a PatchGAN discriminator and an L1 loss) from the
grey picture to the tactile image, from which the taxels are read back. Other taxel layouts can be
read from the same image.""",
    "resnet18": """\
It is a ResNet18 with one output a taxel, trained on the mean squared error of the counts. It gives
the layout below and no other.""",
    "field": """\
It is a ResNet18 with a small decoder, which tells the field under the whole cover: what a taxel
would count at each of many places, and how sure that is. The layout below is read from it, and so
is any other on the cover.""",
}

ESTIMATE = """\
told = t2twin.load({}).estimate(frame)
told.counts, told.counts_std, told.interval(0.9), told.force_n
"""

CITATION = """\
```bibtex
@inproceedings{grella2023touch,
  title     = {Touch-to-Touch Translation - Learning the Mapping Between Heterogeneous Tactile
               Sensing Technologies},
  author    = {Grella, Francesco and Albini, Alessandro and Cannata, Giorgio and
               Maiolino, Perla},
  booktitle = {IEEE/RSJ International Conference on Intelligent Robots and Systems (IROS)},
  year      = {2023},
  note      = {arXiv:2411.02187}
}
```
"""


def write_card(run_dir: Path, data_dir: Path) -> None:
    """Writes RUN/README.md from the run's config and log, over an earlier one.

    data_dir: the data set that the run was trained on, for its scale, its numbers of pairs, and
    whether it was simulated. Raises T2TwinError where it is another data set, where run_dir holds
    no run, and where the run has not finished an epoch.
    """
    config = load_config(run_dir)
    history = read_log(run_dir)
    if load_info(data_dir).sha256 != config.data.sha256:
        raise T2TwinError(f"{data_dir} is not the data set that {run_dir} was trained on")
    info = read_info(data_dir)
    best, other_way = best_epoch(history), config.direction == CYSKIN_TO_DIGIT
    parts = [
        _head(config, best, info),
        card.what(config) if other_way else _what(config),
        (card.use if other_way else _use)(run_dir.absolute().name, config),
        _data(config, info),
        _training(config, history, best),
        *filter(None, [_sureness(config)]),
        card.limits(info) if other_way else _limits(info),
        f"## License\n\n{_license(info)[1]}\n",
        f"## Citation\n\nThe method:\n\n{CITATION}",
    ]
    with atomic_write(run_dir / CARD) as temporary:
        temporary.write_text("\n".join(parts))


def _license(info: DatasetInfo) -> tuple[str, str]:
    """For the hub, and in words."""
    if info.is_simulated:
        return "mit", "MIT, as t2twin's."
    return "unknown", (
        "t2twin's code is under the MIT license. These weights were trained on pairs that were "
        "brought in; under which license they may be used is for the owner of the pairs to say."
    )


def _head(config: RunConfig, best: EpochRecord, info: DatasetInfo) -> str:
    """The YAML that the hub reads. JSON is YAML, so text in it is written as JSON."""
    pipeline = "pipeline_tag: image-to-image\n" if config.model == "touch2touch" else ""
    tags = ["tactile", "digit", "cyskin", config.model] + ["simulation"] * info.is_simulated
    dataset = f"t2twin, info.json {config.data.sha256[:12]}"
    metrics = [
        (name, f"{value:.{digits}f}")
        for name, value, digits in (
            ("RMSE, counts", best.val_rmse_counts, 1),
            ("RMSE, grey levels", best.val_rmse_grey, 1),
            ("RMSE, % of full scale", best.val_rmse_percent, 3),
        )
        if value is not None
    ]
    listed = "\n".join(
        f"    - {{type: rmse, name: {json.dumps(name)}, value: {value}}}" for name, value in metrics
    )
    task = (
        card.TASK
        if config.direction == CYSKIN_TO_DIGIT
        else "{type: image-to-array, name: DIGIT picture to CySkin counts}"
    )
    return f"""---
license: {_license(info)[0]}
library_name: t2twin
{pipeline}tags: {json.dumps(tags)}
model-index:
- name: {json.dumps(f"{config.model} ({config.preset.name})")}
  results:
  - task: {task}
    dataset: {{name: {json.dumps(dataset)}, type: t2twin, split: validation}}
    metrics:
{listed}
---
"""


def _what(config: RunConfig) -> str:
    return f"""# {TITLES[config.model]}, preset {config.preset.name}

Turns the picture of a DIGIT, a camera behind a soft gel, into the counts that a CySkin, an array of
{config.data.x_mm.size} capacitive taxels, would give for the same touch.

{WHAT[config.model]}
"""


def _use(name: str, config: RunConfig) -> str:
    preset, info = config.preset, config.data
    color = "turned to grey" if preset.grey else "in color"
    return f"""## Use

```python
import t2twin

counts = t2twin.load({json.dumps(name)}).predict(frame)
{ESTIMATE.format(json.dumps(name)) if config.model == "field" else ""}```

or `t2twin translate FOLDER_OF_IMAGES --run {name}`. It needs `config.json` and `{BEST}`.

| | type | unit | what |
|---|---|---|---|
| frame | (h, w, 3) or (h, w) uint8 | grey levels | one DIGIT picture, upright (320 rows x 240 \
columns), channels in the order red, green, blue; also several, (B, h, w, 3) |
| counts | ({info.x_mm.size},) float32 | counts | 0 to {info.full_scale_counts:,.0f}; taxel n lies \
at `layout_x_mm[n]`, `layout_y_mm[n]` (mm) of `config.json` |
{_estimate_rows(config) if config.model == "field" else ""}
Any size of picture is resized to {preset.size} x {preset.size} pixels, {color}. OpenCV gives
channels as blue, green, red: turn them round first.
"""


def _estimate_rows(config: RunConfig) -> str:
    """What a field run tells besides."""
    places = config.data.field_x_mm
    assert places is not None
    return f"""\
| counts_std | ({config.data.x_mm.size},) float32 | counts | standard deviation of each count |
| field, field_std | ({places.size},) float32 | counts | the same at the places `field_x_mm`, \
`field_y_mm` (mm) of `config.json` |
| force_n, force_std_n | () float32 | N | the force of the press; None of a run whose \
presses had one force |
| untouched | as frame | grey levels | may be given beside the frame: the same DIGIT with nothing \
touching it |
"""


def _sureness(config: RunConfig) -> str:
    """How the standard deviations of a field run were put right."""
    if config.model != "field":
        return ""
    return """## How sure it is

Standard deviations are the network's own spreads, each times a factor of its size and of how sure
the press is as a whole: then intervals of 90 % held 90 % of the field on validation presses, among
the surest as among the least sure. On shapes of another kin they may hold less; `t2twin evaluate`
says how much.
"""


def _data(config: RunConfig, info: DatasetInfo) -> str:
    data = config.data
    pairs = {
        split: sum(info.shards[shard].pairs for shard in split_shards(info, split))
        for split in SPLITS
    }
    rows = [
        ("made by", _maker(info)),
        ("pairs", ", ".join(f"{count:,} {split}" for split, count in pairs.items())),
        ("SHA-256 of its info.json", f"`{data.sha256}`"),
        ("taxel layout", f"{data.layout}, {data.x_mm.size} taxels"),
        ("full scale", f"{data.full_scale_counts:,.0f} counts"),
    ]
    return "## Trained on\n\n" + _table(("data set", ""), rows)


def _maker(info: DatasetInfo) -> str:
    if not info.is_simulated:
        return "its owner, who brought the pairs in"
    name = info.world_name
    return f"the paper's protocol, scale {name}" if info.is_protocol else f"the world {name}"


def _training(config: RunConfig, history: list[EpochRecord], best: EpochRecord) -> str:
    spent = sum(record.seconds for record in history) / 60
    rows = [(field.name, _said(getattr(config.preset, field.name))) for field in fields(Preset)]
    rows += [
        ("direction", config.direction),
        *([] if config.steps is None else [("steps asked for", _said(config.steps))]),
        ("planned epochs", _said(config.planned_epochs)),
        ("steps of an epoch", _said(config.epoch_steps or "all of the data")),
        ("seed", _said(config.seed)),
        ("computed in", "bf16" if config.bf16 else "fp32"),
        ("processes", _said(config.processes)),
    ]
    error = card.error(best) if best.val_rmse_counts is None else _error(best)
    return f"""## Training

The weights are those of epoch {best.epoch} of the {len(history)} that were trained, the one with
the lowest error on the validation split: {error}
It took {spent:.1f} minutes.

{_table(("setting", "value"), rows)}
`translate/models/presets.py` says what each setting is and where it comes from.
"""


def _error(best: EpochRecord) -> str:
    return f"""\
an RMSE of {best.val_rmse_counts:,.0f} counts, {best.val_rmse_percent:.2f} % of full scale. RMSE is
the root of the paper's L3, the squared error averaged over taxels and pairs."""


def _limits(info: DatasetInfo) -> str:
    if info.is_simulated:
        first = """\
- It has seen simulated pictures only. On a real DIGIT, whose gel, lights and camera differ from
  one unit to the next, expect it to be wrong unless the data set was made with a calibration of
  that unit; and no real CySkin has the simulated one's gain."""
    else:
        first = """\
- It knows the two sensors that its pairs came from. Another unit's gel, lights, camera or taxels
  differ, and nothing here says by how much it is wrong there."""
    return f"""{LIMITS}

{first}
- Shapes that reach beyond the DIGIT's view light taxels of which the picture says nothing.
- Presses are straight down and at rest: no shear, no slip, no rolling.
- The figure above is for validation shapes that are kin to the training shapes. Other objects are
  harder; `t2twin evaluate` measures them, on any dataset.
- Counts are not newtons. Nothing here is fit to guard people or machines from force.
"""


def _table(head: tuple[str, str], rows: list[tuple[str, str]]) -> str:
    lines = [head, ("---", "---"), *rows]
    return "".join(f"| {left} | {right} |\n" for left, right in lines)


def _said(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


TASK = "{type: array-to-image, name: CySkin counts to DIGIT picture}"


def what(config: RunConfig) -> str:
    return f"""# touch2touch the other way, preset {config.preset.name}

Draws the picture that a DIGIT, a camera behind a soft gel, would take of a touch, from the counts
that a CySkin, an array of {config.data.x_mm.size} capacitive taxels, gives for it.

It is pix2pix (a U-Net generator, trained against a PatchGAN discriminator and an L1 loss) from the
tactile image of the counts to the grey picture. It gives no counts.
"""


def use(name: str, config: RunConfig) -> str:
    size, info = config.preset.size, config.data
    return f"""## Use

```python
import t2twin
picture = t2twin.load({json.dumps(name)}).picture_of(counts)
```

It needs `config.json` and `{BEST}`. `t2twin translate`, `live`, `export`, `evaluate`, `report` and
`studio` turn pictures into counts and refuse it.

| | type | unit | what |
|---|---|---|---|
| counts | ({info.x_mm.size},) numbers | counts | 0 to {info.full_scale_counts:,.0f}; taxel n lies \
at `layout_x_mm[n]`, `layout_y_mm[n]` (mm) of `config.json`; also several, (B, {info.x_mm.size}) |
| picture | ({size}, {size}) uint8 | grey levels | the DIGIT's picture, 320 rows x 240 columns, \
resized to a square; of several, (B, {size}, {size}) |
"""


def error(best: EpochRecord) -> str:
    return f"""\
an RMSE of {best.val_rmse_grey:.1f} grey levels of the pictures' pixels,
{best.val_rmse_percent:.2f} % of their full scale, 255."""


def limits(info: DatasetInfo) -> str:
    simulated, brought = "simulated touches only", "the two sensors that its pairs came from only"
    seen = simulated if info.is_simulated else brought
    return f"""## What it is not good for

- It has seen {seen}. It draws the light and the gel of that DIGIT, not of another.
- Few counts cannot say what a picture shows: teeth, edges and anything finer than the taxels lie
  apart are made up, by what the training's shapes were like.
- The figure above is for validation shapes that are kin to the training shapes, and of whole
  pictures, most of whose pixels no touch changes much.
- Nothing drawn here is a measurement.
"""
