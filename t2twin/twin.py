"""The public interface of the simulation: press a shape into both sensors."""

import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError, T2TwinWarning
from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.shape import HeightMap, Shape
from t2twin.sim.contact.elastomer import Elastomer, Friction
from t2twin.sim.contact.types import PressCommand, check_force
from t2twin.sim.optical.image_renderer import Renderer
from t2twin.sim.optical.markers import Markers
from t2twin.sim.press import Press
from t2twin.sim.sensors.defaults import SOURCE, TARGET
from t2twin.sim.sensors.files import bundled_sensors
from t2twin.sim.sensors.pair import SensorPair
from t2twin.sim.slide import path_commands, slide_to, straight_path, touches_along
from t2twin.sim.taxels.layout import Layout
from t2twin.sim.touch import Touch


class Twin:
    """Two simulated sensors, a source and a target.

    source, target: names of bundled sensors (`t2twin.sensors()`), or sensor files. The options hold
    for each of the two that has them; None is the sensor's own value.
    optics, gel, renderer, markers: of gel cameras. optics: the light and, if it was fitted, the
    gel's modulus: a file written by `t2twin calibrate`. renderer: what renders the images: "baked"
    in milliseconds, or "pyrender" in seconds and without an optics file only. markers: printed on
    the gel, `t2twin.Markers`; True for the sensor's own.
    layout, imperfections, cover: of taxel arrays. layout: a name ("cyskin-20", "cyskin-63"), a
    JSON or CSV file, or a `Layout`. imperfections: the errors in a press with a seed, such as
    "none", "white" or "recorded". gel, cover: the elastomers that are pressed.
    Several threads may use one twin at the same time.
    Raises T2TwinError for an invalid sensor, option or file, and for an option that neither sensor
    has.
    """

    def __init__(
        self,
        optics: str | Path | None = None,
        layout: str | Path | Layout | None = None,
        imperfections: str | None = None,
        gel: Elastomer | None = None,
        cover: Elastomer | None = None,
        renderer: Renderer | None = None,
        markers: Markers | bool | None = None,
        *,
        source: str | Path = SOURCE,
        target: str | Path = TARGET,
    ) -> None:
        self._pair = SensorPair.of(
            source,
            target,
            optics=optics,
            layout=layout,
            imperfections=imperfections,
            gel=gel,
            cover=cover,
            renderer=renderer,
            markers=markers,
        )

    @property
    def layout(self) -> Layout:
        """The taxels of the first taxel array: name, x_mm, y_mm and pad_diameter_mm, (n,) each.

        Raises T2TwinError for a twin without one.
        """
        return self._pair.array.layout

    @property
    def background(self) -> np.ndarray:
        """(rows, columns, 3) uint8: the background frame of the first gel camera, with markers,
        without noise. Raises T2TwinError for a twin without one."""
        return self._pair.camera.image_renderer.background

    def press(
        self,
        shape: str | Path | Shape,
        *,
        force_n: float | None = None,
        depth_mm: float | None = None,
        x_mm: float = 0.0,
        y_mm: float = 0.0,
        yaw_deg: float = 0.0,
        tilt_x_deg: float = 0.0,
        tilt_y_deg: float = 0.0,
        seed: int | None = None,
        scale: float | None = None,
        center: bool = False,
    ) -> Touch:
        """Press a shape into both sensors.

        shape, scale, center: as for `load_shape`. force_n: 0.01 to 100, default 8. depth_mm:
        instead of a force, the depth in the source's layer from first contact; the target is
        pressed with the resulting force. x_mm, y_mm: position of the shape's origin, right and down
        in the image. yaw_deg: rotation, clockwise in the image. tilt_x_deg, tilt_y_deg: tilt about
        the shape's origin, -30 to 30. A positive one lowers the side that is up, or to the right,
        in the image at yaw 0 into the sensors; the tilt turns with the yaw. seed: of the camera
        noise and the imperfections; None for neither.
        Warns with T2TwinWarning of what limits the result: see `Touch.notes`.
        Raises T2TwinError for an invalid shape, number or position.
        """
        given = Press("", x_mm, y_mm, yaw_deg, tilt_x_deg, tilt_y_deg, force_n, depth_mm, seed)
        rng = given.rng
        solid = load_shape(shape, scale, center)
        command = given.command(solid, self._pair.source)
        warn_of_tilt(solid, command)
        touch = self._pair.press(solid, command, rng)
        warn_of_limits([touch])
        return touch

    def slide(
        self,
        touch: Touch,
        *,
        dx_mm: float = 0.0,
        dy_mm: float = 0.0,
        dyaw_deg: float = 0.0,
        steps: int = 10,
        force_n: float | None = None,
        friction: float | None = None,
        seed: int | None = None,
    ) -> list[Touch]:
        """Slide and turn the shape of a touch, with friction; each touch continues the one before.

        dx_mm, dy_mm: motion of the shape's origin, right and down in the image. dyaw_deg: rotation
        about it, clockwise in the image. steps: number of touches along the way. force_n: force at
        the end, reached evenly; None keeps the touch's. friction: coefficient of friction of both
        sensors; None is each one's own. seed: as for `press`.

        The contacts of the touches, such as `touch["digit"].contact`, have the tangential force
        shear_n, torque_nmm, slip_share, and the fields shear_kpa, slipping and motion.
        Warns as `press` does, once of each limit.
        Raises T2TwinError for invalid numbers, for a touch without contact or of other sensors,
        gels or covers, and where nothing changes. Some part of the shape must lie over each pad.
        """
        law = None if friction is None else Friction(friction)
        if not arguments.instance(touch, "touch", Touch).contacts:
            raise T2TwinError("the touch has no contact; press with a force above 0 N first")
        self._pair.check_own(touch)
        start = touch.command
        force = start.force_n if force_n is None else arguments.real(force_n, "force_n")
        check_force(force)
        rng = Press(touch.command.shape, seed=seed).rng
        rows = straight_path(start, dx_mm, dy_mm, dyaw_deg, steps, force)
        commands = path_commands(start.shape, rows, tilt_rad=start.tilt_rad)[1:]
        if not (dx_mm or dy_mm or dyaw_deg or force != start.force_n):
            raise T2TwinError("nothing changes; give dx_mm, dy_mm, dyaw_deg or another force_n")
        self._pair.check_over_pads(touch, commands[-1])
        touches = []
        for command in commands:
            moved = slide_to(self._pair, touch, command, law)
            touch = self._pair.with_readings(moved, rng, before=touch)
            touches.append(touch)
        warn_of_limits(touches)
        return touches

    def follow(
        self,
        shape: str | Path | Shape,
        path: Sequence[Sequence[float]] | np.ndarray,
        *,
        friction: float | None = None,
        tilt_x_deg: float = 0.0,
        tilt_y_deg: float = 0.0,
        seed: int | None = None,
        scale: float | None = None,
        center: bool = False,
    ) -> list[Touch]:
        """Press a shape and slide it along a path, with friction; returns a touch for each row.

        path: (n, 4) rows of x_mm, y_mm, yaw_deg, force_n. The first row is a press; each further
        row continues the one before. A row with force 0 lifts the shape off: its touch has no
        contact, and the next row with a force is a press without tangential traction.
        shape, scale, center, seed, tilt_x_deg, tilt_y_deg: as for `press`. friction: as for
        `slide`. Warns as `slide` does.
        Raises T2TwinError for an invalid shape, path or number. Some part of the shape must
        lie over each pad in every row.
        """
        given = Press("", tilt_x_deg=tilt_x_deg, tilt_y_deg=tilt_y_deg, seed=seed)
        law, rng = None if friction is None else Friction(friction), given.rng
        solid = load_shape(shape, scale, center)
        commands = path_commands(solid.name, path, tilt_rad=given.tilt_rad)
        warn_of_tilt(solid, commands[0])
        touches = list(touches_along(self._pair, solid, commands, law, rng))
        warn_of_limits(touches)
        return touches


