"""t2twin primitives"""

from pathlib import Path
from typing import Annotated

import tyro


def primitives(
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("data/primitives"),
) -> None:
    """Write the 32 primitives and the 5 tools as STEP and STL, the mosaic plate, the contact sheet.

    Args:
        out: Folder to write into.
    """
    from t2twin.primitives_cad.catalogue import NAMES
    from t2twin.primitives_cad.export import export
    from t2twin.primitives_cad.sheet import draw_sheet

    export(out)
    sheet = draw_sheet(out / "contact_sheet.png")
    print("shapes to press:")
    for start in range(0, len(NAMES), 4):
        print("  " + "".join(f"{name:24}" for name in NAMES[start : start + 4]).rstrip())
    print(f"STEP, STL, mosaic plate and manifest.json in {out}; look at {sheet}")
