"""The twin as users have it: press a shape into both sensors, look at what they saw and felt."""

from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from t2twin.core import arguments
from t2twin.core.arguments import check_seed
from t2twin.core.errors import T2TwinError
from t2twin.press_folder import write_press
from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.shape import HeightMap, Shape
from t2twin.sim.contact.depth import force_at_depth
from t2twin.sim.contact.elastomer import CYSKIN_COVER, DIGIT_GEL, Elastomer
from t2twin.sim.contact.types import Contact, PressCommand, check_force
from t2twin.sim.cyskin.layout import DEFAULT_LAYOUT, Layout
from t2twin.sim.cyskin.phi import Phi
from t2twin.sim.sensors import CySkin, CySkinTouch, Digit, DigitTouch, Renderer, SensorPair
from t2twin.sim.world.protocol import FORCE_N


@dataclass(frozen=True)
class Touch:
    """One press of one shape, seen by the DIGIT and felt by the CySkin.

    command: where the shape stood, its turn and the force. image: (320, 240, 3) uint8, the DIGIT's,
    channels red, green, blue. counts: (n,) uint16, one for each taxel of the layout. digit, cyskin:
    both contacts, with depth_mm, force_n, surface_mm, pressure_kpa and more. calibration: the file
    with the DIGIT's light, None for the one that ships. optics: what made the image.
    """

    shape: Shape
    command: PressCommand
    image: np.ndarray
    counts: np.ndarray
    digit: Contact
    cyskin: Contact
    layout: Layout
    calibration: str | None = None
    optics: Renderer = "baked"

    @cached_property
    def tactile_image(self) -> np.ndarray:
        """(396, 240) float32, counts: the array as an image, between the taxels barycentric.

        Raises T2TwinError for a layout that cannot be drawn, as one with all taxels on a line.
        """
        return Phi(self.layout.x_mm, self.layout.y_mm)(self.counts)

    def save(self, folder: str | Path) -> None:
        """Write the folder that `t2twin press` writes: pictures, counts, contacts, scenes.

        Raises T2TwinError where the folder cannot be written.
        """
        digit = DigitTouch(self.digit, self.image, self.calibration, self.optics)
        cyskin = CySkinTouch(self.cyskin, self.counts, self.layout)
        write_press(arguments.path(folder, "folder"), digit, cyskin)


class Twin:
    """Both simulated sensors, ready to be pressed.

    calibration: the DIGIT's light, a file of `t2twin calibrate`, and its gel's modulus where that
    was fitted; None takes the one that ships.
    layout: the CySkin's taxels, a name ("cyskin-20", "cyskin-63") or a JSON or CSV file.
    imperfections: what the CySkin adds to a press that is given a seed: "none", "white",
    "baseline" or "all". gel, cover: the sensors' elastomers. optics: what makes the DIGIT's
    pictures: "baked" in milliseconds, or "pyrender" in seconds and for the light that ships only.
    Several threads may press one twin at once.
    Raises T2TwinError for a calibration, a layout or imperfections that cannot be used.
    """

    def __init__(
        self,
        calibration: str | Path | None = None,
        layout: str | Path = DEFAULT_LAYOUT,
        imperfections: str = "white",
        gel: Elastomer = DIGIT_GEL,
        cover: Elastomer = CYSKIN_COVER,
        optics: Renderer = "baked",
    ) -> None:
        light = None if calibration is None else str(arguments.path(calibration, "calibration"))
        taxels = str(arguments.path(layout, "layout"))
        self.sensors = SensorPair(
            Digit(gel=gel, calibration=light, renderer=optics),
            CySkin(cover=cover, layout_source=taxels, imperfections=imperfections),
        )

    @property
    def layout(self) -> Layout:
        """The CySkin's taxels: name, x_mm, y_mm and pad_diameter_mm, (n,) each."""
        return self.sensors.cyskin.layout

    @property
    def background(self) -> np.ndarray:
        """(320, 240, 3) uint8: the DIGIT untouched."""
        return self.sensors.digit.optics.background

    def press(
        self,
        shape: str | Path | Shape,
        *,
        force_n: float | None = None,
        depth_mm: float | None = None,
        x_mm: float = 0.0,
        y_mm: float = 0.0,
        yaw_deg: float = 0.0,
        seed: int | None = None,
        scale: float | None = None,
    ) -> Touch:
        """Press a shape into both sensors.

        shape, scale: as for `load_shape`. force_n: 0.01 to 100, 8 unless given; or depth_mm: how
        far it travels into the DIGIT's gel from its first touch, the CySkin being touched with the
        same force. x_mm, y_mm: where its middle stands, to the right and down in the image.
        yaw_deg: its turn, clockwise in the image. seed: camera noise and the CySkin's imperfections
        are drawn from it; without one there are none.
        Raises T2TwinError for a shape, a number or a place that cannot be pressed.
        """
        if seed is not None:
            check_seed(seed)
        solid = load_shape(shape, scale)
        command = press_command(solid, force_n, x_mm, y_mm, yaw_deg, depth_mm, self.sensors.digit)
        rng = None if seed is None else np.random.default_rng(seed)
        sample = self.sensors.press(solid, command, rng)
        return Touch(
            solid,
            command,
            sample.image,
            sample.counts,
            sample.digit,
            sample.cyskin,
            self.layout,
            self.sensors.digit.calibration,
            self.sensors.digit.renderer,
        )


