"""The press of one client, and its conversion from and to a command line, a link and a press of the
protocol."""

import shlex
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal, get_args
from urllib.parse import parse_qsl, urlencode

import numpy as np

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.records import convert
from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.shape import seed_of
from t2twin.primitives_cad.tilt import MAX_TILT_DEG
from t2twin.sim.contact.friction import check_friction
from t2twin.sim.contact.types import check_force
from t2twin.sim.sampling.protocol import FORCE_N, indices, press_of, scale_of
from t2twin.sim.sensors.defaults import ALIASES, ROLES, SOURCE, TARGET
from t2twin.sim.sensors.files import bundled_sensors
from t2twin.sim.sensors.pair import SensorPair
from t2twin.sim.taxels.layout import layout_names
from t2twin.sim.taxels.reading import NONE

FIRST_SHAPE = "square-1"
"""Shape of a new page, which a gel camera sees as a whole."""

IMPERFECTIONS = "white"
"""Imperfections of a new page, for an array that has them."""

MAX_QUERY = 2000
"""Maximum length of a link's query, characters (assumed: ten times the usual length)."""

Motion = Literal["jump", "slide"]
"""What a changed pose does: a press at the new pose, or sliding there with friction."""

TILT = ("tilt_x_deg", "tilt_y_deg")
"""Fields of the tilt."""

CONTACT = ("shape", "scale", "optics", "motion", "friction", "source", "target", *TILT)
"""Fields whose change lifts the shape off."""

SENSORS = ("source", "target", "optics", "markers", "layout", "imperfections")
"""Fields that the sensors depend on."""


@dataclass(frozen=True)
class PressState:
    """A requested press.

    shape: a name of the catalogue, `random-17`, or a file. x_mm, y_mm, yaw_deg, force_n: as for
    `t2twin press`. depth_mm: replaces the force, which then remains at its default. layout: a name
    or a file, None for the array's own. optics: a file, None for the camera's own. imperfections:
    of an array, applied with a seed. seed: of camera noise and imperfections, None for neither.
    scale: millimeters per unit of a file, None for the unit stated in the file. friction: as for
    `Twin.slide`. markers: whether the camera's markers are printed on its gel. source, target:
    names of bundled sensors, or sensor files. tilt_x_deg, tilt_y_deg: as for `t2twin press`.
    """

    shape: str = FIRST_SHAPE
    x_mm: float = 0.0
    y_mm: float = 0.0
    yaw_deg: float = 0.0
    force_n: float = FORCE_N
    depth_mm: float | None = None
    layout: str | None = None
    optics: str | None = None
    imperfections: str = IMPERFECTIONS
    seed: int | None = None
    scale: float | None = None
    motion: Motion = "jump"
    friction: float | None = None
    markers: bool = False
    source: str = SOURCE
    target: str = TARGET
    tilt_x_deg: float = 0.0
    tilt_y_deg: float = 0.0

    def with_changes(self, changes: dict[str, Any]) -> "PressState":
        """The press with changed fields. A changed force replaces the depth, and vice versa.

        A changed sensor begins with its own light, markers, layout and imperfections.
        """
        if any(changes.get(role, getattr(self, role)) != getattr(self, role) for role in ROLES):
            own = {name: getattr(_DEFAULT, name) for name in SENSORS if name not in ROLES}
            changes = own | changes
        if changes.get("depth_mm") is not None:
            changes = changes | {"force_n": FORCE_N}
        elif "force_n" in changes:
            changes = changes | {"depth_mm": None}
        return replace(self, **changes)

    @property
    def files(self) -> tuple[str, ...]:
        """The user's files."""
        sources = (self.shape, self.layout, self.optics, self.source, self.target)
        return tuple(each for each in sources if each is not None and is_file(each))

    @property
    def sensors(self) -> SensorPair:
        """The sensors, with their options. Raises T2TwinError as `SensorPair.of` does."""
        return SensorPair.of(
            self.source,
            self.target,
            optics=self.optics,
            markers=self.markers or None,
            layout=self.layout,
            imperfections=None if self.imperfections == IMPERFECTIONS else self.imperfections,
        )

    @property
    def imperfection_names(self) -> tuple[str, ...]:
        """Names of the imperfections of the arrays."""
        pair = SensorPair.of(self.source, self.target)
        found = [getattr(each.spec, "imperfections", {}) for each in (pair.source, pair.target)]
        return tuple(dict.fromkeys((IMPERFECTIONS, NONE, *(name for of in found for name in of))))

    def continues(self, before: "PressState") -> bool:
        """Whether the contact of another state can slide to this one.

        A change of CONTACT or to another depth lifts the shape off. A changed pose, force, layout
        or noise continues the contact.
        """
        return (
            self.motion == "slide"
            and all(getattr(self, name) == getattr(before, name) for name in CONTACT)
            and self.depth_mm in (None, before.depth_mm)
        )

    def command_line(self, path: str | None = None) -> str:
        """The command line of this press or, with a file of its path, of this slide.

        A file is represented by its name.
        """
        if path is None:
            words, unsaid = ["t2twin", "press", file_name(self.shape)], {"friction"}
        else:
            words = ["t2twin", "slide", file_name(self.shape), "--path", path]
            unsaid = {"x_mm", "y_mm", "yaw_deg", "force_n", "depth_mm"}
        unsaid |= {"shape", "motion", *(["imperfections"] if self.seed is None else [])}
        for name, value in vars(self).items():
            if name not in unsaid and value != getattr(_DEFAULT, name):
                words.append(f"--{name.replace('_', '-')}")
                if name != "markers":
                    words.append(file_name(value) if isinstance(value, str) else _shortest(value))
        return shlex.join(words)

    def query(self) -> str:
        """The query of a link to this press.

        Raises T2TwinError for a press with a user's file, which a link cannot contain.
        """
        if self.files:
            raise T2TwinError(
                f"a link cannot contain the file {file_name(self.files[0])}; download the press "
                "instead"
            )
        return urlencode({
            name: value if isinstance(value, str) else _shortest(value)
            for name, value in vars(self).items()
            if value is not None and (name == "shape" or value != getattr(_DEFAULT, name))
        })  # fmt: skip


