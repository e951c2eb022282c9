"""Translate a folder of DIGIT images to counts, with their uncertainty, at any taxel layout.

python examples/translate_images.py --images frames --background background.png \\
    --layout cyskin-63 --out runs/translated

Without --images, the example simulates a few images first.
"""

import argparse
from pathlib import Path

import numpy as np
from PIL import Image

import t2twin


def simulate(folder: Path) -> Path:
    """Write three images and a background frame, and return the frame's path."""
    twin = t2twin.Twin()
    (folder / "frames").mkdir(parents=True, exist_ok=True)
    for number, shape in enumerate(("square-2", "wrench/ring", "hemisphere-3")):
        touch = twin.press(shape, force_n=3 + 2 * number, seed=number)
        Image.fromarray(touch.image).save(folder / f"frames/{number}.png")
    Image.fromarray(twin.background).save(folder / "background.png")
    return folder / "background.png"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--images", type=Path, help="folder of PNG or JPEG files")
    parser.add_argument("--background", type=Path, help="image of the same DIGIT without contact")
    parser.add_argument("--layout", default="cyskin-63", help="name or file of a layout")
    parser.add_argument("--out", type=Path, default=Path("runs/translated"))
    arguments = parser.parse_args()
    images, background = arguments.images, arguments.background
    if images is None:
        background = simulate(arguments.out.parent / "simulated")
        images = background.parent / "frames"

    run = t2twin.load("field", layout=arguments.layout)
    frame = None if background is None else np.asarray(Image.open(background).convert("RGB"))
    for path in sorted(images.iterdir()):
        image = np.asarray(Image.open(path).convert("RGB"))
        estimate = run.estimate(image, frame)
        low, high = estimate.interval(0.9)
        strongest = int(estimate.counts.argmax())
        print(
            f"{path.name}: {estimate.force_n:.1f} N; taxel {strongest} has "
            f"{estimate.counts[strongest]:.0f} counts, 90 % interval {low[strongest]:.0f} to "
            f"{high[strongest]:.0f}"
        )
    paths = sorted(images.iterdir())
    t2twin.translate_images(paths, arguments.out, layout=arguments.layout, background=background)
