"""Compares a conversion to LeRobot's format with its dataset, through LeRobot's own loader.

    make lerobot-check DATA=data/smoke

It runs in an environment of its own, without t2twin, because LeRobot pins an older torch. A
stand-in takes the place of torchvision, of which the loader uses one function.
"""

import importlib
import importlib.abc
import importlib.util
import io
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.dataset as ds
from PIL import Image

SPLITS = ("train", "val", "test")
ROLES = ("source", "target")
LISTS = ("counts", "dense_counts", "pressure_kpa", "shear_x_kpa", "shear_y_kpa")  # after the role
SCALARS = {  # columns of the dataset by feature; of contacts, the first ones
    "action": ("x_mm", "y_mm", "yaw_rad", "force_n"),
    "observation.source_contact": ("source_depth_mm", "source_force_n"),
    "observation.target_contact": ("target_depth_mm", "target_force_n"),
}


def to_tensor(image: Image.Image) -> Any:
    """(3, rows, columns) float32 from 0 to 1, as torchvision.transforms.ToTensor()."""
    import torch

    return torch.from_numpy(np.array(image, np.float32) / 255).permute(2, 0, 1)


class _Finder(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Finds a stand-in in place of torchvision, whose members in capitals are empty classes."""

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> Any:
        if fullname.split(".")[0] != "torchvision":
            return None
        return importlib.util.spec_from_loader(fullname, self, is_package=True)

    def exec_module(self, module: Any) -> None:
        def member(name: str) -> Any:
            if name.startswith("__"):
                raise AttributeError(name)
            if name.islower():
                return importlib.import_module(f"{module.__name__}.{name}")
            return type(name, (), {})

        module.__getattr__, module.ToTensor = member, lambda: to_tensor


def check(data: Path, converted: Path) -> str:
    """Compares all frames and episodes; returns a summary, or AssertionError."""
    sys.meta_path.insert(0, _Finder())
    version = importlib.import_module("lerobot").__version__
    loader = importlib.import_module("lerobot.datasets.lerobot_dataset").LeRobotDataset
    info = json.loads((data / "info.json").read_text())
    dataset = loader("local/check", root=converted)
    paths = [data / path for split in SPLITS for path in sorted(info["shards"])
             if path.startswith(f"{split}/")]  # fmt: skip
    number, starts = 0, []
    for path in paths:
        for row in ds.dataset(path).to_table().to_pylist():
            item = dataset[number]
            _check_frame(item, row, f"frame {number}")
            is_first = int(item["frame_index"]) == 0
            starts += [number] * is_first
            assert int(item["episode_index"]) == len(starts) - 1, number
            assert is_first == (row.get("path", row["index"]) == row["index"]), number
            number += 1
    assert number == dataset.num_frames == len(dataset), number
    assert [episode["dataset_from_index"] for episode in dataset.meta.episodes] == starts
    return f"LeRobot {version} reads {len(starts)} episodes with {number} frames, as they are"


def _check_frame(item: dict[str, Any], row: dict[str, Any], place: str) -> None:
    """Images and counts must be equal, other values equal in float32."""
    for column in (f"{role}_{name}" for role in ROLES for name in ("image", "background")):
        name = column.removesuffix("_image")
        if column in row:
            pixels = np.asarray(Image.open(io.BytesIO(row[column]["bytes"])).convert("RGB"))
            values = item[f"observation.images.{name}"].numpy().transpose(1, 2, 0)
            assert np.array_equal(np.rint(values * 255).astype(np.uint8), pixels), (place, name)
    for column in (f"{role}_{name}" for role in ROLES for name in LISTS):
        if column in row:
            values = item[f"observation.{column}"].numpy()
            assert np.array_equal(values, np.array(row[column], np.float32)), (place, column)
    for name, columns in SCALARS.items():
        if name in item:
            expected = np.array([row[column] for column in columns], np.float32)
            assert np.array_equal(item[name].numpy()[: len(columns)], expected), (place, name)
    assert item["task"].split()[-1] == row["shape"], place


if __name__ == "__main__":
    print(check(*map(Path, sys.argv[1:])))
