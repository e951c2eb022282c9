"""The commands `t2twin shapes` and `t2twin primitives`."""

from pathlib import Path
from typing import Annotated

import tyro


def shapes() -> None:
    """List the names of the shapes that can be pressed."""
    from t2twin.primitives_cad.catalogue import KEYPOINTS
    from t2twin.primitives_cad.primitive_parameters import FAMILIES

    print("primitives, versions 1 to 4 (3 is for validation):")
    for family, versions in FAMILIES.items():
        names = [f"{family}-{number + 1}" for number in range(len(versions))]
        print("  " + "".join(f"{name:18}" for name in names).rstrip())
    print("tools at their keypoints, for testing:")
    for tool, keypoints in KEYPOINTS.items():
        names = [f"{tool}/{keypoint}" for keypoint in keypoints]
        print("  " + "".join(f"{name:22}" for name in names).rstrip())
    print("also any STL, STEP, OBJ, PLY, 3MF or GLB file, pressing side up (+z; +y in GLB)")


def primitives(
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("data/primitives"),
) -> None:
    """Write the 32 primitives, the 5 tools and a plate of all primitives as STEP and STL.

    Also writes a contact sheet, an image of all shapes.

    Args:
        out: Folder to write into.
    """
    from t2twin.primitives_cad.catalogue import NAMES
    from t2twin.primitives_cad.contact_sheet import draw_sheet
    from t2twin.primitives_cad.export import export_shapes

    export_shapes(out)
    sheet = draw_sheet(out / "contact_sheet.png")
    print("shapes to press:")
    for start in range(0, len(NAMES), 4):
        print("  " + "".join(f"{name:24}" for name in NAMES[start : start + 4]).rstrip())
    print(f"wrote STEP, STL and manifest.json to {out}, and the contact sheet {sheet}")
