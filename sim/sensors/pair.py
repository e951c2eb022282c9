"""Two sensors, and the press of one shape into both."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad.shape import Shape
from t2twin.sim.contact.elastomer import Friction
from t2twin.sim.contact.layer import cached_layer
from t2twin.sim.contact.pin_layout import Survey
from t2twin.sim.contact.sliding import advance
from t2twin.sim.contact.types import PressCommand
from t2twin.sim.optical.gel_camera import GelCamera
from t2twin.sim.optical.spec import KIND as GEL_CAMERA
from t2twin.sim.sensors.defaults import ALIASES, ROLES, SOURCE, TARGET
from t2twin.sim.sensors.files import Sensor, load_sensor
from t2twin.sim.taxels.spec import KIND as TAXEL_ARRAY
from t2twin.sim.taxels.taxel_array import TaxelArray
from t2twin.sim.touch import Reading, Touch

# Context manager around each stage of a press: press source, read source and so on
StageTimer = Callable[[str], AbstractContextManager[Any]]


@dataclass(frozen=True)
class SensorPair:
    """A source and a target, to be pressed by the same shape with the same command."""

    source: Sensor = field(default_factory=lambda: load_sensor(SOURCE))
    target: Sensor = field(default_factory=lambda: load_sensor(TARGET))

    @classmethod
    def of(
        cls, source: str | Path | Sensor = SOURCE, target: str | Path | Sensor = TARGET,
        **options: Any,
    ) -> "SensorPair":  # fmt: skip
        """The pair of two sensors, by name or file, with options of either kind.

        options: see OPTIONS of the kinds; None for the sensor's own. An option holds for each of
        the two that has it. Raises T2TwinError for an option that neither sensor has.
        """
        both = load_sensor(source, "source"), load_sensor(target, "target")
        return cls(*both).with_options(**options)

    def with_options(self, **options: Any) -> "SensorPair":
        """The same pair with options; see `of`."""
        given = {name: value for name, value in options.items() if value is not None}
        allowed = [name for name in options if name in self.source.OPTIONS + self.target.OPTIONS]
        for name in given:
            if name not in allowed:
                names = " and ".join(dict.fromkeys((self.source.name, self.target.name)))
                known = ", ".join(allowed) or "no such option"
                raise T2TwinError(f"{name} has no effect on {names}; allowed: {known}")
        both = []
        for sensor in (self.source, self.target):
            own = {name: value for name, value in given.items() if name in sensor.OPTIONS}
            both.append(sensor.with_options(own) if own else sensor)
        return SensorPair(*both)

    def with_imperfections(self, name: str | None) -> "SensorPair":
        """The same pair with imperfections of its taxel arrays; None for those of a dataset."""
        if name is not None:
            return self.with_options(imperfections=name)
        return SensorPair(self.source.for_dataset(), self.target.for_dataset())

    @cached_property
    def by_name(self) -> dict[str, Sensor]:
        """The sensors by their names in a touch; two of one name are NAME and NAME-2."""
        first, second = self.source.name, self.target.name
        return {first: self.source, second if second != first else f"{second}-2": self.target}

    @property
    def camera(self) -> GelCamera:
        """The first gel camera. Raises T2TwinError for a pair without one."""
        return self._first(GEL_CAMERA)

    @property
    def array(self) -> TaxelArray:
        """The first taxel array. Raises T2TwinError for a pair without one."""
        return self._first(TAXEL_ARRAY)

    def _first(self, kind: str) -> Any:
        for sensor in (self.source, self.target):
            if sensor.spec.kind == kind:
                return sensor
        names = f"{self.source.name} and {self.target.name}"
        raise T2TwinError(f"the sensors are {names}; neither is a {kind.replace('-', ' ')}")

    def named(self, sensor: str) -> str:
        """The name in a touch of a sensor by name, alias or role. Raises T2TwinError."""
        name = sensor if sensor in self.by_name else ALIASES.get(sensor, sensor)
        if name in self.by_name:
            return name
        if name in ROLES:
            return list(self.by_name)[ROLES.index(name)]
        raise T2TwinError(
            f"there is no sensor {sensor!r} in the twin; allowed are "
            f"{', '.join((*self.by_name, *ROLES))}"
        )

    def press(
        self, shape: Shape, command: PressCommand, rng: np.random.Generator | None = None,
        timed: StageTimer = nullcontext, only: str | None = None, before: Touch | None = None,
    ) -> Touch:  # fmt: skip
        """Press a shape into both sensors, or into one of them, by its name in a touch.

        command: of 0 N for readings without contact. rng: of both sensors' noise. before: the touch
        one sample earlier, for memories. Raises T2TwinError as solve_contact does.
        """
        readings: dict[str, Reading] = {}
        earlier: Any = {} if before is None else before.readings
        for role, (name, sensor) in zip(ROLES, self.by_name.items(), strict=True):
            if only not in (None, name):
                continue
            contact = None
            if command.force_n != 0.0:
                with timed(f"press {role}"):
                    contact = sensor.press(shape, command)
            with timed(f"read {role}"):
                readings[name] = sensor.read(contact, rng, earlier.get(name))
        return Touch(shape, command, readings)

    def check_own(self, touch: Touch) -> None:
        """Raises T2TwinError for a touch that was not pressed into these sensors' layers."""
        for name, contact in touch.contacts.items():
            own = self.by_name.get(name)
            given = contact.elastomer, round(contact.pitch_mm, 6)
            if own is None or (own.elastomer, round(own.pitch_mm, 6)) != given:
                raise T2TwinError(
                    f"the touch is of another twin, whose {name} is missing or has another gel, "
                    "cover or grid in this one; press with this twin first"
                )

    def check_over_pads(self, touch: Touch, command: PressCommand) -> None:
        """Raises OffPadError if the shape of a touch does not lie over its pads at another pose."""
        for contact in touch.contacts.values():
            Survey(touch.shape, command, cached_layer(contact.elastomer, contact.pitch_mm))

    def advance(
        self, touch: Touch, command: PressCommand, friction: Friction | dict[str, Friction] | None
    ) -> Touch:
        """Move the shape of a touch by a small step, with friction; without images and counts.

        friction: of both sensors, or by their names; None is each one's own.
        """
        before = touch.command
        dx_mm, dy_mm = command.x_mm - before.x_mm, command.y_mm - before.y_mm
        turn_rad, readings = command.yaw_rad - before.yaw_rad, {}
        for name, reading in touch.readings.items():
            own = friction.get(name) if isinstance(friction, dict) else friction
            own = self.by_name[name].friction if own is None else own
            contact = reading.contact
            if contact is not None:
                contact = advance(contact, dx_mm, dy_mm, turn_rad, command.force_n, own)
            readings[name] = replace(reading.without_value(), contact=contact)
        return replace(touch, command=command, readings=readings)

    def with_readings(
        self, touch: Touch, rng: np.random.Generator | None = None, before: Touch | None = None
    ) -> Touch:
        """The touch with the images and the counts of its contacts; rng, before as for `press`."""
        earlier: Any = {} if before is None else before.readings
        readings = {
            name: self.by_name[name].read(reading.contact, rng, earlier.get(name))
            for name, reading in touch.readings.items()
        }
        return replace(touch, readings=readings)
