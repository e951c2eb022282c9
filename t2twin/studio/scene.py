"""The scene of one client: both sensors next to each other with the pressed shape, mm.

The sensor frame is that of t2twin.primitives_cad.shape, shifted along x for each sensor. The nodes
of the sensors have the names of their roles, source and target.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, Literal

import numpy as np
import trimesh
import viser
from numpy.typing import ArrayLike
from trimesh.exchange.gltf import export_glb
from trimesh.intersections import slice_faces_plane

from t2twin.core.draw import SLIP_RGB, STICK_RGB, in_colors, traction_arrows
from t2twin.primitives_cad.shape import Shape
from t2twin.primitives_cad.tilt import rotation_of
from t2twin.sim.contact.types import Contact, PressCommand
from t2twin.sim.sensors.defaults import ROLES
from t2twin.sim.sensors.files import Sensor
from t2twin.sim.taxels.layout import Layout
from t2twin.sim.touch import Touch

Sensors = Literal["both", "source", "target"]
"""Visible sensors."""

ShapeStyle = Literal["glass", "solid", "cut open", "hidden"]
"""Style of the shape."""

SENSOR_SPACING_MM, GAP_MM = 40.0, 16.8
"""Least distance between the sensor centers, and between their sides, which leaves space for the
shapes."""

EXTENT_MM, LENGTH_MM = 65.0, 46.0
"""Width of both sensors together, and length of one, from which on the camera is moved away."""

SEEN_FROM_MM, LOOKING_AT_MM = np.array([2.0, -55.0, 54.0]), np.array([2.0, -4.0, -2.0])
"""Position and target of a new client's camera with both sensors visible."""

ONE_SENSOR, NARROW = 0.62, 0.72
"""Relative distance of the camera with one visible sensor, and aspect ratio of the scene below
which the camera is moved away."""

NEAR_PLANE_MM = 1.0  # of the camera, large enough for the precision of the depth buffer
LABEL_MM = 3.0  # distance of a label from its elastomer
LIFT_MM = 0.03  # by which the drawn shape is raised, against flicker with the surface below

STEEL, GLASS_OPACITY = (150, 160, 175), 0.35
"""Color of the shape, and its opacity as glass."""

ARROWS, ARROW_LENGTH, ARROW_ABOVE_MM = 5, 1.6, 0.3
"""Number of traction arrows along the longer side of a contact, their length relative to their
spacing at the largest traction, and their height above the surface."""

RIM_RGB, RIM, RIM_ABOVE_MM, PAD_ABOVE_MM = (235, 235, 235), 1.12, 0.08, 0.12
"""Ring around a taxel's disc: color, relative diameter, and heights of both above the surface."""

PAD_VERTICES = 32  # of a taxel's disc

LIGHT, SHADE = np.array([-0.35, -0.45, 0.82]), 0.3
"""Direction of the light, and share of a color that depends on it, small enough to read colors."""

MAX_DISTANCE_MM = 19.5
"""Distance from the press axis up to which a shape is drawn, so that two sensors fit."""

MIN_SLOPE = 0.05
"""Slope of a ray below which its intersection with a height is undefined."""

UNLIT = "KHR_materials_unlit"
"""glTF extension for colors that are independent of the light."""

OnDrag = Callable[[np.ndarray, str | None, bool], None]
"""Receives a step of a drag of the shape: displacement since the start, key, whether it begins.

The displacement, (3,) mm, has a constant height unless a key is pressed. Keys are None, "shift" or
"cmd/ctrl".
"""


