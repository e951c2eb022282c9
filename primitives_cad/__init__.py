"""Shapes to press: parametric primitives, hand tools, random shapes, and solids from files."""

from pathlib import Path

try:
    Path.home()
except RuntimeError:
    # The user has no home, as in containers. Libraries fail that look for settings there at import.
    from t2twin.core.cache_dir import use_cache_dir_as_home

    use_cache_dir_as_home()
