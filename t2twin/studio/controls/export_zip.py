"""A press taken away: the folder that `t2twin press` writes, in a zip file."""

import io
import zipfile
from dataclasses import replace
from pathlib import Path

from t2twin.studio.press_state import file_name
from t2twin.studio.session import Look

AGAIN = "again.txt"
"""The file with the line that makes the press again."""


def zipped(look: Look, folder: Path) -> tuple[str, bytes]:
    """A name for the zip file, and its content.

    folder: a temporary one to write into. Raises T2TwinError where it cannot be written, and for a
    layout that has no tactile image.
    """
    name = look.touch.shape.name.replace("/", "-")
    light = look.state.calibration
    touch = replace(look.touch, calibration=None if light is None else file_name(light))
    place = folder / "press"
    touch.save(place)
    (place / AGAIN).write_text(look.state.command_line() + "\n")
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(place.iterdir()):
            archive.write(path, f"{name}/{path.name}")
    return f"{name}.zip", buffer.getvalue()
