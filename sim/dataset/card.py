"""The dataset card: what each column is, for people and for the Hugging Face hub."""

from t2twin.sim.cyskin.layout import PAD_DIAMETER_MM
from t2twin.sim.dataset.info import DatasetInfo
from t2twin.sim.world.recipe import PAPER

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


HEAD = """---
license: {license}
task_categories: [image-to-image, tabular-regression]
tags: [tactile, digit, cyskin{tag}]
configs:
- config_name: default
  data_files:
  - {{split: train, path: "train/*.parquet"}}
  - {{split: validation, path: "val/*.parquet"}}
  - {{split: test, path: "test/*.parquet"}}
---
"""


def card(info: DatasetInfo) -> str:
    """README.md of a dataset."""
    if info.is_simulated:
        return HEAD.format(license="mit", tag=", simulation") + _simulated(info)
    return HEAD.format(license="unknown", tag="") + _imported(info)


def _more_columns(info: DatasetInfo) -> str:
    """Lines of the table for what the pairs of most worlds hold besides."""
    world = info.world
    if world is None or not world.has_more:
        return ""
    lines = ["| unit | int64 | | which DIGIT took the picture, counted in its part of the recipe |"]
    if world.field:
        lines.append(
            f"| field | list of uint16 | counts | what a pad of {PAD_DIAMETER_MM:g} mm would "
            f"count, without noise, at the {len(info.field_x_mm or ())} places in `info.json` |"
        )
    if world.untouched_frames:
        lines.append(
            "| untouched | PNG, 320 x 240 x 3 | grey levels | that DIGIT's picture while nothing "
            "touches it |"
        )
    return "".join(f"{line}\n" for line in lines)


def _world(info: DatasetInfo) -> str:
    """README.md of another world than the protocol's."""
    assert info.world is not None
    pairs = info.pairs
    return f"""# t2twin, world {info.world.name}

Simulated pairs of two tactile sensors touching the same shape in the same place with the same
force: a DIGIT camera sensor's picture and a CySkin capacitive array's counts. Shapes, places,
forces and light are drawn as the recipe in `info.json` says, under `world`; no hardware was used.

{pairs["train"]} training, {pairs["val"]} validation and {pairs["test"]} test pairs; seed
{info.seed}.

{COLUMNS}{_more_columns(info)}
`image` is rendered from the surface and `taxels` computed from the pressure that the simulated
contact leaves in each sensor; depths, carried forces and flags are that contact's own. A pair is
one press, taken by both sensors; one of 0 N touches nothing.

Made by t2twin {info.versions["t2twin"]} with MuJoCo {info.versions["mujoco"]}; all parameters
stand in `info.json`. License: MIT.
"""


def _simulated(info: DatasetInfo) -> str:
    if not info.is_protocol:
        return _world(info)
    pairs = info.pairs
    return f"""# t2twin, scale {info.scale or PAPER}

Simulated pairs of two tactile sensors touching the same shape in the same place with the same
force: a DIGIT camera sensor's picture and a CySkin capacitive array's counts. Protocol of Grella et
al., Touch-to-Touch Translation (IROS 2023); all data here are simulated, no hardware was used.

{pairs["train"]} training pairs, {pairs["val"]} validation pairs (versions of the primitives that
training never saw), {pairs["test"]} test pairs (hand tools). Seed {info.seed}.

{COLUMNS}
Where they come from: `x_mm` to `force_n` are the protocol's; `image` is rendered from the surface
and `taxels` computed from the pressure that the simulated contact leaves in each sensor; depths,
carried forces and flags are that contact's own. A pair is one press, taken by both sensors.

Made by t2twin {info.versions["t2twin"]} with MuJoCo {info.versions["mujoco"]}; all parameters
stand in `info.json`. License: MIT.
"""


def _imported(info: DatasetInfo) -> str:
    pairs = info.pairs
    return f"""# Pairs brought in with t2twin import-pairs

{pairs["train"]} training, {pairs["val"]} validation and {pairs["test"]} test pairs of a camera
sensor's picture and the counts of {len(info.layout_x_mm)} taxels (layout {info.layout},
saturated at {info.full_scale_counts:,}). They are the owner's; where they come from and under
which license they may be used is for the owner to say. Columns that the owner did not have are
empty.

{COLUMNS}"""