IN_LINKS = frozenset(each.name for each in fields(PressState)) - {"optics", "scale"}
"""Fields that a link may contain; the others belong to files."""


def read_query(query: str) -> PressState:
    """The press of a link's query; missing fields have their defaults.

    A link must not refer to files of this machine. Raises T2TwinError for invalid values and for
    names of shapes, layouts, imperfections and motions that are not known.
    """
    if len(query) > MAX_QUERY:
        raise T2TwinError(f"the link is longer than {MAX_QUERY:,} characters")
    given = {name: text for name, text in parse_qsl(query) if name in IN_LINKS}
    arguments.choice(given.get("motion", _DEFAULT.motion), "motion", get_args(Motion))
    sent = convert(given, PressState, "the link", strict=False)
    for name in given:
        if isinstance(value := getattr(sent, name), float):
            arguments.number(value, name)
    state = _DEFAULT.with_changes({name: getattr(sent, name) for name in given})
    if state.shape not in catalogue.NAMES and seed_of(state.shape) is None:
        raise T2TwinError(
            f"there is no shape {state.shape!r}; `t2twin shapes` lists all but the random ones"
        )
    for role in ROLES:  # before the sensors are loaded
        if (sensor := getattr(state, role)) not in (*bundled_sensors(), *ALIASES):
            raise T2TwinError(
                f"no {role} {sensor!r}; expected one of {', '.join(bundled_sensors())}"
            )
    for value, name, known in (
        (state.layout or layout_names()[0], "taxel layout", layout_names()),
        (state.imperfections, "imperfections", state.imperfection_names),
    ):
        if value not in known:
            raise T2TwinError(f"no {name} {value!r}; expected one of {', '.join(known)}")
    for name in TILT:
        arguments.number(getattr(state, name), name, -MAX_TILT_DEG, MAX_TILT_DEG)
    check_force(state.force_n)
    check_friction(state.friction)
    if state.seed is not None:
        arguments.check_seed(state.seed)
    return state


def protocol_press(state: PressState, scale: str, number: int) -> PressState:
    """The state with position, yaw and force of a press of the protocol.

    number: of the press at the scale, from 0. Raises T2TwinError for a shape outside the protocol,
    an unknown scale and a number out of range.
    """
    count = protocol_presses(state.shape, scale)
    if not count:
        raise T2TwinError(f"{file_name(state.shape)} is not a shape of the protocol")
    if not 0 <= number < count:
        raise T2TwinError(
            f"scale {scale} has no press {number} of {state.shape}; expected 0 to {count - 1}"
        )
    index = indices(state.shape, scale_of(scale))[number]
    command = press_of(state.shape, catalogue.spacing_mm(state.shape), index)
    yaw_deg = float(np.rad2deg(command.yaw_rad))
    pose = {"x_mm": command.x_mm, "y_mm": command.y_mm, "yaw_deg": yaw_deg}
    return state.with_changes(pose | dict.fromkeys(TILT, 0.0) | {"force_n": command.force_n})


def protocol_presses(shape: str, scale: str) -> int:
    """Number of presses of a shape at a scale; 0 for a shape outside the protocol."""
    return len(indices(shape, scale_of(scale))) if shape in catalogue.NAMES else 0


def is_file(source: str) -> bool:
    """Whether a shape, a layout or an optics file is a file instead of a name."""
    return Path(source).name != source and source not in catalogue.NAMES


def file_name(source: str) -> str:
    """Displayed name of a shape, a layout or an optics file: of a file, its name."""
    return Path(source).name if is_file(source) else source


def _shortest(value: float) -> str:
    """The shortest exact representation of a number."""
    return repr(int(value)) if value == int(value) else repr(float(value))


_DEFAULT = PressState()
