"""The contact sheet of the shapes, embedded as JPEG: as PNG it is several times larger."""

import io
import tempfile
from pathlib import Path

from PIL import Image

from t2twin.primitives_cad.contact_sheet import draw_sheet
from t2twin.report.html import markup

JPEG_QUALITY = 85


def section() -> str:
    """Every primitive and tool, drawn."""
    note = (
        "Primitives stand in columns by family and in rows by version; version 3 is validation. "
        "Tools are pressed at the four points marked on each."
    )
    return markup.section(
        "shapes",
        "The shapes",
        [markup.embed(sheet(), "jpeg", "Every primitive and tool with its name", note=note)],
    )


def sheet() -> bytes:
    """The contact sheet as a JPEG file's content."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "contact-sheet.png"
        draw_sheet(path)
        buffer = io.BytesIO()
        with Image.open(path) as image:
            image.convert("RGB").save(
                buffer, format="JPEG", quality=JPEG_QUALITY, optimize=True, progressive=True
            )
    return buffer.getvalue()