def press(
    shape: str | Path | Shape,
    *,
    force_n: float | None = None,
    depth_mm: float | None = None,
    x_mm: float = 0.0,
    y_mm: float = 0.0,
    yaw_deg: float = 0.0,
    seed: int | None = None,
    scale: float | None = None,
) -> Touch:
    """Press a shape into the twin as it comes: see `Twin.press`."""
    return _default_twin().press(
        shape,
        force_n=force_n,
        depth_mm=depth_mm,
        x_mm=x_mm,
        y_mm=y_mm,
        yaw_deg=yaw_deg,
        seed=seed,
        scale=scale,
    )


@cache
def _default_twin() -> Twin:
    return Twin()


def shapes() -> tuple[str, ...]:
    """Names of all shapes that ship: the primitives, then the tools at their keypoints. Random
    ones, `random-0` and so on, are without end."""
    return catalogue.NAMES


def load_shape(shape: str | Path | Shape, scale: float | None = None) -> Shape:
    """A shape by name (see `t2twin.shapes()`), a random one (`random-17`), or from a file; a Shape
    is given back as it is.

    A file is STL, STEP, OBJ, PLY, 3MF or GLB, its pressing side up. scale: mm in one of the file's
    units; None takes what the file says, or 1 where it says nothing. The Shape's `notes` say what
    had to be mended. What is prepared is kept between calls. Raises T2TwinError for an unknown
    name, a file that cannot be pressed, and a scale that is not positive or not for a file.
    """
    if not isinstance(shape, Shape):
        arguments.path(shape, "shape")
        return catalogue.load(shape, scale=scale)
    arguments.instance(shape.surface, "the shape's surface", HeightMap)
    if scale is not None:
        raise T2TwinError(f"{shape.name} is a Shape, in mm; a scale is for files only")
    return shape


def press_command(
    shape: Shape,
    force_n: float | None,
    x_mm: float,
    y_mm: float,
    yaw_deg: float,
    depth_mm: float | None,
    sensor: Digit | CySkin,
) -> PressCommand:
    """A checked command: of a force, FORCE_N where None, or of the one that gives a depth, mm, in
    a sensor. Raises T2TwinError for a force or depth out of range, for both, and for places not
    finite."""
    x_mm, y_mm, yaw_deg = (
        arguments.number(value, name)
        for name, value in (("x_mm", x_mm), ("y_mm", y_mm), ("yaw_deg", yaw_deg))
    )
    if force_n is not None and depth_mm is not None:
        raise T2TwinError("force_n and depth_mm are both given; a press is of one of them")
    force = FORCE_N if force_n is None else arguments.real(force_n, "force_n")
    check_force(force)
    command = PressCommand(shape.name, x_mm, y_mm, float(np.deg2rad(yaw_deg)), force)
    if depth_mm is None:
        return command
    found = force_at_depth(partial(sensor.press, shape), command, depth_mm)
    return replace(command, force_n=found)


def other_elastomer(
    own: Elastomer,
    thickness_mm: float | None = None,
    young_mpa: float | None = None,
    poisson: float | None = None,
    flat: bool = False,
) -> Elastomer:
    """A sensor's elastomer with other properties, None leaving one as it is.

    With any of the first three it is linear elastic, so that it can be compared with theory. flat:
    without the dome. Raises T2TwinError for values out of range.
    """
    changes = {"thickness_mm": thickness_mm, "young_mpa": young_mpa, "poisson": poisson}
    given: dict[str, Any] = {k: value for k, value in changes.items() if value is not None}
    if given:
        given["law"] = "linear"
    if flat:
        given |= {"dome_width_radius_mm": np.inf, "dome_length_radius_mm": np.inf}
    return replace(own, **given)
