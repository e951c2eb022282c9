"""Shapes to press: parametric primitives, hand tools, random shapes, and solids from files."""

import os
import tempfile
from pathlib import Path

try:
    Path.home()
except RuntimeError:
    # No home, as in containers: libraries that look for settings there fail at import.
    os.environ["HOME"] = tempfile.gettempdir()
