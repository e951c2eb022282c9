"""Values of wrong types and shapes, by what an argument must be."""

from pathlib import Path

import numpy as np
import torch
from PIL import Image

FRAME = np.full((320, 240, 3), 100, np.uint8)
SMALL = FRAME[:32, :24]

PICTURE, TABLE, PRESSES = "press.png", "pairs.csv", "presses"
"""Files of every box."""

NO_NUMBERS: dict[str, object] = {
    "text": "8", "a list": [8.0], "an array": np.ones(3), "complex": 8j, "a bool": True,
    "infinite": float("inf"), "NaN": np.float32("nan"), "a huge integer": 10**5000,
}  # fmt: skip
NO_WHOLE_NUMBERS: dict[str, object] = {
    "text": "1", "a fraction": 1.5, "NaN": float("nan"), "negative": -1, "a bool": True,
    "an array": np.ones(2, int), "a list": [1, 2],
}  # fmt: skip
NO_PATHS: dict[str, object] = {
    "None": None,
    "a number": 5,
    "bytes": b"x",
    "empty": "",
    "a NUL": "a\0",
    "too long": "x" * 5000,
    "no text": "\ud800",
}
NO_LISTS: dict[str, object] = {
    "None": None,
    "text": "run",
    "a path": Path("run"),
    "of None": [None],
}
NO_OBJECTS: dict[str, object] = {"None": None, "text": "x", "a dict": {}}
NO_ARRAYS: dict[str, object] = {
    "None": None, "text": "abc", "ragged": [[1.0, 2.0], [3.0]], "of text": ["a"] * 20,
    "complex": np.ones(20, complex), "NaN": np.full(20, np.nan), "of two axes": np.ones((5, 4, 3)),
}  # fmt: skip
NO_WORDS: dict[str, object] = {"None": None, "a number": 5, "unknown": "x", "a list": ["all"]}

NO_IMAGE: dict[str, tuple[object, str]] = {
    "RGBA": (np.zeros((32, 24, 4), np.uint8), "RGBA"),
    "channels first": (np.zeros((3, 32, 24), np.uint8), "channels-first"),
    "a grey batch": (np.zeros((4, 32, 24), np.uint8), "(B, h, w, 1)"),
    "two channels": (np.zeros((32, 24, 2), np.uint8), "shape (32, 24, 2)"),
    "one axis": (np.zeros(32, np.uint8), "shape (32,)"),
    "no axis": (np.uint8(3), "of type uint8"),
    "five axes": (np.zeros((1, 1, 8, 8, 3), np.uint8), "shape (1, 1, 8, 8, 3)"),
    "no rows": (np.zeros((0, 24, 3), np.uint8), "no pixels"),
    "float": (np.zeros((32, 24, 3)), "type float64"),
    "int64": (np.zeros((32, 24, 3), int), "type int64"),
    "bool": (np.zeros((32, 24), bool), "type bool"),
    "objects": (np.full((32, 24), None), "type object"),
    "a tensor": (torch.zeros((32, 24, 3), dtype=torch.uint8), "tensor.cpu().numpy()"),
    "a PIL image": (Image.new("RGB", (24, 32)), "PIL image"),
    "a path": (Path("press.png"), "reads a file"),
    "text": ("press.png", "reads a file"),
    "None": (None, "images is None"),
    "a dict": ({}, "of type dict"),
    "a number": (5, "expected an image"),
    "a nested list": ([[[1, 2, 3]]], "images[0]"),
    "a list with None": ([SMALL, None], "images[1] is None"),
    "a list with RGBA": ([np.zeros((32, 24, 4), np.uint8)], "images[0] has shape (32, 24, 4)"),
    "a list of batches": ([np.zeros((1, 32, 24, 3), np.uint8)], "images[0] has shape"),
    "an RGBA batch": (np.zeros((2, 32, 24, 4), np.uint8), "RGBA"),
    "a batch, channels first": (np.zeros((2, 3, 32, 24), np.uint8), "channels-first"),
}
