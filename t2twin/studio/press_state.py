"""What one client presses just now, and the three ways to say it: a command line, a link, a
press of the protocol."""

import shlex
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, urlencode

import numpy as np

from t2twin.core.arguments import check_seed
from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.random_shapes import seed_of
from t2twin.sim.contact.types import check_force
from t2twin.sim.cyskin.layout import DEFAULT_LAYOUT, LAYOUTS
from t2twin.sim.cyskin.reading import PRESETS
from t2twin.sim.world.protocol import FORCE_N, indices, press_of, scale_of

FIRST_SHAPE = "square-2"
"""What a new page shows."""

MAX_QUERY = 2000
"""Longest query of a link that is read, characters (assumed: ten times what one has)."""


@dataclass(frozen=True)
class PressState:
    """One press as asked for.

    shape: a name of the catalogue, `random-17`, or a file. x_mm, y_mm, yaw_deg, force_n: as for
    `t2twin press`. depth_mm: as there, in place of the force, which then stays at its default.
    layout: a name or a file. calibration: a file, None for the light that ships. imperfections:
    what the CySkin adds where there is a seed. seed: of the camera's noise and the imperfections;
    None for neither. scale: mm in one of a file's units, None for what it says.
    """

    shape: str = FIRST_SHAPE
    x_mm: float = 0.0
    y_mm: float = 0.0
    yaw_deg: float = 0.0
    force_n: float = FORCE_N
    depth_mm: float | None = None
    layout: str = DEFAULT_LAYOUT
    calibration: str | None = None
    imperfections: str = "white"
    seed: int | None = None
    scale: float | None = None

    def changed(self, changes: dict[str, Any]) -> "PressState":
        """The press with other fields. Of force and depth the one that is named counts."""
        if changes.get("depth_mm") is not None:
            changes = changes | {"force_n": FORCE_N}
        elif "force_n" in changes:
            changes = changes | {"depth_mm": None}
        return replace(self, **changes)

    def command_line(self) -> str:
        """The line that makes this press again; a file goes by its name."""
        words = ["t2twin", "press", file_name(self.shape)]
        for name in ("x_mm", "y_mm", "yaw_deg", "force_n", "depth_mm", "scale", "seed"):
            value = getattr(self, name)
            if value != getattr(_DEFAULT, name):
                words += [f"--{name.replace('_', '-')}", _number(value)]
        if self.layout != _DEFAULT.layout:
            words += ["--layout", file_name(self.layout)]
        if self.calibration is not None:
            words += ["--calibration", file_name(self.calibration)]
        if self.seed is not None and self.imperfections != _DEFAULT.imperfections:
            words += ["--imperfections", self.imperfections]
        return shlex.join(words)

    def query(self) -> str:
        """The part of a link behind its question mark.

        Raises T2TwinError where a file of the user's is pressed or laid under: a link holds none.
        """
        for source in (self.shape, self.layout, self.calibration):
            if source is not None and is_file(source):
                raise T2TwinError(
                    f"a link cannot hold the file {file_name(source)}; take the press away instead"
                )
        values = {each.name: getattr(self, each.name) for each in fields(self)}
        changed = {
            name: value if isinstance(value, str) else _number(value)
            for name, value in values.items()
            if value is not None and (name == "shape" or value != getattr(_DEFAULT, name))
        }
        return urlencode(changed)


def read_query(query: str) -> PressState:
    """The press of a link; what it does not name is as on a new page.

    Raises T2TwinError for values that a page could not have made, files among them.
    """
    if len(query) > MAX_QUERY:
        raise T2TwinError(f"the link is longer than the {MAX_QUERY:,} characters that one can be")
    given = dict(parse_qsl(query))
    values: dict[str, Any] = {}
    for name in ("shape", "layout", "imperfections"):
        if name in given:
            values[name] = given[name]
    for name in ("x_mm", "y_mm", "yaw_deg", "force_n", "depth_mm"):
        if name in given:
            values[name] = _finite(name, given[name])
    if "seed" in given:
        values["seed"] = _seed(given["seed"])
    state = _DEFAULT.changed(values)
    check_named(state)
    check_force(state.force_n)
    return state


def check_named(state: PressState) -> None:
    """Raises T2TwinError unless shape, layout and imperfections are names that all know, no files:
    what comes over a wire names no file of this machine."""
    if state.shape not in catalogue.NAMES and seed_of(state.shape) is None:
        raise T2TwinError(
            f"there is no shape {state.shape!r}; `t2twin shapes` lists all but the random ones"
        )
    if state.layout not in layout_names():
        raise T2TwinError(
            f"no taxel layout {state.layout!r}; known are {', '.join(layout_names())}"
        )
    if state.imperfections not in PRESETS:
        raise T2TwinError(
            f"no imperfections called {state.imperfections!r}; allowed are {', '.join(PRESETS)}"
        )


def protocol_press(state: PressState, scale: str, number: int) -> PressState:
    """The same shape at the place of a press of the protocol, counted from 0 within a scale.

    Raises T2TwinError for a shape that is not the protocol's, an unknown scale and a number that
    the scale does not have.
    """
    count = protocol_presses(state.shape, scale)
    if not count:
        raise T2TwinError(f"{file_name(state.shape)} is no shape of the protocol")
    if not 0 <= number < count:
        raise T2TwinError(
            f"scale {scale} has no press {number} of {state.shape}; they are 0 to {count - 1}"
        )
    index = indices(state.shape, scale_of(scale))[number]
    command = press_of(state.shape, catalogue.spacing_mm(state.shape), index)
    return replace(
        state,
        x_mm=command.x_mm,
        y_mm=command.y_mm,
        yaw_deg=float(np.rad2deg(command.yaw_rad)),
        force_n=command.force_n,
        depth_mm=None,
    )


def protocol_presses(shape: str, scale: str) -> int:
    """How many presses a scale has of a shape; 0 of one that is not the protocol's."""
    return len(indices(shape, scale_of(scale))) if shape in catalogue.NAMES else 0


def layout_names() -> tuple[str, ...]:
    """Layouts that ship."""
    return tuple(sorted(path.stem for path in LAYOUTS.glob("*.json")))


def is_file(source: str) -> bool:
    """Whether a shape, a layout or a calibration is a file, and no name."""
    return Path(source).name != source and source not in catalogue.NAMES


def file_name(source: str) -> str:
    """What a shape, a layout or a calibration is called: a file goes by its name."""
    return Path(source).name if is_file(source) else source


def _number(value: float) -> str:
    """As short as it can be without becoming another number."""
    return repr(int(value)) if value == int(value) else repr(float(value))


def _finite(name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not np.isfinite(value):
        raise T2TwinError(f"{name} is {text[:20]!r}; it must be a finite number")
    return value


def _seed(text: str) -> int:
    if not (text.isascii() and text.isdigit()):
        raise T2TwinError(f"seed is {text[:20]!r}; it must be a whole number, 0 and more")
    check_seed(int(text))
    return int(text)


_DEFAULT = PressState()
