"""The contact that a field run predicts from an image, and its files.

Shape letters: R rows and C columns of the image.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image
from torch.nn import functional

from t2twin.core.draw import relief
from t2twin.translate.models.field import CENTER, EVEN, MAPS
from t2twin.translate.uncertainty.estimate import with_std
from t2twin.translate.uncertainty.ood import OODClass

# Depth of one level of the PNG file with 16 bits, mm, and the level of depth 0: the gel is raised
# around a contact
PNG_MM, PNG_ZERO = 1e-3, 1000
EDGE_CELLS = 1  # Width of the edge of the view, cells of the network
EDGE_NOTE = "the contact reaches the edge of the view; force and depth may be of a part of it"
EMPTY_NOTE = "no contact was found; there is no center of pressure"

ARRAYS = (*MAPS, "mask")
VALUES = ("force_n", "force_std_n", *CENTER, "shear_n", "shear_std_n")


@dataclass(frozen=True)
class ContactEstimate:
    """The contact predicted from one image, on the camera's view. It has the image's size.

    Lengths, pressures and places are those of a unit with the view of the sensor's file. What is
    optional is None if the run was trained on presses of one force, or without shear force.
    """

    depth_mm: np.ndarray  # (R, C) float32 depth of the gel's surface, negative where it is raised
    depth_std_mm: np.ndarray  # (R, C) float32
    pressure_kpa: np.ndarray  # (R, C) float32, normal; 0 outside the mask, but for interpolation
    pressure_std_kpa: np.ndarray  # (R, C) float32
    probability: np.ndarray  # (R, C) float32, of contact
    mask: np.ndarray  # (R, C) bool, whether it is at least one half
    center_mm: (
        np.ndarray
    )  # (2,) center of pressure from the middle of the view; NaN without contact
    center_std_mm: np.ndarray  # (2,)
    view_mm: tuple[float, float]  # half the width and half the height of the view
    at_edge: bool  # whether the mask reaches the edge of the view
    ood_class: OODClass
    force_n: np.ndarray | None = None  # () of the whole press
    force_std_n: np.ndarray | None = None
    shear_n: np.ndarray | None = None  # (2,) shear force along x and y
    shear_std_n: np.ndarray | None = None

    def __repr__(self) -> str:
        return f"ContactEstimate({self.words})"

    @property
    def words(self) -> str:
        """Depth, area, force, shear force and notes in words."""
        parts = [f"depth {self.largest_depth_mm:.3g} mm, area {self.area_mm2:.3g} mm2"]
        for name, value, std in (
            ("force", self.force_n, self.force_std_n), ("shear", self.shear_n, self.shear_std_n),
        ):  # fmt: skip
            if value is not None and std is not None:
                parts.append(f"{name} {with_std(value, std)} N")
        return "; ".join([*parts, *self.notes])

    @property
    def is_empty(self) -> bool:
        """Whether no contact was found."""
        return not self.mask.any()

    @property
    def notes(self) -> tuple[str, ...]:
        """What limits the estimate, in words; empty for none."""
        is_ood = self.ood_class != OODClass.IN_DISTRIBUTION
        found = {
            f"out of distribution ({self.ood_class})": is_ood,
            EMPTY_NOTE: self.is_empty,
            EDGE_NOTE: self.at_edge,
        }
        return tuple(note for note, applies in found.items() if applies)

    @property
    def largest_depth_mm(self) -> float:
        """Largest depth in the contact, mm; 0 without contact."""
        return float(self.depth_mm[self.mask].max(initial=0.0))

    @property
    def area_mm2(self) -> float:
        """Area of the contact in the view, mm^2."""
        return float(self.mask.mean() * 4.0 * self.view_mm[0] * self.view_mm[1])

    @property
    def force_in_view_n(self) -> float:
        """Integral of the pressure over the view, N; `force_n` is that of the whole press."""
        return float(1e-3 * self.pressure_kpa.mean() * 4.0 * self.view_mm[0] * self.view_mm[1])

    def summary(self) -> dict[str, Any]:
        """The values that are not arrays of pixels, for JSON. Without contact it has no center, and
        what the run does not predict is None."""
        given = {name: getattr(self, name) for name in VALUES}
        values = {
            name: None if each is None else np.round(each.astype(float), 4).tolist()
            for name, each in given.items()
            if each is None or np.isfinite(each).all()
        }
        return values | {
            "largest_depth_mm": round(self.largest_depth_mm, 4),
            "area_mm2": round(self.area_mm2, 3),
            "force_in_view_n": round(self.force_in_view_n, 4),
            "at_edge": self.at_edge,
            "in_distribution": self.ood_class == OODClass.IN_DISTRIBUTION,
            "notes": list(self.notes),
        }

    def save(self, folder: Path, name: str = "contact") -> list[Path]:
        """Write NAME.npz, NAME.json, NAME_depth.png with 16 bits, and NAME_relief.png into an
        existing folder. Returns the paths."""
        arrays = {each: getattr(self, each) for each in ARRAYS}
        arrays |= {each: value for each in VALUES if (value := getattr(self, each)) is not None}
        paths = [folder / f"{name}{end}" for end in (".npz", ".json", "_depth.png", "_relief.png")]
        np.savez_compressed(paths[0], **arrays, view_mm=np.array(self.view_mm))
        scale = {"depth_png_mm_per_level": PNG_MM, "depth_png_level_of_zero": PNG_ZERO}
        content = json.dumps(self.summary() | scale, indent=1, allow_nan=False)
        paths[1].write_text(f"{content}\n", encoding="utf-8")
        levels = np.rint(self.depth_mm / PNG_MM) + PNG_ZERO
        Image.fromarray(levels.clip(0, 65_535).astype(np.uint16)).save(paths[2])
        self.relief().save(paths[3])
        return paths

    def relief(self) -> Image.Image:
        """The depth as a relief, see `relief`, with the largest depth and the force in words."""
        words = "no contact" if self.is_empty else f"{self.largest_depth_mm:.2f} mm deep"
        if self.force_n is not None and self.force_std_n is not None:
            words += f", {with_std(self.force_n, self.force_std_n)} N"
        return relief(self.depth_mm, self.mask, self.view_mm, words)


def contacts_of(
    outputs: dict[str, np.ndarray], sizes: Sequence[tuple[int, int]], view_mm: tuple[float, float],
    classes: Sequence[OODClass],
) -> list[ContactEstimate]:  # fmt: skip
    """The estimates of B images.

    outputs: predictions by the names of MAPS and VALUES. sizes: rows and columns of the images.
    """
    maps = torch.from_numpy(np.stack([outputs[name] for name in MAPS], axis=1))
    outermost = maps[:, -1].clone()
    outermost[:, EDGE_CELLS:-EDGE_CELLS, EDGE_CELLS:-EDGE_CELLS] = 0.0
    at_edge = (outermost.amax(dim=(1, 2)) > EVEN).tolist()
    estimates = []
    for number, size in enumerate(sizes):
        one = maps[number : number + 1]
        # With antialiasing it is Keys' filter of a = -0.5, which keeps slopes even (Keys 1981).
        depth = functional.interpolate(one[:, :1], size, mode="bicubic", antialias=True)[0]
        large = torch.cat([depth, functional.interpolate(one[:, 1:], size, mode="bilinear")[0]])
        estimates.append(
            ContactEstimate(
                *large.numpy(),
                mask=large[-1].numpy() > EVEN,
                view_mm=view_mm,
                at_edge=at_edge[number],
                ood_class=classes[number],
                **{name: outputs[name][number] for name in VALUES if name in outputs},
            )
        )
    return estimates