class Scene:
    """The scene of one client. on_drag: called for every step of a drag of the shape.

    A browser needs a moment to load a new surface, so each sensor alternates between two nodes, and
    `hide_old_surfaces` hides the previous one. Not thread-safe.
    """

    def __init__(self, client: viser.ClientHandle, on_drag: OnDrag, panels_px: int) -> None:
        self._client, self._on_drag = client, on_drag
        # viser's scene fills the page until the panels are docked, at an unknown time.
        full_px = client.camera.image_width
        self._width_px = max(full_px - panels_px, full_px / 3, 1)
        self._places = {role: client.scene.add_frame(f"/{role}", show_axes=False) for role in ROLES}
        self._sensors: tuple[Sensor, ...] = ()
        self._visible: Sensors = "both"
        self._surfaces: dict[str, list[viser.GlbHandle]] = {role: [] for role in ROLES}
        self._shapes: dict[str, viser.MeshHandle] = {}
        self._arrows: dict[str, viser.ArrowsHandle] = {}
        self._drawn: tuple[Any, ...] = (None,)  # the shape and its style
        self._grabbed = np.zeros(3)
        client.scene.configure_default_lights(enabled=True, cast_shadow=False)
        self.arrange("both")

    def arrange(self, sensors: Sensors) -> None:
        """Shows the selected sensors and moves the camera to them."""
        self._visible, both = sensors, sensors == "both"
        layers = [each.elastomer for each in self._sensors]
        width_mm = sum(each.width_mm for each in layers)
        spacing_mm = max(SENSOR_SPACING_MM, width_mm / 2 + GAP_MM)
        for role, side in zip(ROLES, (-0.5, 0.5), strict=True):
            self._places[role].visible = sensors in ("both", role)
            self._places[role].position = (side * spacing_mm if both else 0.0, 0.0, 0.0)
        camera = self._client.camera
        width_px = min(camera.image_width, self._width_px)
        far = (1.0 if both else ONE_SENSOR) * max(
            1.0,
            (spacing_mm + width_mm / 2) / EXTENT_MM,
            *(each.length_mm / LENGTH_MM for each in layers),
        )
        far *= max(1.0, NARROW * camera.image_height / width_px)
        with self._client.atomic():
            camera.near = NEAR_PLANE_MM
            camera.position = LOOKING_AT_MM + far * (SEEN_FROM_MM - LOOKING_AT_MM)
            camera.look_at = LOOKING_AT_MM

    def draw(
        self,
        touch: Touch,
        shape_style: ShapeStyle,
        max_kpa: dict[str, float],
        max_counts: dict[str, float],
        with_arrows: bool,
    ) -> None:
        """Draws a touch. max_kpa, max_counts: upper ends of the color scales, by sensor.
        with_arrows: draws the tangential traction."""
        surfaces = surfaces_of(touch, max_kpa, max_counts)
        sensors = tuple(each.sensor for each in touch.readings.values())
        if [each.spec for each in self._sensors] != [each.spec for each in sensors]:
            self._sensors = sensors
            self._label()
            self.arrange(self._visible)
        contacts: dict[str, Contact] = dict(zip(ROLES, touch.contacts.values(), strict=True))
        with self._client.atomic():  # short, because the client receives no messages meanwhile
            self._draw_shape(touch, shape_style, contacts)
            for role, surface in zip(ROLES, surfaces.values(), strict=True):
                self._draw_surface(role, surface)
                self._draw_arrows(role, contacts[role], with_arrows)
        self._client.flush()

    def hide_old_surfaces(self) -> None:
        """Hides the previous surfaces; call it when the browser has loaded the new ones."""
        for surfaces in self._surfaces.values():
            for surface in surfaces[:-1]:
                surface.visible = False

    def _label(self) -> None:
        """Replaces the labels of the sensors."""
        for role, sensor in zip(ROLES, self._sensors, strict=True):
            elastomer = sensor.elastomer
            self._client.scene.add_label(
                f"/{role}/label",  # replaces an earlier one
                f"{sensor.name}: {sensor.spec.kind.replace('-', ' ')}",
                position=(0.0, -elastomer.length_mm / 2 - LABEL_MM, -elastomer.thickness_mm),
                anchor="top-center",
            )

    def _draw_surface(self, name: str, glb: bytes) -> None:
        """Shows a surface in the node that is hidden."""
        surfaces = self._surfaces[name]
        if len(surfaces) < 2:
            node = f"/{name}/surface-{len(surfaces)}"
            surfaces.append(self._client.scene.add_glb(node, glb, cast_shadow=False))
            return
        surfaces.reverse()
        surfaces[-1].glb_data = glb
        surfaces[-1].visible = True

    def _draw_arrows(self, name: str, contact: Contact, visible: bool) -> None:
        """Replaces the traction arrows of a sensor."""
        if name in self._arrows:
            self._arrows.pop(name).remove()
        if not visible or contact.motion is None:
            return
        (rows, columns), along_mm, _ = traction_arrows(contact, ARROWS)
        half = ARROW_LENGTH * along_mm / 2
        x, y = contact.x_mm[columns], contact.y_mm[rows]
        height = surface_mm(contact)[rows, columns] + ARROW_ABOVE_MM
        ends = [np.stack([x + s * half[0], y + s * half[1], height], axis=-1) for s in (-1, 1)]
        slips = contact.slipping[rows, columns][:, None]
        self._arrows[name] = self._client.scene.add_arrows(
            f"/{name}/traction",
            np.stack(ends, axis=1),
            linear_values(np.where(slips, SLIP_RGB, STICK_RGB)),
            shaft_radius=0.1,
            head_radius=0.3,
            head_length=0.5,
        )

    def _draw_shape(self, touch: Touch, style: ShapeStyle, contacts: dict[str, Contact]) -> None:
        """Moves the shape, and replaces it if it or its style has changed."""
        shape, command = touch.shape, touch.command
        # The cutting plane is fixed in the sensor frame, so the cut shape depends on the rotation.
        turned = (command.yaw_rad, *command.tilt_rad) if style == "cut open" else ()
        is_new = self._drawn[0] is not shape or self._drawn[1:] != (style, turned)
        mesh = drawn_mesh(shape, style, command) if is_new else None
        self._drawn = (shape, style, turned)
        for role, contact in contacts.items():
            turn, place = contact.shape_pose
            if mesh is not None:
                handle = self._shapes[role] = self._client.scene.add_mesh_simple(
                    f"/{role}/shape",  # replaces an earlier one
                    np.asarray(mesh.vertices),
                    np.asarray(mesh.faces),
                    color=STEEL,
                    opacity=GLASS_OPACITY if style == "glass" else None,
                    flat_shading=True,
                    side="double",
                    cast_shadow=False,
                    receive_shadow=False,
                    visible=style != "hidden",
                )
                for keys in (None, "shift", "cmd/ctrl"):
                    handle.on_drag("left", modifier=keys)(self._dragged)
            self._shapes[role].wxyz = turn
            self._shapes[role].position = place + np.array([0.0, 0.0, LIFT_MM])

    async def _dragged(self, event: viser.SceneNodeDragEvent[viser.MeshHandle]) -> None:
        """Forwards drags; viser's event loop preserves their order."""
        is_start = event.phase == "start"
        if is_start:
            self._grabbed = np.array(event.start_position)
        end = np.array(event.end_position)
        if event.modifier is None:  # the camera's ray through the point meets the grabbed height
            camera = self._client.camera.position
            fall = end[2] - camera[2]
            if abs(fall) >= MIN_SLOPE * np.linalg.norm(end - camera):
                end = camera + (self._grabbed[2] - camera[2]) / fall * (end - camera)
        self._on_drag(end - self._grabbed, event.modifier, is_start)


