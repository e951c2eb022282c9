"""The README's picture: `python -m benchmarks.pictures` writes docs/pictures/presses.png.

Five presses at 8 N, a column each: the shape, what the DIGIT saw, what the CySkin felt.
"""

from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from t2twin.primitives_cad import catalogue, sheet
from t2twin.sim.cyskin.taxels import FULL_SCALE_COUNTS
from t2twin.sim.dataset.protocol import FORCE_N
from t2twin.sim.press.records import PressCommand
from t2twin.sim.sensors import CySkin, Digit
from t2twin.translate.phi import Phi
from t2twin.translate.picture import tactile_picture

PRESSES = (
    PressCommand("hemisphere-4", 0.0, 0.0, 0.0, FORCE_N),
    PressCommand("square-2", 1.0, -1.5, 0.5, FORCE_N),
    PressCommand("circle-empty-2", -1.0, 2.0, 0.0, FORCE_N),
    PressCommand("line-smooth-2", 0.5, 0.0, -0.7, FORCE_N),
    PressCommand("pliers/teeth", 1.5, 0.0, 0.3, FORCE_N),
)
SHAPE_PX = (240, 220)
DIGIT_PX = (240, 320)
TACTILE_PX = (240, 330)
GAP_PX = 16


def main() -> None:
    digit, cyskin = Digit(), CySkin()
    layout = cyskin.layout
    phi = Phi(layout.x_mm, layout.y_mm)
    width = len(PRESSES) * (SHAPE_PX[0] + GAP_PX) - GAP_PX
    height = SHAPE_PX[1] + DIGIT_PX[1] + TACTILE_PX[1] + 2 * GAP_PX
    page = Image.new("RGB", (width, height), "white")
    for column, command in enumerate(PRESSES):
        shape = catalogue.load(command.shape)
        left = column * (SHAPE_PX[0] + GAP_PX)
        tool = command.shape.split("/")[0]
        mesh = catalogue.tool_mesh(tool) if tool in catalogue.TOOLS else shape.mesh
        view = sheet.TOOL_VIEWS.get(tool, sheet.PRIMITIVE_VIEW)
        drawn, _ = sheet.draw(mesh, view, SHAPE_PX, sheet.STEEL)
        page.paste(Image.fromarray(drawn), (left, 0))
        ImageDraw.Draw(page).text((left + 6, 4), command.shape, fill=sheet.INK, font_size=15)
        seen = digit.see(digit.touch(shape, command), shape, command)
        page.paste(Image.fromarray(seen), (left, SHAPE_PX[1] + GAP_PX))
        counts = cyskin.feel(cyskin.touch(shape, command)).astype(np.float32)
        brightest = min(FULL_SCALE_COUNTS, 1.2 * float(counts.max()))
        felt = tactile_picture(phi(counts), layout.x_mm, layout.y_mm, brightest)
        page.paste(felt.resize(TACTILE_PX), (left, height - TACTILE_PX[1]))
    path = Path("docs/pictures/presses.png")
    path.parent.mkdir(parents=True, exist_ok=True)
    page.save(path, optimize=True)
    print(path)


if __name__ == "__main__":
    main()
