"""The dataset card, README.md, with all columns; also for the Hugging Face hub."""

from t2twin.sim.cyskin.layout import PAD_DIAMETER_MM
from t2twin.sim.dataset.info import DatasetInfo
from t2twin.sim.world.recipe import PAPER

COLUMNS = """\
| column | type | unit | what |
|---|---|---|---|
| shape | string | | a primitive (`square-2`) or a tool at a keypoint (`pliers/teeth`) |
| family | string | | primitive family, or tool |
| split | string | | `train`, `val` (version 3 of each primitive) or `test` (tools) |
| index | int32 | | number among the shape's presses |
| x_mm, y_mm | float64 | mm | position of the shape's origin: x right, y down in the image |
| yaw_rad | float64 | rad | rotation about the press axis, clockwise in the image |
| force_n | float64 | N | commanded force |
| image | PNG, 320 x 240 x 3 | grey levels | the DIGIT's image |
| taxels | list of uint16 | counts | the CySkin's counts; 40,000 is saturation |
| digit_depth_mm, cyskin_depth_mm | float64 | mm | depth from first contact |
| digit_force_n, cyskin_force_n | float64 | N | force carried by the contact pressure |
| digit_settled, cyskin_settled | bool | | whether the contact solver converged |
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
    """Lines of the table for the further columns of most worlds."""
    world = info.world
    if world is None or not world.has_more:
        return ""
    lines = ["| unit | int64 | | number of the DIGIT unit in its part of the recipe |"]
    if world.field:
        lines.append(
            f"| field | list of uint16 | counts | noiseless counts of {PAD_DIAMETER_MM:g} mm pads "
            f"at the {len(info.field_x_mm or ())} places in `info.json` |"
        )
    if world.untouched_frames:
        lines.append(
            "| untouched | PNG, 320 x 240 x 3 | grey levels | the unit's background frame, without "
            "contact |"
        )
    return "".join(f"{line}\n" for line in lines)


def _world(info: DatasetInfo) -> str:
    """README.md of a world other than the protocol."""
    assert info.world is not None
    pairs = info.pairs
    return f"""# t2twin, world {info.world.name}

Simulated pairs of two tactile sensors touching the same shape in the same place with the same
force: a DIGIT camera sensor's image and a CySkin capacitive array's counts. Shapes, positions,
forces and light are sampled by the recipe in `info.json`, under `world`; no hardware was used.

{pairs["train"]} training, {pairs["val"]} validation and {pairs["test"]} test pairs; seed
{info.seed}.

{COLUMNS}{_more_columns(info)}
`image` is rendered from the surface and `taxels` computed from the pressure of the simulated
contact in each sensor; depths, carried forces and flags are of these contacts. A pair is one press
of both sensors; a press of 0 N has no contact.

Made by t2twin {info.versions["t2twin"]} with MuJoCo {info.versions["mujoco"]}; `info.json` contains
all parameters. License: MIT.
"""


def _simulated(info: DatasetInfo) -> str:
    if not info.is_protocol:
        return _world(info)
    pairs = info.pairs
    return f"""# t2twin, scale {info.scale or PAPER}

Simulated pairs of two tactile sensors touching the same shape in the same place with the same
force: a DIGIT camera sensor's image and a CySkin capacitive array's counts. Protocol of Grella et
al., Touch-to-Touch Translation (IROS 2023); all data here are simulated, no hardware was used.

{pairs["train"]} training pairs, {pairs["val"]} validation pairs (versions of the primitives that
are not in the training set), {pairs["test"]} test pairs (hand tools). Seed {info.seed}.

{COLUMNS}
`x_mm` to `force_n` are the protocol's; `image` is rendered from the surface and `taxels` computed
from the pressure of the simulated contact in each sensor; depths, carried forces and flags are of
these contacts. A pair is one press of both sensors.

Made by t2twin {info.versions["t2twin"]} with MuJoCo {info.versions["mujoco"]}; `info.json` contains
all parameters. License: MIT.
"""


def _imported(info: DatasetInfo) -> str:
    pairs = info.pairs
    return f"""# Pairs imported with t2twin import-pairs

{pairs["train"]} training, {pairs["val"]} validation and {pairs["test"]} test pairs of a camera
sensor's image and the counts of {len(info.layout_x_mm)} taxels (layout {info.layout}, saturated at
{info.full_scale_counts:,}). The owner of the pairs states their origin and license. Columns without
data are empty.

{COLUMNS}"""
