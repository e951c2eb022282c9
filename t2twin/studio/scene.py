"""The scene of one client: both sensors next to each other with the pressed shape, mm.

The sensor frame is that of t2twin.primitives_cad.shape, shifted along x for each sensor. The nodes
of the sensors have the names of their roles, source and target.
"""

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import trimesh
import viser

from t2twin.primitives_cad.shape import Shape
from t2twin.sim.contact.types import Contact
from t2twin.sim.sensors.defaults import ROLES
from t2twin.sim.sensors.files import Sensor
from t2twin.sim.touch import Touch
from t2twin.studio.charts import SLIP_RGB, STICK_RGB, arrows_of
from t2twin.studio.session import PressResult
from t2twin.studio.solids import (
    ShapeStyle,
    as_glb,
    cut_open,
    elastomer_part,
    linear_values,
    near_mesh,
    surface_mm,
    taxels_part,
    without_plate,
)

Sensors = Literal["both", "source", "target"]
"""Visible sensors."""

SENSOR_SPACING_MM, GAP_MM = 40.0, 16.8
"""Least distance between the sensor centers, mm, and between their sides, mm, which leave space for
the shapes."""

EXTENT_MM, LENGTH_MM = 65.0, 46.0
"""Width of both sensors together, and length of one, from which on the camera is moved away, mm."""

STEEL, GLASS_OPACITY = (150, 160, 175), 0.35
"""Color of the shape, and its opacity as glass."""

LABEL_MM = 3.0
"""Distance of a label from its elastomer, mm."""

SEEN_FROM_MM, LOOKING_AT_MM = np.array([2.0, -55.0, 54.0]), np.array([2.0, -4.0, -2.0])
"""Position and target of a new client's camera with both sensors visible, mm."""

ONE_SENSOR = 0.62
"""Relative distance of the camera with one visible sensor."""

NARROW = 0.72
"""Aspect ratio of the scene below which the camera is moved away."""

PHONE_PX, NARROW_PHONE, HIDDEN_MM = 576, 0.62, 64.0
"""Width below which viser shows the controls over the lower half of the scene; NARROW there, and
shift of the camera's target, mm."""

NEAR_PLANE_MM = 1.0
"""Near plane of the camera, mm, large enough for the precision of the depth buffer."""

LIFT_MM = 0.03
"""Height by which the drawn shape is raised, mm, which avoids flicker with the surface below."""

ARROWS, ARROW_LENGTH, ARROW_ABOVE_MM = 5, 1.6, 0.3
"""Number of arrows of tangential traction along the longer side of a contact, their length relative
to their spacing at the largest traction, and their height above the surface, mm."""

