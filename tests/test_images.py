"""Image files: every kind that is read, and what is refused before it is."""

import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from t2twin.core.errors import T2TwinError
from t2twin.translate.data.images import open_image


@pytest.fixture
def digit() -> Image.Image:
    """A bright spot on grey, as a press gives."""
    down, across = np.mgrid[:320, :240]
    spot = np.exp(-((down - 150) ** 2 + (across - 100) ** 2) / 2000.0)
    light = (60.0 + 180.0 * spot)[:, :, None] * np.array([1.0, 0.8, 0.6])
    return Image.fromarray(light.astype(np.uint8))


def test_every_kind_of_image_is_read_alike(digit: Image.Image, tmp_path: Path) -> None:
    """Grey, 16-bit, palette, transparent and JPEG files of one picture are that picture."""
    grey = np.asarray(digit.convert("L"))
    digit.save(tmp_path / "rgb.png")
    digit.convert("L").save(tmp_path / "grey.png")
    digit.convert("RGBA").save(tmp_path / "rgba.png")
    digit.convert("LA").save(tmp_path / "la.png")
    digit.quantize(256).save(tmp_path / "palette.png")
    Image.fromarray(grey.astype(np.uint16) * 257).save(tmp_path / "deep.png")
    digit.save(tmp_path / "photo.jpg", quality=95)
    for name in ("rgb", "grey", "rgba", "la", "palette", "deep", "photo"):
        image = open_image(next(tmp_path.glob(f"{name}.*")))
        assert image.mode in ("L", "RGB")
        read = np.asarray(image.convert("L")).astype(float)
        assert np.abs(read - grey).mean() < 3.0, name


def test_a_bomb_a_pipe_and_a_very_large_file_are_refused(tmp_path):
    """Few bytes, many pixels; a named pipe, which nobody writes to; a sparse file."""
    Image.new("1", (20_000, 20_000)).save(tmp_path / "bomb.png")
    os.mkfifo(tmp_path / "pipe.png")
    with (tmp_path / "sparse.png").open("wb") as file:
        file.truncate(10**12)
    for name, said in (("bomb", "pixels"), ("pipe", "is a folder"), ("sparse", "at most 100 MB")):
        with pytest.raises(T2TwinError, match=said):
            open_image(tmp_path / f"{name}.png")


@pytest.mark.parametrize("kept", [0.3, 0.9])
def test_an_image_that_is_cut_off_is_refused(kept, digit, tmp_path):
    digit.save(tmp_path / "whole.png")
    content = (tmp_path / "whole.png").read_bytes()
    (tmp_path / "cut.png").write_bytes(content[: round(kept * len(content))])
    (tmp_path / "longer.png").write_bytes(content + b"more")
    assert open_image(tmp_path / "longer.png").size == (240, 320)
    with pytest.raises(T2TwinError, match=r"cut\.png cannot be read as an image: it is damaged"):
        open_image(tmp_path / "cut.png")