def surfaces_of(
    touch: Touch, max_kpa: dict[str, float], max_counts: dict[str, float]
) -> dict[str, bytes]:
    """GLB files of the surfaces by sensor, with the taxels of arrays."""
    surfaces: dict[str, bytes] = {}
    reading: Any
    for name, reading in touch.readings.items():
        contact = touch.contacts[name]
        parts = [elastomer_part(contact, max_kpa[name], reading.sensor.mount.color)]
        if name in max_counts:
            layout = reading.sensor.layout
            parts.append(taxels_part(contact, layout, reading.counts, max_counts[name]))
        mesh: Any = trimesh.util.concatenate(parts)
        surfaces[name] = export_glb(mesh.scene(), include_normals=False, tree_postprocessor=_unlit)
    return surfaces


def elastomer_part(contact: Contact, max_kpa: float, side_rgba: Sequence[float]) -> trimesh.Trimesh:
    """Deformed surface of an elastomer in colors from 0 to max_kpa, with its sides."""
    z = surface_mm(contact)
    x, y = np.meshgrid(contact.x_mm, contact.y_mm)
    top = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    faces, rim = _grid_faces(*z.shape)
    bottom = top[rim] * (1, 1, 0) - (0, 0, contact.elastomer.thickness_mm)
    n = rim.size
    upper, lower = len(top) + np.arange(n), len(top) + n + np.arange(n)
    following = np.roll(np.arange(n), -1)
    sides = np.concatenate([
        np.stack([upper, lower, lower[following]], axis=-1),
        np.stack([upper, lower[following], upper[following]], axis=-1),
    ])  # fmt: skip
    slope_y, slope_x = np.gradient(z, contact.pitch_mm)
    normals = np.stack([-slope_x, -slope_y, np.ones_like(z)], axis=-1)
    lit = (normals @ LIGHT) / np.linalg.norm(normals, axis=-1) / LIGHT[2]
    share = np.clip(1 - SHADE + SHADE * lit, 0.0, 1.2).reshape(-1, 1)
    shaded = np.clip(share * in_colors(contact.pressure_kpa.ravel() / max_kpa), 0, 255)
    side_rgb = np.rint(255 * np.array(side_rgba[:3]))
    colors = np.concatenate([shaded, np.tile(side_rgb, (2 * n, 1))]).astype(np.uint8)
    vertices = np.concatenate([top, top[rim], bottom])
    return trimesh.Trimesh(
        vertices, np.concatenate([faces, sides]), vertex_colors=linear_values(colors), process=False
    )


