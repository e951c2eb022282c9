"""Pictures of examples/gripper.py: the scene, the DIGIT's image, the counts and the shear force."""

# MuJoCo defines its names at import, where pyright does not find them.
# pyright: reportAttributeAccessIssue=false

import ctypes
import importlib
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from PIL import Image

SIZE_IN, DPI = (8.0, 3.6), 100
SCENE_PX = (304, 336)
MAX_COUNTS, MAX_N = 10_000, 12.0
"""Ends of the axes. Full scale is 40,000 counts."""
READ_COLOR, PREDICTED_COLOR, DIGIT_COLOR = "#9aa5b1", "#c2410c", "#1d4ed8"
COLORS, PALETTE_PAGES = 256, 12
"""Colors of a GIF, and pages from which they are chosen."""


@dataclass(frozen=True)
class Moment:
    """What one picture shows.

    scene: (h, w, 3) uint8. image: the DIGIT's. counts, predicted, low, high: (n,) the counts read
    and predicted, with the ends of their intervals. times_s: (k,) until now. forces_n: (3, k) shear
    on the DIGIT, shear on the CySkin, and grip force.
    """

    title: str
    scene: np.ndarray
    image: np.ndarray
    counts: np.ndarray
    predicted: np.ndarray
    low: np.ndarray
    high: np.ndarray
    times_s: Sequence[float]
    forces_n: np.ndarray


class Page:
    """Draws moments one after another. end_s: end of the time axis."""

    def __init__(self, taxels: int, end_s: float) -> None:
        self.figure = Figure(SIZE_IN, DPI)
        self.canvas = FigureCanvasAgg(self.figure)
        self.scene = self._picture((0.0, 0.0, 0.38, 0.93))
        self.image = self._picture((0.40, 0.10, 0.20, 0.77))
        self.image.axes.set_title("DIGIT's image", fontsize=9)
        self._add_counts(taxels)
        self._add_forces(end_s)
        self.title = self.figure.text(0.012, 0.945, "", fontsize=10, weight="bold")

    def _picture(self, place: tuple[float, float, float, float]) -> AxesImage:
        axes = self.figure.add_axes(place)
        axes.set_axis_off()
        return axes.imshow(np.zeros((2, 2, 3), np.uint8), extent=(0, 3, 0, 4))

    def _add_counts(self, taxels: int) -> None:
        axes = self.figure.add_axes((0.685, 0.57, 0.305, 0.30))
        axes.set_title("CySkin's counts and 90 % intervals", fontsize=9)
        self.bars = axes.bar(np.arange(taxels), np.zeros(taxels), color=READ_COLOR, label="read")
        (self.points,) = axes.plot([], [], "o", ms=3, color=PREDICTED_COLOR, label="predicted")
        self.intervals = LineCollection([], colors=PREDICTED_COLOR, linewidths=1.2)
        axes.add_collection(self.intervals)
        axes.set(xlim=(-0.8, taxels - 0.2), ylim=(0, MAX_COUNTS), xticks=[])
        axes.set_yticks([0, 5_000, 10_000], ["0", "5,000", "10,000"])
        axes.set_xlabel("taxel", fontsize=8)
        self._finish(axes)

    def _add_forces(self, end_s: float) -> None:
        axes = self.figure.add_axes((0.685, 0.13, 0.305, 0.28))
        axes.set_title("shear and grip force, N", fontsize=9)
        self.forces = [
            axes.plot([], [], color=color, label=label, lw=1.4)[0]
            for color, label in (
                (DIGIT_COLOR, "DIGIT's shear"),
                (READ_COLOR, "CySkin's shear"),
                ("black", "grip"),
            )
        ]
        axes.set(xlim=(0, end_s), ylim=(0, MAX_N), yticks=(0, 4, 8), xlabel="time, s")
        axes.xaxis.label.set_size(8)
        self._finish(axes)

    @staticmethod
    def _finish(axes: Axes) -> None:
        axes.tick_params(labelsize=7)
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(fontsize=7, loc="upper right", frameon=False, ncols=3, handlelength=1)

    def draw(self, moment: Moment) -> Image.Image:
        self.title.set_text(moment.title)
        for artist, pixels in ((self.scene, moment.scene), (self.image, moment.image)):
            artist.set_data(pixels)
            artist.set_extent((0, pixels.shape[1], 0, pixels.shape[0]))
        for bar, height in zip(self.bars, moment.counts, strict=True):
            bar.set_height(height)
        taxels = np.arange(len(moment.counts))
        self.points.set_data(taxels, moment.predicted)
        ends = zip(taxels, moment.low, moment.high, strict=True)
        self.intervals.set_segments([[(n, low), (n, high)] for n, low, high in ends])
        for line, force_n in zip(self.forces, moment.forces_n, strict=True):
            line.set_data(moment.times_s, force_n)
        self.canvas.draw()
        return Image.fromarray(np.asarray(self.canvas.buffer_rgba())[..., :3])


class SceneRenderer:
    """Renders MuJoCo scenes without a display, through EGL."""

    def __init__(self, model: mujoco.MjModel) -> None:
        os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
        egl = importlib.import_module("OpenGL.EGL")
        if not hasattr(egl, "EGLDeviceEXT"):  # PyOpenGL 3.1.0, which pyrender requires, lacks it
            egl.EGLDeviceEXT = ctypes.c_void_p
        self._gl = importlib.import_module("mujoco.egl").GLContext(*SCENE_PX)
        self._gl.make_current()
        self._model, self.camera, self._options = model, mujoco.MjvCamera(), mujoco.MjvOption()
        self._options.sitegroup[:] = 0
        self._scene = mujoco.MjvScene(model, maxgeom=1000)
        self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)

    def render(self, data: mujoco.MjData) -> np.ndarray:
        """(h, w, 3) uint8."""
        self._gl.make_current()
        everything = mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(
            self._model, data, self._options, None, self.camera, everything, self._scene
        )
        width, height = SCENE_PX
        viewport = mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_render(viewport, self._scene, self._context)
        pixels = np.empty((height, width, 3), np.uint8)
        mujoco.mjr_readPixels(pixels, None, viewport, self._context)
        return pixels[::-1]

    def close(self) -> None:
        self._context.free()
        self._gl.free()


def write_animation(path: Path, pages: Sequence[Image.Image], rate_hz: float) -> None:
    """Write a GIF, or an MP4 with imageio-ffmpeg, by the suffix of the path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".mp4":
        writer = importlib.import_module("imageio_ffmpeg").write_frames(
            str(path), pages[0].size, fps=rate_hz, macro_block_size=2
        )
        writer.send(None)
        for page in pages:
            writer.send(np.ascontiguousarray(page))
        writer.close()
        return
    some = pages[:: max(1, len(pages) // PALETTE_PAGES)]
    palette = Image.fromarray(np.vstack([np.asarray(page) for page in some])).quantize(COLORS)
    first, *others = (
        page.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG) for page in pages
    )
    first.save(
        path, save_all=True, append_images=others, duration=round(1000 / rate_hz), loop=0,
        optimize=True,
    )  # fmt: skip
