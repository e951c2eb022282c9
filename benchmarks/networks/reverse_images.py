"""docs/pictures/reverse.png: counts, the real image, the predicted image and the baselines."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from benchmarks import ROOT
from t2twin.report.figures import draw_tactile_image, figure
from t2twin.translate.data.pairs import DataInfo, Pairs

PICTURE = ROOT / "docs" / "pictures" / "reverse.png"

QUANTILES = (0.9, 0.5, 0.1)
"""Of the predicted images, by PSNR over the contact: which samples of each split are shown."""

TITLES = {
    "network": "predicted from\nthe counts",
    "nearest_neighbor": "nearest counts\nof the training",
    "mean_image": "mean image\nof the training",
}
SPLITS = {"val": "validation", "test": "hand tool"}

WIDTH_IN, ROW_IN = 6.6, 1.6

GREYS = (40, 180)
"""Grey levels that are black and white, in all images alike (assumed: those that images
of the default light have)."""


@dataclass(frozen=True)
class Split:
    """name: "val" or "test". real: (P, S, S) uint8. rows: the same by name. psnr_db: (P,) of each
    row's pictures over the contact, NaN where there is none."""

    name: str
    pairs: Pairs
    real: np.ndarray
    rows: Mapping[str, np.ndarray]
    psnr_db: Mapping[str, np.ndarray]


def draw(splits: Sequence[Split], info: DataInfo) -> bytes:
    """The picture as PNG, a row a sample: those at QUANTILES of each split, the best first."""
    samples = [(split, place) for split in splits for place in _chosen(split)]
    height_in = ROW_IN * len(samples) + 0.5
    return figure("png", WIDTH_IN, height_in, lambda page: _draw(page, samples, info))


def _chosen(split: Split) -> list[int]:
    psnr_db = split.psnr_db["network"]
    known = np.flatnonzero(~np.isnan(psnr_db))
    order = known[np.argsort(psnr_db[known], kind="stable")]
    return [int(order[round(quantile * (order.size - 1))]) for quantile in QUANTILES]


def _draw(page: Figure, samples: Sequence[tuple[Split, int]], info: DataInfo) -> None:
    array, camera = info.array, info.camera
    phi, aspect = array.phi, 1.0 / camera.aspect
    tactile_width = aspect * phi.shape[1] / phi.shape[0]
    widths = (tactile_width, 1.0, 1.0, 1.0, 1.0)
    all_axes = page.subplots(len(samples), len(widths), squeeze=False, width_ratios=widths)
    for axes, (split, place) in zip(all_axes, samples, strict=True):
        pairs = split.pairs
        counts = phi(pairs.counts[place])
        draw_tactile_image(axes[0], counts, phi, array.taxels, (0.0, float(counts.max())))
        _view(axes[0], camera.view_mm)
        axes[0].set_ylabel(f"{pairs.shapes[place]}\n{SPLITS[split.name]}")
        _picture(axes[1], split.real[place], aspect)
        for each, name in zip(axes[2:], TITLES, strict=True):
            _picture(each, split.rows[name][place], aspect)
            each.text(
                0.04, 0.97, f"{split.psnr_db[name][place]:.1f} dB", color="white",
                transform=each.transAxes, va="top", fontsize=7,
            )  # fmt: skip
    titles = ("what the CySkin\ncounted", "what the DIGIT\nsaw", *TITLES.values())
    for axes, title in zip(all_axes[0], titles, strict=True):
        axes.set_title(title)


def _view(axes: Axes, view_mm: tuple[float, float]) -> None:
    """Marks what of the tactile image the DIGIT sees. view_mm: half of it along x and y."""
    half_width, half_height = view_mm
    corner, size = (-half_width, -half_height), (2 * half_width, 2 * half_height)
    axes.add_patch(Rectangle(corner, *size, fill=False, color="white", linewidth=0.7, ls="--"))


def _picture(axes: Axes, picture: np.ndarray, aspect: float) -> None:
    """A grey picture, (S, S) uint8, in a thin frame. aspect: its height over its width."""
    axes.imshow(picture, cmap="gray", vmin=GREYS[0], vmax=GREYS[1], aspect=aspect)
    axes.set(xticks=[], yticks=[])
    for spine in axes.spines.values():
        spine.set(visible=True, linewidth=0.4, color="#aaaaaa")
