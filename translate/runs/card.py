"""The model card of a run, RUN/README.md, for readers and for the Hugging Face hub."""

import json
from dataclasses import fields
from pathlib import Path

from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write
from t2twin.sim.dataset.info import SPLITS, DatasetInfo
from t2twin.sim.dataset.store import read_info, split_shards
from t2twin.translate.data.pairs import load_info
from t2twin.translate.models.presets import Preset
from t2twin.translate.runs import card_text as text
from t2twin.translate.runs.config import BEST, RunConfig, load_config
from t2twin.translate.runs.log import EpochRecord, best_epoch, read_log

CARD = "README.md"

LIMITS = "## Limits"
"""Heading of the section on limits."""


def write_card(run_dir: Path, data_dir: Path) -> None:
    """Writes RUN/README.md from the run's configuration and log, and from its dataset.

    Raises T2TwinError for a dataset that the run was not trained on, a folder that is not a run,
    and a run without a finished epoch.
    """
    config = load_config(run_dir)
    history = read_log(run_dir)
    if load_info(data_dir).sha256 != config.data.sha256:
        raise T2TwinError(f"{data_dir} is not the dataset that {run_dir} was trained on")
    info = read_info(data_dir)
    best, name = best_epoch(history), run_dir.absolute().name
    reverse = config.predicts_images
    parts = [
        _head(config, best, info),
        _description(config),
        (_use_reverse if reverse else _use)(name, config),
        _data(config, info),
        _training(config, history, best),
        *([text.UNCERTAINTY] if config.model == "field" else []),
        f"{LIMITS}\n\n"
        f"{text.TRAINED_ON_SIMULATION if info.is_simulated else text.TRAINED_ON_PAIRS}\n"
        f"{text.REVERSE_LIMITS if reverse else text.LIMITS}",
        f"## License\n\n{text.LICENSES[info.is_simulated][1]}\n",
        f"## Citation\n\nThe method:\n\n{text.CITATION}",
    ]
    with atomic_write(run_dir / CARD) as temporary:
        temporary.write_text("\n".join(parts))


def _head(config: RunConfig, best: EpochRecord, info: DatasetInfo) -> str:
    """The YAML header for the hub; its texts are JSON, which is valid YAML."""
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
        "{type: array-to-image, name: CySkin counts to DIGIT image}"
        if config.predicts_images
        else "{type: image-to-array, name: DIGIT image to CySkin counts}"
    )
    return f"""---
license: {text.LICENSES[info.is_simulated][0]}
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


def _description(config: RunConfig) -> str:
    taxels = f"a CySkin, an array of {config.data.x_mm.size} capacitive taxels,"
    if config.predicts_images:
        return f"""# Reversed touch2touch, preset {config.preset.name}

Predicts the image of a DIGIT, a camera behind a soft gel, from the counts of {taxels}
for the same press.

{text.MODELS["reverse"]}
"""
    return f"""# {text.TITLES[config.model]}, preset {config.preset.name}

Predicts the counts of {taxels} from the image of a DIGIT,
a camera behind a soft gel, for the same press.

{text.MODELS[config.model]}
"""


def _use(name: str, config: RunConfig) -> str:
    preset, info = config.preset, config.data
    color = "converted to grey" if preset.grey else "in color"
    estimate = estimate_rows = ""
    if config.model == "field":
        estimate = f"""\
estimate = t2twin.load({json.dumps(name)}).estimate(frame)
estimate.counts, estimate.counts_std, estimate.interval(0.9), estimate.force_n
"""
        estimate_rows = _estimate_rows(config)
    return f"""## Use

```python
import t2twin

counts = t2twin.load({json.dumps(name)}).predict(frame)
{estimate}```

or `t2twin translate FOLDER_OF_IMAGES --run {name}`. It needs `config.json` and `{BEST}`.

| | type | unit | content |
|---|---|---|---|
| frame | (h, w, 3) or (h, w) uint8 | grey levels | one DIGIT image, upright (320 rows x 240 \
columns), channels red, green, blue; or several, (B, h, w, 3) |
| counts | ({info.x_mm.size},) float32 | counts | 0 to {info.full_scale_counts:,.0f}; taxel n is \
at `layout_x_mm[n]`, `layout_y_mm[n]` (mm) of `config.json` |
{estimate_rows}
Images are resized to {preset.size} x {preset.size} pixels, {color}. OpenCV's channels are blue,
green, red: reverse them first.
"""


def _estimate_rows(config: RunConfig) -> str:
    places = config.data.field_x_mm
    assert places is not None
    return f"""\