def taxels_part(
    contact: Contact, layout: Layout, counts: np.ndarray, max_counts: float
) -> trimesh.Trimesh:
    """Taxels as discs on the surface, in colors from 0 to max_counts."""
    radius = layout.pad_diameter_mm / 2
    x, y = np.meshgrid(contact.x_mm, contact.y_mm)
    far = np.hypot(x - layout.x_mm[:, None, None], y - layout.y_mm[:, None, None])
    under = np.where(far <= RIM * radius[:, None, None], surface_mm(contact), -np.inf)
    places = np.stack([layout.x_mm, layout.y_mm, under.max(axis=(1, 2))], axis=-1)
    angles = np.linspace(0, 2 * np.pi, PAD_VERTICES, endpoint=False)
    disc = np.vstack([np.zeros(3), np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=-1)])
    at = 1 + np.arange(PAD_VERTICES)
    faces = np.stack([0 * at, at, np.roll(at, -1)], axis=-1)
    vertices, vertex_colors = [], []
    for size, above_mm, rgb in (
        (RIM * radius, RIM_ABOVE_MM, np.tile(RIM_RGB, (layout.size, 1))),
        (radius, PAD_ABOVE_MM, in_colors(counts / max_counts)),
    ):
        each = places[:, None] + disc * size[:, None, None] + (0.0, 0.0, above_mm)
        vertices.append(each.reshape(-1, 3))
        vertex_colors.append(np.repeat(rgb, len(disc), axis=0).astype(np.uint8))
    starts = len(disc) * np.arange(2 * layout.size)
    all_faces = (faces[None] + starts[:, None, None]).reshape(-1, 3)
    colors = linear_values(np.concatenate(vertex_colors))
    return trimesh.Trimesh(np.concatenate(vertices), all_faces, vertex_colors=colors, process=False)


def linear_values(colors: np.ndarray) -> np.ndarray:
    """(..., 3) uint8: linear values of sRGB colors (IEC 61966-2-1), which glTF and arrows have."""
    srgb = colors / 255.0
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    return np.rint(255.0 * linear).astype(np.uint8)


def _unlit(tree: dict[str, Any]) -> None:
    """Makes the colors of a glTF file of one mesh independent of the light."""
    tree["extensionsUsed"] = [UNLIT]
    tree["materials"] = [{"doubleSided": True, "extensions": {UNLIT: {}}}]
    tree["meshes"][0]["primitives"][0]["material"] = 0


@lru_cache(maxsize=8)
def _grid_faces(rows: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Triangles of a grid, (F, 3), and the vertices of its closed boundary, (n,)."""
    at = np.arange(rows * columns).reshape(rows, columns)
    cells = at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]
    a, b, c, d = (each.ravel() for each in cells)
    faces = np.concatenate([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)])
    rim = np.concatenate([at[0, :-1], at[:-1, -1], at[-1, :0:-1], at[:0:-1, 0]])
    return faces, rim


def surface_mm(contact: Contact) -> np.ndarray:
    """(ny, nx) heights of the deformed surface in the sensor frame, mm."""
    rest = contact.elastomer.rest_surface_mm(*np.meshgrid(contact.x_mm, contact.y_mm))
    return rest - contact.surface_mm


def drawn_mesh(shape: Shape, style: ShapeStyle, command: PressCommand) -> trimesh.Trimesh:
    """Mesh of a shape near the press axis, mm in the shape frame.

    Glass has no base plate, which would hide the rest. A shape that is cut open has its half on the
    positive side of the sensor's y axis.
    """
    mesh = shape.mesh
    for normal in ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0)):
        if np.abs(mesh.bounds[:, :2]).max() > MAX_DISTANCE_MM:
            mesh = _half(mesh, normal, -MAX_DISTANCE_MM * np.array(normal))
    if style == "glass" and shape.base_mm is not None:
        return _half(mesh, (0.0, 0.0, 1.0), (0.0, 0.0, shape.base_mm))
    if style == "cut open":
        # The sensor's y axis in the shape frame: rotated back by the yaw, turned over, tilted back.
        across = np.array((np.sin(command.yaw_rad), -np.cos(command.yaw_rad), 0.0))
        return _half(mesh, across @ rotation_of(*command.tilt_rad), (0.0, 0.0, 0.0))
    return mesh


def _half(mesh: trimesh.Trimesh, normal: ArrayLike, origin: ArrayLike) -> trimesh.Trimesh:
    """The part of a mesh on the positive side of a plane; the whole mesh if there is none."""
    # trimesh's function for whole meshes requires shapely, for caps that are not needed here.
    vertices, faces, _ = slice_faces_plane(mesh.vertices, mesh.faces, normal, origin)
    return trimesh.Trimesh(vertices, faces, process=False) if len(faces) else mesh
