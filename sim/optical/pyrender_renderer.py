"""Images of a gel camera by pyrender: the deformed gel as a mesh, lit by LEDs.

As in the baked model, the image is background + L(deformed) - L(rest), but pyrender renders L. So a
gel at rest gives the background exactly. Gamma and noise are the same.

A process has one renderer, which is created at the first image, so that PyrenderRenderer can be
pickled. OpenGL belongs to one thread, which renders all images.

No other module imports pyrender, which is unmaintained. The scene is in millimeters: pyrender's
shadow bias is an absolute number that removes all shadows of a scene in meters. The LEDs are spot
lights, since pyrender has shadows for spot and directional lights only. For soft shadows, each LED
has several points on its disc; the images of the points are averaged in linear light.
"""

import os
import warnings
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.optical.camera import Camera, optical_grid
from t2twin.sim.optical.illumination import MIN_CASTER_MM, REACH_MM, smoothed
from t2twin.sim.optical.image_renderer import ImageRenderer
from t2twin.sim.optical.response import linear, standard_normal
from t2twin.sim.optical.spec import Led

FRAME_SECONDS = 1.1
"""Time of an image with software OpenGL on two idle cores, s. It uses
all cores, so more processes are hardly faster."""
FIRST_SECONDS = 6.0  # time of the first image of a process, with the start of OpenGL (measured)
LED_POINTS = 8  # points per LED, each a render pass
GAMMA = 2.2  # exponent of pyrender's output encoding
MESH_STRIDE = 2
"""Cells of the optical grid per cell of the mesh: triangles below 4 pixels take seconds with
software OpenGL and change the image invisibly."""
CASTER_DEPTH_MM = 0.06
"""Distance of the surface that casts shadows behind the gel's surface, mm: twice a texel of the
shadow map at the far end of the gel, which avoids self-shadowing."""
SEEN_MARGIN_MM = 0.3  # of the receiving mesh around the visible region: a cell and a half
ALBEDO = 0.96  # light that pyrender's rough dielectric scatters diffusely (its constant)

PLATFORM = "PYOPENGL_PLATFORM"  # of PyOpenGL; MuJoCo sets it to the value of MUJOCO_GL


@cache
def _import_pyrender() -> Any:
    """pyrender, on the platform of PLATFORM or EGL."""
    os.environ[PLATFORM] = os.environ.get(PLATFORM) or "egl"
    np.__dict__.setdefault("infty", np.inf)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            from OpenGL.plugins import FormatHandler

            # PyOpenGL 3.1.0, which pyrender requires, finds types by name; that of ctypes.byref was
            # builtins.CArgObject before Python 3.12
            handler = "OpenGL.arrays.ctypesparameters.CtypesParameterHandler"
            FormatHandler("byref", handler, ["_ctypes.CArgObject"])
            import pyrender
    except (ImportError, OSError, AttributeError) as error:
        raise T2TwinError(_no_gl(error)) from error
    return pyrender


def _no_gl(error: Exception) -> str:
    platform = os.environ[PLATFORM]
    help_ = "on Debian: apt-get install libegl1 libgl1-mesa-dri libgl1"
    if platform != "egl":
        help_ = f"unset {PLATFORM}, which is {platform!r}, and MUJOCO_GL, or set both to egl"
    return (
        "the reference renderer needs OpenGL through EGL, which does not start here "
        f"({type(error).__name__}: {error}); {help_}"
    )


