"""What the model card of a run from the CySkin to the DIGIT says of its own."""

import json

from t2twin.sim.dataset.info import DatasetInfo
from t2twin.translate.runs.config import BEST, RunConfig
from t2twin.translate.runs.log import EpochRecord

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
