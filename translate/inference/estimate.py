"""Predictions of a run for images: counts with their uncertainty, and the contact.

Shape letters: B images of R rows and C columns, N taxels, F places of the dense counts.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from pathlib import Path
from statistics import NormalDist
from typing import Any

import numpy as np
import torch
from PIL import Image
from torch.nn import functional

from t2twin.core import arguments
from t2twin.core.draw import relief
from t2twin.core.errors import T2TwinError, counted, warn
from t2twin.core.files import result_folder
from t2twin.sim.taxels.reading import expected_reading
from t2twin.sim.taxels.spec import CountsTable, Imperfections
from t2twin.sim.taxels.taxel_array import TaxelArray
from t2twin.translate.models.field import CENTER, EVEN, MAPS
from t2twin.translate.uncertainty.ood import OODClass

# Depth of one level of the PNG file with 16 bits, mm, and the level of depth 0: the gel is raised
# around a contact
PNG_MM, PNG_ZERO = 1e-3, 1000
EDGE_NOTE = "the contact reaches the edge of the view; force and depth may be of a part of it"
EMPTY_NOTE = "no contact was found; there is no center of pressure"
DISAGREE_NOTE = "counts and contact disagree in place or force; do not rely on either"

ENDS = (".npz", ".json", "_depth.png", "_relief.png")  # of the files of a contact
ARRAYS = (*MAPS, "mask")
DIFFERENCES = ("counts_off_mm", "counts_force_ratio")
NUMBERS = ("force_n", "force_std_n", *CENTER, "shear_n", "shear_std_n", *DIFFERENCES)


@dataclass(frozen=True, eq=False)
class Estimate:
    """The prediction for one image, or for B images with B before every shape.

    Counts and standard deviations are of the noiseless array. What a run does not predict is None.
    """

    full_scale_counts: float  # where taxels saturate
    counts: np.ndarray  # (N,) float32
    counts_std: Any = None  # (N,) float32, their standard deviations
    dense_counts: Any = None  # (F,) float32, at the places of the dense counts
    dense_counts_std: Any = None
    force_n: Any = None  # () float32, N, unless the run was trained on presses of one force
    force_std_n: Any = None
    shear_n: Any = None  # (2,) float32, N, shear force on the gel camera along x and y
    shear_std_n: Any = None
    tactile_images: Any = None  # (R, C) float32, counts
    tactile_std: Any = None
    ood_class: Any = None  # the OODClass, of B images (B,) objects
    contact: Any = None  # the ContactEstimate, of B images a list of them
    array: TaxelArray | None = None  # as in datasets, with its imperfections

    def __repr__(self) -> str:
        parts = [f"counts {self.counts.shape}"]
        if self.dense_counts is not None:
            parts.append(f"dense_counts {self.dense_counts.shape}")
        parts += forces_in_words(self) if self.counts.ndim == 1 else []
        classes = [] if self.ood_class is None else np.atleast_1d(self.ood_class)
        found = dict.fromkeys(map(str, classes))  # each once
        parts += [name for name in found if name != OODClass.IN_DISTRIBUTION]
        return f"Estimate({', '.join(parts)})"

    def interval(self, level: float = 0.9, reading: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper ends of the central intervals of the counts, clipped to full scale.

        level: probability, between 0 and 1. reading: whether of a reading of the array, with its
        counts at rest and its noise. Raises T2TwinError for a reading of an unknown noise.
        """
        if self.counts_std is None:
            raise T2TwinError("the run predicts no uncertainty; an interval needs a field run")
        if arguments.flag(reading, "reading"):
            if self.array is None:
                raise T2TwinError(
                    "the noise of this run's array is unknown; reading=True needs a run on a "
                    "sensor of a file that this machine has"
                )
            return self.of_readings(self.array.flaws, self.array.spec.counts).interval(level)
        half = half_width(level) * self.counts_std
        low, high = self.counts - half, self.counts + half
        return low.clip(0.0, self.full_scale_counts), high.clip(0.0, self.full_scale_counts)

    def of_readings(self, flaws: Imperfections, table: CountsTable) -> "Estimate":
        """The same with the expected readings of an array, which have its counts at rest, and
        their standard deviations."""
        mean, noise = expected_reading(flaws, table, self.counts)
        std = np.hypot(self.counts_std, noise)
        return replace(self, counts=mean.astype(np.float32), counts_std=std.astype(np.float32))

    def first(self) -> "Estimate":
        """The estimate of the first image alone."""
        found = {name: getattr(self, name) for name in OF_IMAGES}
        return replace(self, **{n: each[0] for n, each in found.items() if each is not None})


