"""Press a shape into both sensors, and plot what each of them measures.

python examples/press_and_plot.py --shape pliers/teeth --out runs/press.png
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt

import t2twin


def plot(shape: str, force_n: float, out: Path) -> None:
    twin = t2twin.Twin()
    touch = twin.press(shape, force_n=force_n, seed=0)
    contact = touch.digit
    print(f"{contact.force_n:.2f} N press {shape} {contact.depth_mm:.2f} mm into the gel")
    print(f"the contact has {contact.contact_area_mm2:.1f} mm2; the counts are {touch.counts}")

    figure, axes = plt.subplots(1, 4, figsize=(12, 4.2), constrained_layout=True)
    extent = (contact.x_mm[0], contact.x_mm[-1], contact.y_mm[-1], contact.y_mm[0])
    axes[0].imshow(touch.image)
    axes[0].axis("off")
    axes[0].set_title("DIGIT: image")
    shown = axes[1].imshow(contact.pressure_kpa, extent=extent, cmap="magma")
    axes[1].set_title("DIGIT: pressure, kPa")
    figure.colorbar(shown, ax=axes[1])
    shown = axes[2].imshow(contact.surface_mm, extent=extent, cmap="viridis")
    axes[2].set_title("DIGIT: deflection, mm")
    figure.colorbar(shown, ax=axes[2])
    layout = touch.layout
    shown = axes[3].scatter(layout.x_mm, layout.y_mm, 300, touch.counts, cmap="viridis")
    axes[3].set(title="CySkin: counts", aspect="equal")
    axes[3].invert_yaxis()  # y points down, as in the image
    figure.colorbar(shown, ax=axes[3])

    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out, dpi=100)
    print(f"wrote {out}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--shape", default="pliers/teeth", help="name or file of a shape")
    parser.add_argument("--force-n", type=float, default=8.0)
    parser.add_argument("--out", type=Path, default=Path("runs/press.png"))
    arguments = parser.parse_args()
    plot(arguments.shape, arguments.force_n, arguments.out)
