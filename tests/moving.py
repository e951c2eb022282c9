"""A small recipe with motion, and the digests of datasets."""

from pathlib import Path

RECIPE = """
name = "tiny"
seed = 4
imperfections = "white"

[[parts]]
shapes = "random"
count = 3
presses = 5
place = { normal_mm = 1.0 }
force_n = { low = 2.0, high = 8.0 }
val_share = 0.3

[light]
kind = "drawn"
each = "press"

[motion]
still = 0.2
slide = 0.5
twist = 0.3
slide_mm = [0.05, 0.2]
twist_deg = [0.5, 2.0]
steps = [1, 2]
markers = 0.5
"""


def write_recipe(folder: Path) -> Path:
    """Writes the recipe to a folder."""
    path = folder / "moving.toml"
    path.write_text(RECIPE)
    return path


def digests(folder: Path) -> dict[str, str]:
    """Of all files but the log, which says how long the runs took."""
    from t2twin.core.files import sha256_of
    from t2twin.sim.dataset.store import LOG  # imports pyarrow

    files = (path for path in sorted(folder.rglob("*")) if path.is_file() and path.name != LOG)
    return {str(path.relative_to(folder)): sha256_of(path) for path in files}