# Names of what an estimate has of each image, and of what a network predicts directly
OF_IMAGES = tuple(f.name for f in fields(Estimate) if f.name not in ("full_scale_counts", "array"))
VALUES = tuple(name for name in OF_IMAGES if name not in ("ood_class", "contact"))


def concatenate(parts: Sequence[Estimate]) -> Estimate:
    """Concatenates one or more estimates of several images, which have no contact."""
    found = {name: [getattr(part, name) for part in parts] for name in (*VALUES, "ood_class")}
    return replace(
        parts[0], **{n: np.concatenate(each) for n, each in found.items() if each[0] is not None}
    )


def with_std(value: np.ndarray, std: np.ndarray) -> str:
    """Values and their standard deviations in words."""
    pairs = zip(np.atleast_1d(value), np.atleast_1d(std), strict=True)
    return ", ".join(f"{each:.3g} ± {spread:.2g}" for each, spread in pairs)


def forces_in_words(one: Any) -> list[str]:
    """Force and shear force of an estimate of one image, with their standard deviations."""
    forces = (("force", one.force_n, one.force_std_n), ("shear", one.shear_n, one.shear_std_n))
    return [f"{name} {with_std(*both)} N" for name, *both in forces if both[0] is not None]


def half_width(level: float) -> float:
    """Half the width of a Gaussian's central interval, standard deviations."""
    level = arguments.real(level, "level")
    if not 0.0 < level < 1.0:
        raise T2TwinError(f"level is {level:g}; it must lie between 0 and 1")
    return NormalDist().inv_cdf(0.5 + level / 2)


@dataclass(frozen=True, eq=False)
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
    center_mm: np.ndarray  # (2,) of pressure, from the middle of the view; NaN without contact
    center_std_mm: np.ndarray  # (2,)
    view_mm: tuple[float, float]  # half the width and half the height of the view
    at_edge: bool  # whether the mask reaches the edge of the view
    ood_class: OODClass
    force_n: np.ndarray | None = None  # () of the whole press
    force_std_n: np.ndarray | None = None
    shear_n: np.ndarray | None = None  # (2,) shear force along x and y
    shear_std_n: np.ndarray | None = None
    # () distance of the center of the dense counts in the view from the center of pressure, mm
    counts_off_mm: np.ndarray | None = None
    counts_force_ratio: np.ndarray | None = None  # () force of the dense counts over force_n
    agrees: bool = True  # whether both are in the ranges of the run's validation, if it has them

    def __repr__(self) -> str:
        return f"ContactEstimate({self.words})"

    @property
    def words(self) -> str:
        """Depth, area, force, shear force and notes in words."""
        part = f"depth {self.largest_depth_mm:.3g} mm, area {self.area_mm2:.3g} mm2"
        return "; ".join([part, *forces_in_words(self), *self.notes])

    @property
    def is_empty(self) -> bool:
        """Whether no contact was found."""
        return not self.mask.any()

    @property
    def notes(self) -> tuple[str, ...]:
        """What limits the estimate, in words; empty for none."""
        is_ood = self.ood_class.inside is False
        found = {
            f"out of distribution ({self.ood_class})": is_ood,
            EMPTY_NOTE: self.is_empty,
            EDGE_NOTE: self.at_edge,
            DISAGREE_NOTE: not self.agrees,
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
        given = {name: getattr(self, name) for name in NUMBERS}
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
            **self.ood_class.entry,
            "notes": list(self.notes),
        }

    def save(self, folder: str | Path, name: str = "contact") -> list[Path]:
        """Write NAME.npz, NAME.json, NAME_depth.png with 16 bits, and NAME_relief.png. Returns the
        paths. Raises T2TwinError where another's file has one of the names."""
        folder = arguments.path(folder, "folder")
        with result_folder(folder, f"contact {name}") as temporary:
            return [folder / path.name for path in self.write(temporary, name)]

    def write(
        self, folder: Path, name: str, png: bool = True, image: Path | None = None
    ) -> list[Path]:
        """The files of `save`, in a new folder; png: all of them. image: which NAME.json names."""
        arrays = {each: getattr(self, each) for each in ARRAYS}
        arrays |= {each: value for each in NUMBERS if (value := getattr(self, each)) is not None}
        paths = [folder / f"{name}{end}" for end in ENDS]
        np.savez_compressed(paths[0], **arrays, view_mm=np.array(self.view_mm))
        scale = {"depth_png_mm_per_level": PNG_MM, "depth_png_level_of_zero": PNG_ZERO}
        head = {} if image is None else {"image": str(image)}
        content = json.dumps(head | self.summary() | scale, indent=1, allow_nan=False)
        paths[1].write_text(f"{content}\n", encoding="utf-8")
        if not png:
            return paths[:2]
        levels = np.rint(self.depth_mm / PNG_MM) + PNG_ZERO
        Image.fromarray(levels.clip(0, 65_535).astype(np.uint16)).save(paths[2])
        words = "no contact" if self.is_empty else f"{self.largest_depth_mm:.2f} mm deep"
        if self.force_n is not None and self.force_std_n is not None:
            words += f", {with_std(self.force_n, self.force_std_n)} N"
        relief(self.depth_mm, self.mask, self.view_mm, words).save(paths[3])
        return paths


