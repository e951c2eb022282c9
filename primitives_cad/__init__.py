"""Parametric tactile primitives and hand tools, and any solid a user brings: named shapes
with the surface that faces a sensor."""

from pathlib import Path

try:
    Path.home()
except RuntimeError:
    # A user whom the system does not know, as containers have them. Libraries look for settings in
    # the home as soon as they are imported, and fail.
    from t2twin.core.cache_dir import use_cache_dir_as_home

    use_cache_dir_as_home()
