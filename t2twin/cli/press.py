"""t2twin press"""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import tyro


def press(
    shape: tyro.conf.Positional[Annotated[str, tyro.conf.arg(metavar="SHAPE")]],
    sensor: Literal["digit", "cyskin", "both"] = "both",
    x_mm: float = 0.0,
    y_mm: float = 0.0,
    yaw_deg: float = 0.0,
    force_n: float = 8.0,
    out: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None,
    thickness_mm: Annotated[float | None, tyro.conf.arg(metavar="FLOAT")] = None,
    young_mpa: Annotated[float | None, tyro.conf.arg(metavar="FLOAT")] = None,
    poisson: Annotated[float | None, tyro.conf.arg(metavar="FLOAT")] = None,
    flat: bool = False,
    layout: str = "cyskin-20",
    calibration: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    view: bool = False,
) -> None:
    """Press one shape into one sensor or both, and write what they see and feel.

    Args:
        shape: A catalogue name (square-2, pliers/jaw-tip; all are listed by t2twin primitives) or
            an STL or STEP file in mm, its pressing side up (+z).
        sensor: Which sensor is touched.
        x_mm: Where the shape's middle stands, to the right in the picture, mm.
        y_mm: The same, down the picture, mm.
        yaw_deg: Turn about the press axis, clockwise in the picture, degrees.
        force_n: Commanded force, N.
        out: Folder to write into; runs/press/SHAPE unless given.
        thickness_mm: Another elastomer's thickness, mm. With any of these three the elastomer is
            linear elastic, so that it can be compared with theory.
        young_mpa: Another elastomer's Young's modulus, MPa.
        poisson: Another elastomer's Poisson's ratio.
        flat: Take the dome off the gel.
        layout: Taxel layout: a name, or a JSON or CSV file with x_mm and y_mm.
        calibration: The DIGIT's light, as t2twin calibrate writes it; the one that ships unless
            given.
        view: Then open the scene in MuJoCo's viewer (the DIGIT's, where both are touched).
    """
    import numpy as np

    from t2twin.cli.press_files import PressFiles
    from t2twin.primitives_cad import catalogue
    from t2twin.primitives_cad.errors import T2TwinError
    from t2twin.sim.press.elastomer import CYSKIN_COVER, DIGIT_GEL, Elastomer
    from t2twin.sim.press.engine import check_force
    from t2twin.sim.press.records import PressCommand
    from t2twin.sim.sensors import CySkin, Digit

    for name, value in (("x-mm", x_mm), ("y-mm", y_mm), ("yaw-deg", yaw_deg)):
        if not np.isfinite(value):
            raise T2TwinError(f"--{name} is {value}; it must be a finite number")
    check_force(force_n)
    solid = catalogue.load(shape)
    command = PressCommand(solid.name, x_mm, y_mm, float(np.deg2rad(yaw_deg)), force_n)

    changed = {
        key: value
        for key, value in (
            ("thickness_mm", thickness_mm),
            ("young_mpa", young_mpa),
            ("poisson", poisson),
        )
        if value is not None
    }

    def elastomer(own: Elastomer) -> Elastomer:
        other = replace(own, **changed, law="linear") if changed else own
        if flat:
            other = replace(other, dome_width_radius_mm=np.inf, dome_length_radius_mm=np.inf)
        return other

    files = PressFiles(out or Path("runs/press") / shape_folder(solid.name), solid, command)
    if sensor in ("digit", "both"):
        light = None if calibration is None else str(calibration)
        files.add_digit(Digit(gel=elastomer(DIGIT_GEL), calibration=light))
    if sensor in ("cyskin", "both"):
        files.add_cyskin(CySkin(cover=elastomer(CYSKIN_COVER), layout_source=layout))
    files.write()
    if view:
        show(files.scene_path())


def show(path: Path) -> None:
    """Open a scene where there is a display, else say where it lies."""
    import os
    import sys

    from t2twin.sim.press.scene import view

    if sys.platform == "linux" and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        print(
            f"no display here to view on; open it elsewhere: python -m mujoco.viewer --mjcf={path}"
        )
        return
    view(path)


def shape_folder(name: str) -> str:
    """A shape's name as a folder's name."""
    return name.replace("/", "-")
