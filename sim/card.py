"""The dataset card: what each column is, for people and for the Hugging Face hub."""

from typing import Any

COLUMNS = """\
| column | type | unit | what |
|---|---|---|---|
| shape | string | | a primitive (`square-2`) or a tool at a keypoint (`pliers/teeth`) |
| family | string | | primitive family, or tool |
| split | string | | `train`, `val` (version 3 of each primitive) or `test` (tools) |
| index | int32 | | place in the shape's full list of presses |
| x_mm, y_mm | float64 | mm | where the shape's origin stands: x right, y down in the picture |
| yaw_rad | float64 | rad | turn about the press axis, clockwise in the picture |
| force_n | float64 | N | commanded force |
| image | PNG, 320 x 240 x 3 | grey levels | what the DIGIT saw |
| taxels | list of uint16 | counts | what the CySkin counted; 40,000 is saturation |
| digit_depth_mm, cyskin_depth_mm | float64 | mm | how far the shape went in after its first touch |
| digit_force_n, cyskin_force_n | float64 | N | force that the contact pressure really carries |
| digit_settled, cyskin_settled | bool | | whether the press had come to rest |
| digit_bottomed, cyskin_bottomed | bool | | whether the shape's base plate touched |
"""


def card(info: dict[str, Any]) -> str:
    """README.md of a dataset."""
    pairs = info["pairs"]
    return f"""---
license: mit
task_categories: [image-to-image, tabular-regression]
tags: [tactile, digit, cyskin, simulation]
configs:
- config_name: default
  data_files:
  - {{split: train, path: "train/*.parquet"}}
  - {{split: validation, path: "val/*.parquet"}}
  - {{split: test, path: "test/*.parquet"}}
---
# t2twin, scale {info["scale"]}

Simulated pairs of two tactile sensors touching the same shape in the same place with the same
force: a DIGIT camera sensor's picture and a CySkin capacitive array's counts. Protocol of Grella et
al., Touch-to-Touch Translation (IROS 2023); all data here are simulated, no hardware was used.

{pairs["train"]} training pairs, {pairs["val"]} validation pairs (versions of the primitives that
training never saw), {pairs["test"]} test pairs (hand tools). Seed {info["seed"]}.

{COLUMNS}
Made by t2twin {info["versions"]["t2twin"]} with MuJoCo {info["versions"]["mujoco"]}; all parameters
stand in `info.json`. Licence: MIT.
"""