@lru_cache
def _resizing(cells: int, size: int) -> torch.Tensor:
    """(planes, size, cells): weights of the cells of a line, of the depth bicubic."""
    one = torch.eye(cells)[None, None]
    # With antialiasing it is Keys' filter of a = -0.5, which keeps slopes even (Keys 1981).
    depth = functional.interpolate(one, (size, cells), mode="bicubic", antialias=True)[0]
    others = functional.interpolate(one, (size, cells), mode="bilinear")[0]
    return torch.cat([depth, others.expand(len(MAPS) - 1, -1, -1)])


def contacts_of(
    outputs: dict[str, np.ndarray], sizes: Sequence[tuple[int, int]], view_mm: tuple[float, float],
    classes: Sequence[OODClass],
) -> list[ContactEstimate]:  # fmt: skip
    """The estimates of B images. outputs: by name. sizes: rows and columns of the images."""
    maps = torch.from_numpy(np.stack([outputs[name] for name in MAPS], axis=1))
    outermost = maps[:, -1].clone()
    outermost[:, 1:-1, 1:-1] = 0.0  # the edge of the view is one cell wide
    at_edge = (outermost.amax(dim=(1, 2)) > EVEN).tolist()
    estimates = []
    for number, size in enumerate(sizes):
        down, across = (_resizing(maps.shape[-1], length) for length in size)
        large = down @ (maps[number] @ across.mT)  # twice as fast as interpolations
        estimates.append(
            ContactEstimate(
                *large.numpy(),
                mask=large[-1].numpy() > EVEN,
                view_mm=view_mm,
                at_edge=at_edge[number],
                ood_class=classes[number],
                **{n: outputs[n][number] for n in (*NUMBERS, "agrees") if n in outputs},
            )
        )
    return estimates


def warn_of_contacts(contacts: Sequence[ContactEstimate], names: Sequence[object] = ()) -> None:
    """Warns of each note of the contacts, once, with the number of images and the first's name."""
    for note in dict.fromkeys(note for each in contacts for note in each.notes):
        noted = [number for number, each in enumerate(contacts) if note in each.notes]
        example = f", such as {names[noted[0]]}" if names else ""
        part = f"{len(noted)} of {counted(len(contacts), 'image')}{example}"
        warn(f"{part}: {note}")
