"""Make a dataset of presses of your own shapes, STL files with their pressing side up.

python examples/own_shape_dataset.py --shapes my_shapes --out data/mine

Without --shapes, the example writes an STL file of its own: a block with a groove.
"""

import argparse
from pathlib import Path

import cadquery as cq

import t2twin

RECIPE = """
name = "mine"
dense_counts = true             # needed to train a field network
background_frames = true  # background frame of each sensor

[[parts]]
shapes = "{shapes}"
presses = {presses}
place = {{ uniform_mm = 3.0 }}
force_n = {{ low = 0.5, high = 12.0 }}
val_share = 0.2

[light]
kind = "drawn"           # another lighting for each shape
"""


def write_block(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    plate = cq.Workplane().box(16, 16, 2)
    for groove_mm in (1.0, 2.0, 3.0):
        block = cq.Workplane().box(8, 8, 2).translate((0, 0, 2))
        groove = cq.Workplane().box(groove_mm, 8, 1).translate((0, 0, 2.5))
        solid = plate.union(block.cut(groove))
        cq.exporters.export(solid, str(folder / f"groove-{groove_mm:g}.stl"))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--shapes", type=Path, help="folder of STL, STEP, OBJ, PLY, 3MF or GLB")
    parser.add_argument("--presses", type=int, default=200, help="of each shape")
    parser.add_argument("--out", type=Path, default=Path("data/mine"))
    arguments = parser.parse_args()
    shapes = arguments.shapes or arguments.out.parent / "grooves"
    if arguments.shapes is None:
        write_block(shapes)
    recipe = arguments.out.parent / f"{arguments.out.name}.toml"
    recipe.write_text(RECIPE.format(shapes=shapes.as_posix(), presses=arguments.presses))
    t2twin.make_dataset(arguments.out, recipe=recipe)
    print(f"faults: {t2twin.verify_dataset(arguments.out)}")