press = Twin().press
"""`Twin.press` of a twin with the default sensors."""


def shapes() -> tuple[str, ...]:
    """Names of all bundled shapes: the primitives, then the tools at their keypoints.

    Any number of random shapes exists besides: `random-0`, `random-1` and so on.
    """
    return catalogue.NAMES


def sensors() -> tuple[str, ...]:
    """Names of the bundled sensors, which `Twin` and `attach` take; they also take sensor files."""
    return bundled_sensors()


def load_shape(
    shape: str | Path | Shape, scale: float | None = None, center: bool = False
) -> Shape:
    """A shape by name (see `t2twin.shapes()`), a random one (`random-17`), or from a file.

    A file is STL, STEP, OBJ, PLY, 3MF or GLB, its pressing side up. scale: mm per unit of the file;
    None for the file's own unit, or 1 if it has none. center: whether the press axis passes through
    the middle of the highest part of the file's shape instead of the middle of its bounding box.
    The Shape's `notes` list repairs of the mesh and what stays open: the upper surface of an open
    mesh is pressed. Each note is also a T2TwinWarning. A prepared file is cached on disk. A Shape
    is returned unchanged.
    Raises T2TwinError for an unknown name, a file that cannot be pressed, a scale that is not
    positive, and for scale and center without a file.
    """
    if not isinstance(shape, Shape):
        arguments.path(shape, "shape")
        found = catalogue.load(shape, scale=scale, center=center)
        for note in found.notes:
            warnings.warn(note, T2TwinWarning, stacklevel=2)
        return found
    arguments.instance(shape.surface, "the shape's surface", HeightMap)
    catalogue.check_not_of_file(f"{shape.name} is a Shape", scale, center)
    return shape


def warn_of_tilt(shape: Shape, command: PressCommand) -> None:
    """Warn of what a shape does not show of the sides that a tilt turns up."""
    for note in command.tilted(shape).notes[len(shape.notes) :]:
        warnings.warn(note, T2TwinWarning, stacklevel=3)


def warn_of_limits(touches: Sequence[Touch]) -> None:
    """Warn of the notes of touches, once of each."""
    for note in dict.fromkeys(note for touch in touches for note in touch.notes):
        warnings.warn(note, T2TwinWarning, stacklevel=3)
