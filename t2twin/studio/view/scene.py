"""One client's scene: both sensors side by side, mm, with what is pressed into them.

The sensor frame is that of t2twin.primitives_cad.shape, each sensor's moved along x to its place.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import trimesh
import viser

from t2twin.primitives_cad.shape import Shape
from t2twin.sim.contact.elastomer import CYSKIN_COVER, DIGIT_GEL
from t2twin.sim.contact.types import Contact
from t2twin.studio.session import Look
from t2twin.studio.view.solids import (
    ShownAs,
    as_glb,
    cut_open,
    elastomer_part,
    near_mesh,
    shape_pose,
    taxels_part,
    without_plate,
)

Sensors = Literal["both", "DIGIT", "CySkin"]
"""Which sensors are in the scene."""

APART_MM = 40.0
"""Distance of the two sensors' middles, mm: room for a shape as far as it is drawn."""

STEEL, GLASS_OPACITY = (150, 160, 175), 0.35
"""Colour of the shape, and how much of it is left as glass."""

LABELS = {"digit": "DIGIT: a gel with a camera below", "cyskin": "CySkin: a cover over taxels"}
"""What stands before each sensor."""

LABEL_MM = 3.0
"""How far before an elastomer that stands, mm."""

SEEN_FROM_MM, LOOKING_AT_MM = np.array([2.0, -55.0, 54.0]), np.array([2.0, -4.0, -2.0])
"""Where a new client's camera stands and looks, mm, with both sensors in the scene."""

ONE_SENSOR = 0.62
"""How much nearer it stands with one sensor, in parts."""

NARROW, HIDDEN_MM = 0.62, 64.0
"""Width over height of a view below which it stands farther away, so that all is seen, and looks
that much nearer to itself, mm: on a phone the controls hide the lower half."""

NEAREST_MM = 1.0
"""Nearest that anything is drawn, mm: near surfaces are told apart the better."""

LIFT_MM = 0.03
"""How far above its place the shape is drawn, mm, so that it and the surface that fits it do not
flicker into each other."""

LEVEL = 0.05
"""Fall of a ray, in parts of its length, below which it is too level to say where it arrives."""


@dataclass(frozen=True)
class Dragged:
    """How far the shape was dragged since the drag began, (3,) along the scene's axes, mm, at its
    height unless keys are held. keys: None, "shift" or "cmd/ctrl". begins: whether it has just
    begun."""

    by_mm: np.ndarray
    keys: str | None
    begins: bool


