"""One press as a user gives it. Imports nothing slow, as all commands' options include it."""

from dataclasses import dataclass, replace
from functools import partial
from math import radians
from typing import TYPE_CHECKING

from t2twin.core.errors import T2TwinError
from t2twin.sim.sensors.defaults import SOURCE, TARGET

if TYPE_CHECKING:
    import numpy as np

    from t2twin.primitives_cad.shape import Shape
    from t2twin.sim.contact.types import PressCommand
    from t2twin.sim.sensors.files import Sensor


OPTIONS = ("layout", "optics", "imperfections", "markers")  # Options of the sensors


@dataclass(frozen=True)
class Press:
    """One press, in the terms of `t2twin press`, `Twin.press` and the studio.

    The numbers are validated when they are used.

    Args:
        shape: A catalogue name (square-2, pliers/jaw-tip; t2twin shapes lists all), a random shape
            (random-0, random-1 and so on), or an STL, STEP, OBJ, PLY, 3MF or GLB file. The
            pressing side of a file's shape is up (+z; +y in GLB).
        x_mm: Position of the shape's middle, to the right in the image, mm.
        y_mm: The same, down in the image, mm.
        yaw_deg: Rotation about the press axis, clockwise in the image, degrees.
        tilt_x_deg: Tilt about the shape's middle, -30 to 30 degrees. A positive one lowers the
            side that is up in the image at yaw 0 into the sensors. The tilt turns with the yaw.
        tilt_y_deg: The same for the side that is to the right.
        force_n: Commanded force, N; default 8.
        depth_mm: Instead of a force, the depth from first contact, mm, in the elastomer of the
            source, or of the target if only the target is pressed.
        seed: Seed of the camera noise and of the array's imperfections; none without a seed.
        source: The first sensor: a bundled one (t2twin sensors lists them) or a sensor file.
        target: The second sensor.
        scale: mm per unit of the file: 1000 for meters, 25.4 for inches; of STEP, which is read in
            mm, a factor. Default: the file's unit (3MF, GLB, STEP), else 1.
        layout: Taxel layout of a taxel array: a name, or a JSON or CSV file with x_mm and y_mm.
        optics: A gel camera's light and, if it was fitted, its gel's modulus, as written by
            t2twin calibrate; default: those of the sensor's file.
        imperfections: An array's errors if there is a seed: none, or a name in the sensor's file;
            default white.
        markers: Print the markers of the sensor's file on the gel of a gel camera.
    """

    shape: str
    x_mm: float = 0.0
    y_mm: float = 0.0
    yaw_deg: float = 0.0
    tilt_x_deg: float = 0.0
    tilt_y_deg: float = 0.0
    force_n: float | None = None
    depth_mm: float | None = None
    seed: int | None = None
    source: str = SOURCE
    target: str = TARGET
    scale: float | None = None
    layout: str | None = None
    optics: str | None = None
    imperfections: str | None = None
    markers: bool = False

    @property
    def options(self) -> dict[str, str | bool | None]:
        """Options of the sensors, for `SensorPair.of`."""
        return {name: getattr(self, name) or None for name in OPTIONS}

    @property
    def tilt_rad(self) -> tuple[float, float]:
        """The tilt about x and y, rad. Raises T2TwinError for more than MAX_TILT_DEG."""
        from t2twin.core import arguments
        from t2twin.primitives_cad.tilt import MAX_TILT_DEG

        about_x, about_y = (
            radians(arguments.number(value, name, -MAX_TILT_DEG, MAX_TILT_DEG))
            for name, value in (("tilt_x_deg", self.tilt_x_deg), ("tilt_y_deg", self.tilt_y_deg))
        )
        return about_x, about_y

    @property
    def rng(self) -> "np.random.Generator | None":
        """The random generator of the seed, or None. Raises T2TwinError for an invalid seed."""
        if self.seed is None:
            return None
        import numpy as np

        from t2twin.core import arguments

        arguments.check_seed(self.seed)
        return np.random.default_rng(self.seed)

    def command(self, shape: "Shape", sensor: "Sensor") -> "PressCommand":
        """The command for the solver. A depth becomes the force that reaches it in `sensor`.

        Raises T2TwinError for values out of range or not finite, and for a force and a depth.
        """
        from t2twin.core import arguments
        from t2twin.sim.contact.contact_solver import force_at_depth
        from t2twin.sim.contact.types import MAX_YAW_DEG, PressCommand, check_force
        from t2twin.sim.sampling.protocol import FORCE_N

        x_mm, y_mm = (arguments.number(getattr(self, name), name) for name in ("x_mm", "y_mm"))
        yaw_deg = arguments.number(self.yaw_deg, "yaw_deg", -MAX_YAW_DEG, MAX_YAW_DEG)
        if self.force_n is not None and self.depth_mm is not None:
            raise T2TwinError("force_n and depth_mm are both given; expected one of them")
        force_n = FORCE_N if self.force_n is None else arguments.real(self.force_n, "force_n")
        check_force(force_n)
        command = PressCommand(shape.name, x_mm, y_mm, radians(yaw_deg), force_n, *self.tilt_rad)
        if self.depth_mm is None:
            return command
        found = force_at_depth(partial(sensor.press, shape), command, self.depth_mm)
        return replace(command, force_n=found)