MIN_SLOPE = 0.05
"""Slope of a ray below which its intersection with a height is undefined."""


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

    def __init__(self, client: viser.ClientHandle, on_drag: OnDrag) -> None:
        self._client, self._on_drag = client, on_drag
        self._places = {role: client.scene.add_frame(f"/{role}", show_axes=False) for role in ROLES}
        self._labels: dict[str, viser.LabelHandle] = {}
        self._sensors: tuple[Sensor, ...] = ()
        self._visible: Sensors = "both"
        self._hidden_px = (0, 0)  # by panels to come, and the width of the scene before them
        self._surfaces: dict[str, list[viser.GlbHandle]] = {role: [] for role in ROLES}
        self._shapes: dict[str, viser.MeshHandle] = {}
        self._arrows: dict[str, viser.ArrowsHandle] = {}
        self._drawn: tuple[Shape, ShapeStyle, tuple[float, ...]] | None = None
        self._mesh: tuple[Shape, trimesh.Trimesh] | None = None
        self._grabbed = np.zeros(3)
        self._is_phone = client.camera.image_width < PHONE_PX
        client.scene.configure_default_lights(enabled=True, cast_shadow=False)

    def arrange(self, sensors: Sensors, hidden_px: int = 0) -> None:
        """Shows the selected sensors and moves the camera to them.

        hidden_px: width that panels will hide.
        """
        both = sensors == "both"
        self._visible = sensors
        self._hidden_px = (hidden_px, self._client.camera.image_width)
        layers = [each.elastomer for each in self._sensors]
        widths_mm, lengths_mm = ([getattr(each, name) for each in layers]
                                 for name in ("width_mm", "length_mm"))  # fmt: skip
        spacing_mm = max(SENSOR_SPACING_MM, sum(widths_mm) / 2 + GAP_MM)
        for role, side in zip(ROLES, (-0.5, 0.5), strict=True):
            self._places[role].visible = sensors in ("both", role)
            self._places[role].position = (side * spacing_mm if both else 0.0, 0.0, 0.0)
        camera, far, looking_at = self._client.camera, 1.0 if both else ONE_SENSOR, LOOKING_AT_MM
        far *= max(
            (spacing_mm + sum(widths_mm) / 2) / EXTENT_MM,
            *(each / LENGTH_MM for each in lengths_mm),
            1.0,
        )
        narrow = NARROW
        if self._is_phone:
            narrow, hidden_px = NARROW_PHONE, 0
            looking_at = LOOKING_AT_MM - (0.0, HIDDEN_MM, 0.0)
        width = max(camera.image_width - hidden_px, 1)
        far *= max(1.0, narrow * camera.image_height / width)
        with self._client.atomic():
            camera.near = NEAR_PLANE_MM
            camera.position = looking_at + far * (SEEN_FROM_MM - LOOKING_AT_MM)
            camera.look_at = looking_at

    def draw(
        self,
        result: PressResult,
        shape_style: ShapeStyle,
        max_kpa: dict[str, float],
        max_counts: dict[str, float],
        with_arrows: bool,
    ) -> None:
        """Draws a result. max_kpa, max_counts: upper ends of the color scales, by sensor.
        with_arrows: draws the tangential traction."""
        contacts, surfaces = {}, {}
        readings = zip(ROLES, result.touch.readings.items(), strict=True)
        for role, (name, reading) in readings:
            contacts[role] = contact = result.touch.contacts[name]
            color = reading.sensor.mount.color
            parts = [elastomer_part(contact, max_kpa[name], color)]
            if name in max_counts:
                counts: Any = reading
                layout = counts.sensor.layout
                parts.append(taxels_part(contact, layout, counts.counts, max_counts[name]))
            surfaces[role] = as_glb(parts)
        self._use(tuple(each.sensor for each in result.touch.readings.values()))
        with self._client.atomic():  # short, because the client receives no messages meanwhile
            self._draw_shape(result.touch, shape_style, contacts)
            for role in contacts:
                self._draw_surface(role, surfaces[role])
                self._draw_arrows(role, contacts[role], with_arrows)
        self._client.flush()

    def _use(self, sensors: tuple[Sensor, ...]) -> None:
        """Labels and arranges the sensors, if they are others than before."""
        before, self._sensors = self._sensors, sensors
        if [each.spec for each in before] == [each.spec for each in sensors]:
            return
        for role, sensor in zip(ROLES, sensors, strict=True):
            if role in self._labels:
                self._labels.pop(role).remove()
            elastomer = sensor.elastomer
            self._labels[role] = self._client.scene.add_label(
                f"/{role}/label",
                f"{sensor.name}: {sensor.spec.kind.replace('-', ' ')}",
                position=(0.0, -elastomer.length_mm / 2 - LABEL_MM, -elastomer.thickness_mm),
                anchor="top-center",
            )
        hidden_px, width_px = self._hidden_px
        is_hidden = self._client.camera.image_width != width_px  # the panels are there
        self.arrange(self._visible, 0 if is_hidden else hidden_px)

    def hide_old_surfaces(self) -> None:
        """Hides the previous surfaces; call it when the browser has loaded the new ones."""
        for surfaces in self._surfaces.values():
            for surface in surfaces[:-1]:
                surface.visible = False

    def _draw_surface(self, name: str, glb: bytes) -> None:
        surfaces = self._surfaces[name]
        if len(surfaces) < 2:
            node = f"/{name}/surface-{len(surfaces)}"
            surfaces.append(self._client.scene.add_glb(node, glb, cast_shadow=False))
            return
        surfaces.reverse()
        surfaces[-1].glb_data = glb
        surfaces[-1].visible = True

    def _draw_arrows(self, name: str, contact: Contact, visible: bool) -> None:
        if name in self._arrows:
            self._arrows.pop(name).remove()
        if not visible or contact.motion is None:
            return
        arrows = arrows_of(contact, ARROWS)
        along = ARROW_LENGTH * arrows.along_mm / 2
        height = surface_mm(contact)[arrows.rows, arrows.columns] + ARROW_ABOVE_MM
        x, y = arrows.x_mm, arrows.y_mm
        ends = [np.stack([x + s * along[0], y + s * along[1], height], axis=-1) for s in (-1, 1)]
        self._arrows[name] = self._client.scene.add_arrows(
            f"/{name}/traction",
            np.stack(ends, axis=1),
            linear_values(np.where(arrows.slips[:, None], SLIP_RGB, STICK_RGB)),
            shaft_radius=0.1,
            head_radius=0.3,
            head_length=0.5,
        )

    def _draw_shape(
        self, touch: Touch, shape_style: ShapeStyle, contacts: dict[str, Contact]
    ) -> None:
        shape, command = touch.shape, touch.command
        # The cutting plane is fixed in the sensor frame, so the cut shape depends on the rotation.
        turned = (command.yaw_rad, *command.tilt_rad) if shape_style == "cut open" else ()
        drawn = (shape, shape_style, turned)
        if self._drawn is None or self._drawn[0] is not shape or self._drawn[1:] != drawn[1:]:
            self._put_shape(touch, shape_style)
            self._drawn = drawn
        for name, contact in contacts.items():
            turn, place = contact.shape_pose
            self._shapes[name].wxyz = turn
            self._shapes[name].position = place + np.array([0.0, 0.0, LIFT_MM])

    def _put_shape(self, touch: Touch, shape_style: ShapeStyle) -> None:
        shape = touch.shape
        if self._mesh is None or self._mesh[0] is not shape:
            self._mesh = (shape, near_mesh(shape))
        mesh = self._mesh[1]
        if shape_style == "cut open":
            mesh = cut_open(mesh, touch.command)
        elif shape_style == "glass":
            mesh = without_plate(mesh, shape)
        for name in self._places:
            if name in self._shapes:
                self._shapes[name].remove()
            handle = self._client.scene.add_mesh_simple(
                f"/{name}/shape",
                np.asarray(mesh.vertices),
                np.asarray(mesh.faces),
                color=STEEL,
                opacity=GLASS_OPACITY if shape_style == "glass" else None,
                flat_shading=True,
                side="double",
                cast_shadow=False,
                receive_shadow=False,
                visible=shape_style != "hidden",
            )
            self._shapes[name] = handle
            for keys in (None, "shift", "cmd/ctrl"):
                handle.on_drag("left", modifier=keys)(self._dragged)

    async def _dragged(self, event: viser.SceneNodeDragEvent[viser.MeshHandle]) -> None:
        """Forwards drags; viser's event loop preserves their order."""
        is_start = event.phase == "start"
        if is_start:
            self._grabbed = np.array(event.start_position)
        end = np.array(event.end_position)
        if event.modifier is None:
            end = _at_height(self._client.camera.position, end, float(self._grabbed[2]))
        self._on_drag(end - self._grabbed, event.modifier, is_start)


def _at_height(camera: np.ndarray, point: np.ndarray, height_mm: float) -> np.ndarray:
    """Intersection of the camera's ray through a point with a height, (3,); the point itself for a
    nearly horizontal ray."""
    fall = point[2] - camera[2]
    if abs(fall) < MIN_SLOPE * np.linalg.norm(point - camera):
        return point
    return camera + (height_mm - camera[2]) / fall * (point - camera)
