"""Slide a ball over both sensors with friction, and plot the tangential force.

python examples/slide.py --friction 0.6 --out runs/slide.png

The force first rises while the ball sticks. It stays at friction times normal force after the ball
slips as a whole.
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import t2twin


def slide(friction: float, distance_mm: float, steps: int, out: Path) -> None:
    twin = t2twin.Twin(markers=True)
    start = twin.press("hemisphere-4", force_n=4, x_mm=-distance_mm / 2)
    touches = twin.slide(start, dx_mm=distance_mm, steps=steps, friction=friction)
    last = touches[-1]
    moved_mm = np.linalg.norm(last.markers_mm - start.markers_mm, axis=1)
    print(f"largest motion of a marker: {moved_mm.max():.2f} mm")

    figure, (force, image) = plt.subplots(1, 2, figsize=(9, 4), constrained_layout=True)
    path_mm = np.linspace(0, distance_mm, steps + 1)
    for sensor in start.contacts:
        contacts = [touch.contacts[sensor] for touch in [start, *touches]]
        shear_n = [float(np.hypot(*contact.shear_n)) for contact in contacts]
        force.plot(path_mm, shear_n, marker=".", label=sensor)
        print(f"{sensor}: {shear_n[-1]:.2f} N, {contacts[-1].slip_share:.0%} of the contact slips")
    force.axhline(friction * 4, color="grey", linestyle=":", label="friction times normal force")
    force.set(xlabel="displacement, mm", ylabel="tangential force, N")
    force.legend()
    image.imshow(last.image)
    image.axis("off")
    image.set_title("DIGIT after the slide")

    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out, dpi=100)
    print(f"wrote {out}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--friction", type=float, default=0.6)
    parser.add_argument("--distance-mm", type=float, default=2.0)
    parser.add_argument("--steps", type=int, default=20)
    parser.add_argument("--out", type=Path, default=Path("runs/slide.png"))
    arguments = parser.parse_args()
    slide(arguments.friction, arguments.distance_mm, arguments.steps, arguments.out)
