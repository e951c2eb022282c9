"""Shapes to press: parametric primitives, hand tools, random shapes, and solids from files."""

import os
from pathlib import Path

from t2twin.core.cache_dir import VARIABLE, cache_dir

try:
    Path.home()
except RuntimeError:
    # No home, as in containers: libraries that look for settings there fail at import.
    folder = cache_dir()
    os.environ["HOME"] = str(folder or "/")
    if folder is not None:
        os.environ[VARIABLE] = str(folder)