class ReferenceRenderer:
    """Renders the gel from inside.

    leds, ambient: the LEDs and the undirected light. shadows: whether LEDs cast shadows.
    led_points: points per LED, one render pass each; 1 gives hard shadows.
    Raises T2TwinError if there is no EGL or OpenGL library.
    """

    def __init__(
        self, leds: tuple[Led, ...], ambient: tuple[float, float, float], camera: Camera, gel:
        Elastomer, shadows: bool = True, led_points: int = LED_POINTS,
    ) -> None:  # fmt: skip
        self.camera = camera
        self._pyrender = pyrender = _import_pyrender()
        self._poses = [
            [_spot_pose(point, np.array(led.aim_mm)) for point in led.points_mm(led_points)]
            for led in leds
        ]
        self._passes = led_points if leds else 1
        self._axes = optical_grid(gel)
        self._grid = grid = np.meshgrid(*self._axes)
        self._rest_mm = camera.rest_mm(gel, *grid)
        ny, nx = (size // MESH_STRIDE for size in self._rest_mm.shape)
        self._faces = _grid_faces(ny, nx)
        xy, highest_mm = _blocks(np.stack(grid, axis=-1)), float(self._rest_mm.max())
        # the rim outside the image would shade the rest
        inside = camera.is_seen(xy[:, 0], xy[:, 1], SEEN_MARGIN_MM, highest_mm)
        is_seen = np.logical_and(*inside)
        self._seen_faces = self._faces[is_seen[self._faces].all(axis=1), ::-1]
        self._gel_material = pyrender.MetallicRoughnessMaterial(
            metallicFactor=0.0, roughnessFactor=1.0, doubleSided=True
        )
        self._caster_material = pyrender.MetallicRoughnessMaterial()
        # pyrender's cameras look along -z with +y up, this one along +z with y down
        pose = np.diag([1.0, -1.0, -1.0, 1.0])
        pose[2, 3] = -camera.distance_mm
        self._scene = pyrender.Scene(bg_color=(0, 0, 0, 1), ambient_light=ambient)
        x_px, y_px = camera.columns / 2 + camera.shift_x_px, camera.rows / 2 + camera.shift_y_px
        focal_px = camera.focal_px
        own = pyrender.IntrinsicsCamera(focal_px, focal_px, x_px, y_px, znear=5.0, zfar=100.0)
        self._scene.add(own, pose=pose)
        self._leds = [
            self._scene.add(
                pyrender.SpotLight(
                    color=np.array(led.color),
                    intensity=np.pi * REACH_MM**2 / ALBEDO,
                    innerConeAngle=np.radians(led.beam_deg[0]),
                    outerConeAngle=np.radians(led.beam_deg[1]),
                )
            )
            for led in leds
        ]
        self._mesh_node: Any = None
        flags = pyrender.RenderFlags
        self._flags = flags.SHADOWS_SPOT if shadows and leds else flags.NONE
        try:
            self._renderer = pyrender.OffscreenRenderer(camera.columns, camera.rows)
        except Exception as error:  # the type depends on the missing library
            raise T2TwinError(_no_gl(error)) from error

    def render(self, surface_mm: np.ndarray) -> np.ndarray:
        """(rows, columns, 3) uint8: the image of the gel deflected by surface_mm, on
        optical_grid(gel), positive into the sensor."""
        light = np.clip(self.render_linear(surface_mm), 0.0, 1.0)
        return np.round(255.0 * light ** (1.0 / GAMMA)).astype(np.uint8)

    def render_linear(self, surface_mm: np.ndarray) -> np.ndarray:
        """The same image as linear light, float64, in parts of white."""
        self._place_gel(surface_mm)
        total = np.zeros((self.camera.rows, self.camera.columns, 3))
        for index in range(self._passes):
            for led, poses in zip(self._leds, self._poses, strict=True):
                self._scene.set_pose(led, poses[index])
            picture, _ = self._renderer.render(self._scene, flags=self._flags)
            total += (picture / 255.0) ** GAMMA
        return total / self._passes

    def close(self) -> None:
        """Free the GL context. Other renderers of the process stay usable, also those of MuJoCo."""
        from OpenGL import EGL

        platform = self._renderer._platform

        def destroy() -> None:
            """pyrender's own function also terminates the display, which all contexts share."""
            display = platform._egl_display
            EGL.eglMakeCurrent(display, EGL.EGL_NO_SURFACE, EGL.EGL_NO_SURFACE, EGL.EGL_NO_CONTEXT)
            EGL.eglDestroyContext(display, platform._egl_context)

        platform.delete_context = destroy
        self._renderer.delete()

    def __enter__(self) -> "ReferenceRenderer":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _place_gel(self, surface_mm: np.ndarray) -> None:
        surface_mm = smoothed(np.ascontiguousarray(surface_mm, dtype=np.float32))
        z = self._rest_mm - surface_mm
        along_y, along_x = np.gradient(z, *reversed(self._axes))
        normals = _blocks(np.stack([along_x, along_y, -np.ones_like(z)], axis=-1))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        points = _blocks(np.stack([*self._grid, z], axis=-1))
        # pyrender's shadow maps omit back faces: the gel, facing away from the LEDs, only receives
        # shadows; a copy behind it, invisible to the camera, casts them
        parts = [(points, self._seen_faces, self._gel_material)]
        deep = _blocks(surface_mm[..., None]).ravel() > MIN_CASTER_MM
        casting = self._faces[deep[self._faces].all(axis=1)]
        if casting.size:
            parts.append((points - CASTER_DEPTH_MM * normals, casting, self._caster_material))
        primitives = [
            self._pyrender.Primitive(positions=at, normals=normals, indices=faces, material=of)
            for at, faces, of in parts
        ]
        mesh = self._pyrender.Mesh(primitives)
        if self._mesh_node is not None:
            self._scene.remove_node(self._mesh_node)
        self._mesh_node = self._scene.add(mesh)


class PyrenderRenderer(ImageRenderer):
    """As ImageRenderer, but pyrender renders each image, in about FRAME_SECONDS.

    leds, ambient: the LEDs, in the order of the optics', and the undirected light. baked: arguments
    of ImageRenderer. Raises T2TwinError at the first image if there is no OpenGL.
    """

    def __init__(
        self, leds: tuple[Led, ...], ambient: tuple[float, float, float], *baked: Any
    ) -> None:
        super().__init__(*baked)
        self._scene = leds, ambient, self.optics.camera, self._gel

    def _image(
        self, surface_mm: np.ndarray, coated_mm: np.ndarray, background: np.ndarray, shade:
        np.ndarray, rng: np.random.Generator | None, noise_grey: float,
    ) -> np.ndarray:  # fmt: skip
        light, grey = self.optics, background.astype(float)
        if surface_mm.any():
            change = _thread(os.getpid()).submit(_change, self._scene, surface_mm).result()
            if light.albedo is not None:
                change = change * light.albedo[..., None]
            total = linear(background, light.gamma) + change
            grey = 255.0 * np.clip(total, 0.0, 1.0) ** (1.0 / light.gamma)
        if shade.size:
            grey *= shade[..., None]
        if rng is not None:
            grey += noise_grey * standard_normal(rng, grey.shape)
        return (np.clip(grey, 0.0, 255.0) + 0.5).astype(np.uint8)


@cache
def _thread(process: int) -> ThreadPoolExecutor:
    """The thread of a process for OpenGL; the argument distinguishes forks."""
    return ThreadPoolExecutor(max_workers=1, thread_name_prefix=f"pyrender-{process}")


_last: dict[int, tuple[tuple, ReferenceRenderer, np.ndarray]] = {}
"""Of each process, which differ after forks: its last renderer, and the light of the gel at rest.
"""


def _change(scene: tuple, surface_mm: np.ndarray) -> np.ndarray:
    """(rows, columns, RGB) change of the light by a deflection; scene: of ReferenceRenderer."""
    process = os.getpid()
    if process in _last and _last[process][0] != scene:
        _last.pop(process)[1].close()
    if process not in _last:
        renderer = ReferenceRenderer(*scene)
        x, y = optical_grid(scene[-1])
        _last[process] = scene, renderer, renderer.render_linear(np.zeros((y.size, x.size)))
    _, renderer, rest_light = _last[process]
    return renderer.render_linear(surface_mm) - rest_light


def _blocks(grid: np.ndarray) -> np.ndarray:
    """(n, k) averages over blocks of MESH_STRIDE x MESH_STRIDE cells of a (ny, nx, k) grid."""
    ny, nx = (size // MESH_STRIDE for size in grid.shape[:2])
    cut = grid[: ny * MESH_STRIDE, : nx * MESH_STRIDE]
    return cut.reshape(ny, MESH_STRIDE, nx, MESH_STRIDE, -1).mean(axis=(1, 3)).reshape(ny * nx, -1)


def _grid_faces(ny: int, nx: int) -> np.ndarray:
    """(2 (ny - 1) (nx - 1), 3) triangles of a grid of vertices, facing the camera (-z)."""
    corner = np.arange(ny * nx, dtype=np.uint32).reshape(ny, nx)
    a, b = corner[:-1, :-1].ravel(), corner[:-1, 1:].ravel()
    c, d = corner[1:, :-1].ravel(), corner[1:, 1:].ravel()
    return np.concatenate([np.stack([a, c, b], axis=1), np.stack([b, c, d], axis=1)])


def _spot_pose(position_mm: np.ndarray, aim_mm: np.ndarray) -> np.ndarray:
    """(4, 4) pose of a spot light at one point, aimed at another along its -z."""
    back = position_mm - aim_mm
    back = back / np.linalg.norm(back)
    sideways = np.cross([0.0, 0.0, 1.0], back)
    sideways /= np.linalg.norm(sideways)
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2] = sideways, np.cross(back, sideways), back
    pose[:3, 3] = position_mm
    return pose