class Scene:
    """What one client sees of its look. on_drag: called with every step of a drag of the shape.

    A new surface takes the browser a moment to read, so each has two nodes that take turns:
    `settle` hides the one before. Not for several threads at once.
    """

    def __init__(self, client: viser.ClientHandle, on_drag: Callable[[Dragged], None]) -> None:
        self._client, self._on_drag = client, on_drag
        self._places = {
            name: client.scene.add_frame(f"/{name}", show_axes=False)
            for name in ("digit", "cyskin")
        }
        for name, elastomer in (("digit", DIGIT_GEL), ("cyskin", CYSKIN_COVER)):
            client.scene.add_label(
                f"/{name}/label",
                LABELS[name],
                position=(0.0, -elastomer.length_mm / 2 - LABEL_MM, -elastomer.thickness_mm),
                anchor="top-center",
            )
        self._surfaces: dict[str, list[viser.GlbHandle]] = {"digit": [], "cyskin": []}
        self._shapes: dict[str, viser.MeshHandle] = {}
        self._drawn: tuple[Shape, ShownAs, float] | None = None
        self._mesh: tuple[Shape, trimesh.Trimesh] | None = None
        self._grabbed = np.zeros(3)
        client.scene.configure_default_lights(enabled=True, cast_shadow=False)

    def arrange(self, sensors: Sensors) -> None:
        """Puts the sensors in their places, the others away, and the camera before them."""
        both = sensors == "both"
        for name, side in (("digit", -0.5), ("cyskin", 0.5)):
            self._places[name].visible = both or sensors.lower() == name
            self._places[name].position = (side * APART_MM if both else 0.0, 0.0, 0.0)
        camera = self._client.camera
        far = (1.0 if both else ONE_SENSOR) * max(1.0, NARROW / camera.aspect)
        looking_at = LOOKING_AT_MM - (0.0, HIDDEN_MM if camera.aspect < NARROW else 0.0, 0.0)
        with self._client.atomic():
            camera.near = NEAREST_MM
            camera.position = looking_at + far * (SEEN_FROM_MM - LOOKING_AT_MM)
            camera.look_at = looking_at

    def draw(self, look: Look, shown_as: ShownAs, most_kpa: dict[str, float], most: float) -> None:
        """Draws a look. most_kpa: the colors' upper end for each sensor; most: the taxels',
        counts."""
        contacts = {"digit": look.touch.digit, "cyskin": look.touch.cyskin}
        parts = {name: [elastomer_part(contacts[name], most_kpa[name])] for name in contacts}
        parts["cyskin"].append(
            taxels_part(look.touch.cyskin, look.touch.layout, look.touch.counts, most)
        )
        surfaces = {name: as_glb(parts[name]) for name in contacts}
        with self._client.atomic():  # nothing of this client's is sent within, so it is short
            self._draw_shape(look.touch.shape, shown_as, look.touch.command.yaw_rad, contacts)
            for name in contacts:
                self._draw_surface(name, surfaces[name])
        self._client.flush()

    def settle(self) -> None:
        """Hides the surfaces that are no more; to be called when the new ones have been read."""
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

    def _draw_shape(
        self, shape: Shape, shown_as: ShownAs, yaw_rad: float, contacts: dict[str, Contact]
    ) -> None:
        # A cut goes along the sensor's x, so it is another at each yaw.
        drawn = (shape, shown_as, yaw_rad if shown_as == "cut open" else 0.0)
        if self._drawn is None or self._drawn[0] is not shape or self._drawn[1:] != drawn[1:]:
            self._put_shape(*drawn)
            self._drawn = drawn
        for name, contact in contacts.items():
            turn, place = shape_pose(contact)
            self._shapes[name].wxyz = turn
            self._shapes[name].position = place + np.array([0.0, 0.0, LIFT_MM])

    def _put_shape(self, shape: Shape, shown_as: ShownAs, yaw_rad: float) -> None:
        if self._mesh is None or self._mesh[0] is not shape:
            self._mesh = (shape, near_mesh(shape))
        mesh = self._mesh[1]
        if shown_as == "cut open":
            mesh = cut_open(mesh, yaw_rad)
        elif shown_as == "glass":
            mesh = without_plate(mesh, shape)
        for name in self._places:
            if name in self._shapes:
                self._shapes[name].remove()
            handle = self._client.scene.add_mesh_simple(
                f"/{name}/shape",
                np.asarray(mesh.vertices),
                np.asarray(mesh.faces),
                color=STEEL,
                opacity=GLASS_OPACITY if shown_as == "glass" else None,
                flat_shading=True,
                side="double",
                cast_shadow=False,
                receive_shadow=False,
                visible=shown_as != "hidden",
            )
            self._shapes[name] = handle
            for keys in (None, "shift", "cmd/ctrl"):
                handle.on_drag("left", modifier=keys)(self._dragged)

    async def _dragged(self, event: viser.SceneNodeDragEvent[viser.MeshHandle]) -> None:
        """Drags come in order as this runs in viser's own loop; it only passes them on."""
        begins = event.phase == "start"
        if begins:
            self._grabbed = np.array(event.start_position)
        there = np.array(event.end_position)
        if event.modifier is None:
            there = _at_height(self._client.camera.position, there, float(self._grabbed[2]))
        self._on_drag(Dragged(there - self._grabbed, event.modifier, begins))


def _at_height(camera: np.ndarray, seen: np.ndarray, height_mm: float) -> np.ndarray:
    """Where the camera's ray to a point passes a height, (3,); the point itself where it is too
    level to say."""
    fall = seen[2] - camera[2]
    if abs(fall) < LEVEL * np.linalg.norm(seen - camera):
        return seen
    return camera + (height_mm - camera[2]) / fall * (seen - camera)
