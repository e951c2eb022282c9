"""A trained run at work: images in, counts and tactile images out.

Shape letters: B images, R rows, C columns, N taxels, S the run's image side.
"""

import csv
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from PIL import Image
from torch.nn import functional
from tqdm import tqdm

from primitives_cad.errors import T2TwinError
from primitives_cad.writing import whole_file
from translate import distributed
from translate.checkpoint import load_weights
from translate.data import ImageFile
from translate.files import write_json
from translate.images import open_image, to_input, to_pixels
from translate.phi import TACTILE_SHAPE, Phi
from translate.picture import tactile_picture
from translate.resnet18 import Regression
from translate.run import BEST, Config, build, has_bf16, load_config
from translate.touch2touch import Touch2Touch

AT_ONCE = 64
"""Images in one batch; bounds memory."""


@dataclass(frozen=True)
class Run:
    """A trained translator with its best weights; `load_run` makes one."""

    run_dir: Path
    config: Config
    translator: Touch2Touch | Regression

    @cached_property
    def phi(self) -> Phi:
        """phi of the run's layout at the tactile image's full size."""
        return Phi(self.config.data.x_mm, self.config.data.y_mm)

    def predict(self, images: np.ndarray | Sequence[np.ndarray]) -> np.ndarray:
        """Counts of DIGIT images. images: (B, h, w, 3) or (B, h, w) uint8, any h and w.

        Returns (B, N) float32, within nought and full scale.
        """
        return self.predict_pixels(self._pixels(images))

    def predict_pixels(
        self, pixels: np.ndarray | ImageFile, progress: str | None = None
    ) -> np.ndarray:
        """The same for images already at the run's size and colour, (B, S, S, c) uint8.

        progress: a name to show a bar under, or None.
        """
        counts = [np.empty((0, self.config.data.x_mm.size), np.float32)]
        for part in _parts(len(pixels), progress):
            inputs = to_input(pixels[part].astype(np.float32) / 255.0)
            counts.append(self.translator.predict(inputs).cpu().numpy())
        return np.concatenate(counts)

    def tactile_images(self, images: np.ndarray | Sequence[np.ndarray]) -> np.ndarray:
        """Tactile images of DIGIT images, given as for `predict`: (B, R, C) float32, counts.

        touch2touch's are what its generator drew, resized; ResNet18's are phi of its counts.
        """
        return self._counts_and_tactile_images(self._pixels(images))[1]

    def _counts_and_tactile_images(self, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        inputs = to_input(pixels.astype(np.float32) / 255.0)
        if isinstance(self.translator, Touch2Touch):
            drawn = self.translator.draw(inputs)
            counts = self.translator.counts_of(drawn)
            large = functional.interpolate(drawn, TACTILE_SHAPE, mode="bilinear", antialias=True)
            return counts.cpu().numpy(), large[:, 0].clamp(min=0.0).cpu().numpy()
        counts = self.translator.predict(inputs).cpu().numpy()
        return counts, self.phi(counts)

    def _pixels(self, images: np.ndarray | Sequence[np.ndarray]) -> np.ndarray:
        """(B, S, S, c) uint8. Raises T2TwinError for arrays that are no 8-bit images."""
        preset = self.config.preset
        pixels = [np.empty((0, preset.size, preset.size, 1 if preset.grey else 3), np.uint8)]
        for image in images:
            of_images = image.ndim == 2 or (image.ndim == 3 and image.shape[2] == 3)
            if image.dtype != np.uint8 or not of_images:
                raise T2TwinError(
                    f"an image has shape {image.shape} and type {image.dtype}; it must be "
                    "(h, w, 3) or (h, w) of uint8"
                )
            pixels.append(to_pixels(Image.fromarray(image), preset.size, preset.grey)[None])
        return np.concatenate(pixels)


def load_run(run_dir: Path) -> Run:
    """A run's best weights, ready to predict. Raises T2TwinError where the folder holds none."""
    config = load_config(run_dir)
    distributed.use_all_cores()
    translator = build(config)
    translator.bf16 = config.preset.bf16 and has_bf16()
    load_weights(run_dir / BEST, translator.predictor)
    translator.predictor.eval()
    return Run(run_dir, config, translator)


def translate_images(run_dir: Path, image_paths: Sequence[Path], out_dir: Path) -> np.ndarray:
    """Translates image files; writes counts.csv, counts.json and one tactile image each.

    image_paths: PNG or JPEG, any size, grey, colour or 16-bit; upright as the DIGIT gives them,
    rows along the sensor's length. Tactile images are named by their inputs, `press.png` for
    `press.jpg`; of two inputs with one name the second gets `press-2.png`.
    Returns the counts, (B, N) float32.
    Raises T2TwinError, before anything is written, for an empty list, a file that is missing or
    is no image, and a folder that is no run.
    """
    if not image_paths:
        raise T2TwinError("there is no image to translate; give at least one PNG or JPEG file")
    for path in image_paths:
        open_image(path)
    run = load_run(run_dir)
    preset, info = run.config.preset, run.config.data
    names = _output_names(image_paths)
    counts = np.empty((len(image_paths), info.x_mm.size), np.float32)
    out_dir.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".translate-", dir=out_dir) as folder:
        for part in _parts(len(image_paths), "translating" if len(image_paths) > 1 else None):
            pixels = np.stack(
                [to_pixels(open_image(p), preset.size, preset.grey) for p in image_paths[part]]
            )
            counts[part], tactile = run._counts_and_tactile_images(pixels)
            for name, image in zip(names[part], tactile, strict=True):
                picture = tactile_picture(image, info.x_mm, info.y_mm, info.full_scale_counts)
                picture.save(Path(folder) / name)
        for name in names:
            (Path(folder) / name).replace(out_dir / name)
    _write_counts(out_dir, run, image_paths, names, counts)
    return counts


def _write_counts(
    out_dir: Path, run: Run, image_paths: Sequence[Path], names: list[str], counts: np.ndarray
) -> None:
    rounded = np.rint(counts).astype(int)
    with whole_file(out_dir / "counts.csv") as temporary, temporary.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["image", *(f"taxel_{n}" for n in range(counts.shape[1]))])
        for path, row in zip(image_paths, rounded, strict=True):
            writer.writerow([str(path), *row.tolist()])
    info = run.config.data
    content = {
        "model": run.config.model,
        "preset": run.config.preset.name,
        "layout": info.layout,
        "layout_x_mm": info.x_mm.tolist(),
        "layout_y_mm": info.y_mm.tolist(),
        "full_scale_counts": info.full_scale_counts,
        "images": [
            {"image": str(path), "tactile_image": name, "counts": row.tolist()}
            for path, name, row in zip(image_paths, names, rounded, strict=True)
        ],
    }
    write_json(out_dir / "counts.json", content)


def _output_names(image_paths: Sequence[Path]) -> list[str]:
    """One PNG name an input, all different, whatever the case of the letters."""
    names: list[str] = []
    taken: set[str] = set()
    for path in image_paths:
        name, number = f"{path.stem}.png", 1
        while name.lower() in taken:
            number += 1
            name = f"{path.stem}-{number}.png"
        taken.add(name.lower())
        names.append(name)
    return names


def _parts(size: int, progress: str | None) -> list[slice] | tqdm:
    parts = [slice(start, start + AT_ONCE) for start in range(0, size, AT_ONCE)]
    return parts if progress is None else tqdm(parts, desc=progress, unit="batch")
