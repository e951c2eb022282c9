"""The README's image docs/pictures/presses.png.

    python -m benchmarks pictures

Five presses at 8 N, one column each: the shape, the DIGIT image and the tactile image. The results
have the presses and one figure of each sensor.
"""

from argparse import Namespace
from typing import Any

from PIL import Image, ImageDraw

from benchmarks import ROOT
from benchmarks.evidence import Benchmark, Figure
from t2twin.core.draw import colored_tactile_image
from t2twin.core.files import atomic_write
from t2twin.primitives_cad import catalogue
from t2twin.sim.contact.types import PressCommand
from t2twin.sim.sampling.protocol import FORCE_N
from t2twin.sim.sensors.pair import SensorPair
from t2twin.sim.touch import Touch

BENCHMARK = Benchmark(
    module="benchmarks.optics.pictures",
    minutes=0.3,
    sources=("primitives_cad", "sim"),
    figures=(
        Figure("presses.0.largest_counts", "counts"),
        Figure("presses.4.largest_counts", "counts"),
    ),
)

PICTURE = ROOT / "docs" / "pictures" / "presses.png"

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

BRIGHTEST = 1.2
"""Counts of the brightest color, in parts of the press's largest."""


def measure(options: Namespace) -> dict[str, Any]:
    sensors = SensorPair()
    samples = [sensors.press(catalogue.load(press.shape), press) for press in PRESSES]
    if not options.keep_nothing:
        with atomic_write(PICTURE) as temporary:
            draw(sensors, samples).save(temporary, optimize=True)
    return {
        "presses": [
            {
                "shape": sample.command.shape,
                "digit_depth_mm": sample.digit.depth_mm,
                "image_mean_grey": float(sample.image.mean()),
                "largest_counts": int(sample.counts.max()),
            }
            for sample in samples
        ]
    }


def draw(sensors: SensorPair, samples: list[Touch]) -> Image.Image:
    """The picture, a column a sample."""
    layout, full_scale = sensors.array.layout, sensors.array.full_scale
    width = len(samples) * (SHAPE_PX[0] + GAP_PX) - GAP_PX
    height = SHAPE_PX[1] + DIGIT_PX[1] + TACTILE_PX[1] + 2 * GAP_PX
    page = Image.new("RGB", (width, height), "white")
    for column, sample in enumerate(samples):
        left = column * (SHAPE_PX[0] + GAP_PX)
        page.paste(_drawn_shape(sample.command.shape), (left, 0))
        page.paste(Image.fromarray(sample.image), (left, SHAPE_PX[1] + GAP_PX))
        brightest = min(full_scale, BRIGHTEST * float(sample.counts.max()))
        tactile = colored_tactile_image(sample.tactile_image, layout.x_mm, layout.y_mm, brightest)
        page.paste(tactile.resize(TACTILE_PX), (left, height - TACTILE_PX[1]))
    return page


def _drawn_shape(name: str) -> Image.Image:
    """The shape, or the whole tool, with the shape's name."""
    from t2twin.primitives_cad import export

    tool = name.split("/")[0]
    is_tool = tool in catalogue.TOOLS
    mesh = catalogue.tool_mesh(tool) if is_tool else catalogue.load(name).mesh
    view = export.TOOL_VIEWS[tool] if is_tool else export.PRIMITIVE_VIEW
    drawing = Image.fromarray(export.draw(mesh, view, SHAPE_PX, export.STEEL)[0])
    ImageDraw.Draw(drawing).text((6, 4), name, fill=export.INK, font_size=15)
    return drawing
