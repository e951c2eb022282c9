"""Shapes to press: parametric primitives, hand tools, random shapes, and solids from files."""

from pathlib import Path

try:
    Path.home()
except RuntimeError:
    # No home, as in containers: libraries that look for settings there fail at import.
    from t2twin.core.cache_dir import use_cache_dir_as_home

    use_cache_dir_as_home()