| counts_std | ({config.data.x_mm.size},) float32 | counts | standard deviation of each count |
| field, field_std | ({places.size},) float32 | counts | the same at the places `field_x_mm`, \
`field_y_mm` (mm) of `config.json` |
| force_n, force_std_n | () float32 | N | force of the press; None for a run trained on presses of \
one force |
| background | as frame | grey levels | optional: the background frame of the same DIGIT, without \
contact |
"""


def _use_reverse(name: str, config: RunConfig) -> str:
    size, info = config.preset.size, config.data
    return f"""## Use

```python
import t2twin
image = t2twin.load({json.dumps(name)}).predict_image(counts)
```

It needs `config.json` and `{BEST}`. `t2twin translate`, `live`, `export`, `evaluate`, `report` and
`studio` need runs that predict counts.

| | type | unit | content |
|---|---|---|---|
| counts | ({info.x_mm.size},) numbers | counts | 0 to {info.full_scale_counts:,.0f}; taxel n is \
at `layout_x_mm[n]`, `layout_y_mm[n]` (mm) of `config.json`; or several, (B, {info.x_mm.size}) |
| image | ({size}, {size}) uint8 | grey levels | the DIGIT's image, 320 rows x 240 columns, \
resized to a square; of several, (B, {size}, {size}) |
"""


def _data(config: RunConfig, info: DatasetInfo) -> str:
    data = config.data
    pairs = {
        split: sum(info.shards[shard].pairs for shard in split_shards(info, split))
        for split in SPLITS
    }
    rows = [
        ("made by", _origin(info)),
        ("pairs", ", ".join(f"{count:,} {split}" for split, count in pairs.items())),
        ("SHA-256 of its info.json", f"`{data.sha256}`"),
        ("taxel layout", f"{data.layout}, {data.x_mm.size} taxels"),
        ("full scale", f"{data.full_scale_counts:,.0f} counts"),
    ]
    return "## Training data\n\n" + _table(("dataset", ""), rows)


def _origin(info: DatasetInfo) -> str:
    if not info.is_simulated:
        return "its owner, who imported the pairs"
    name = info.world_name
    return f"the paper's protocol, scale {name}" if info.is_protocol else f"the world {name}"


def _training(config: RunConfig, history: list[EpochRecord], best: EpochRecord) -> str:
    minutes = sum(record.seconds for record in history) / 60
    rows = [(field.name, _value(getattr(config.preset, field.name))) for field in fields(Preset)]
    rows += [
        ("direction", config.direction),
        *([] if config.steps is None else [("steps (argument)", _value(config.steps))]),
        ("planned epochs", _value(config.planned_epochs)),
        ("steps per epoch", _value(config.epoch_steps or "all of the data")),
        ("seed", _value(config.seed)),
        ("precision", "bf16" if config.bf16 else "fp32"),
        ("processes", _value(config.processes)),
    ]
    return f"""## Training

The weights are those of epoch {best.epoch} of {len(history)}, which has the lowest error on the
validation split: {_error(best)}
Training took {minutes:.1f} minutes.

{_table(("setting", "value"), rows)}
`translate/models/presets.py` describes the settings and their sources.
"""


def _error(best: EpochRecord) -> str:
    if best.val_rmse_grey is not None:
        return f"""\
an RMSE of {best.val_rmse_grey:.1f} grey levels of the image's pixels,
{best.val_rmse_percent:.2f} % of full scale, 255."""
    return f"""\
an RMSE of {best.val_rmse_counts:,.0f} counts, {best.val_rmse_percent:.2f} % of full scale. RMSE is
the root of the paper's L3, the squared error averaged over taxels and pairs."""


def _table(head: tuple[str, str], rows: list[tuple[str, str]]) -> str:
    lines = [head, ("---", "---"), *rows]
    return "".join(f"| {left} | {right} |\n" for left, right in lines)


def _value(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
