"""The studio's core: a press as asked for becomes what both sensors and the translators say of it.

It knows no browser; one client has one session. Shape letters: R rows and C columns of a tactile
image, N taxels.
"""

import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from threading import Lock

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.shape import Shape
from t2twin.sim.cyskin.phi import Phi
from t2twin.sim.sensors import CySkin, Digit, SensorPair
from t2twin.studio.press_state import PressState
from t2twin.studio.translators import Translation, Translators
from t2twin.twin import Touch, load_shape, press_command

TRANSLATING = "translate"
"""What the translators' time goes by, beside the stages of t2twin.sim.sensors.SensorPair.press."""

STEPS = ("press digit", "picture", "press cyskin", "taxels", "tactile image", TRANSLATING)
"""Steps of a press, in their order."""


_making = Lock()
"""Held while a shape of the catalogue is made, so that two sessions do not make the same one."""


@dataclass(frozen=True)
class PressResult:
    """What there is to see of one press.

    tactile_image: (R, C) float32, counts, phi of what the CySkin counted; None for a layout that
    has none, and then `no_image` says why. steps_ms: milliseconds of each of STEPS.
    """

    state: PressState
    touch: Touch
    tactile_image: np.ndarray | None
    no_image: str
    translations: tuple[Translation, ...]
    steps_ms: dict[str, float]

    @property
    def milliseconds(self) -> float:
        return sum(self.steps_ms.values())


class Session:
    """One client's shape and sensors, kept from press to press; only what changes is made anew.

    sensors: both as they come, which sessions may share. Not for several threads at once.
    """

    def __init__(self, translators: Translators, sensors: SensorPair | None = None) -> None:
        self.translators = translators
        self._sensors = sensors or SensorPair()
        self._made_for = PressState()
        self._shape: tuple[tuple[str, float | None], Shape] | None = None
        self._background: tuple[Digit, np.ndarray] | None = None
        self._phi: tuple[CySkin, Phi | T2TwinError] | None = None

    def shape(self, state: PressState) -> Shape:
        """The shape of a press. Raises T2TwinError where there is none."""
        source = (state.shape, state.scale)
        if self._shape is None or self._shape[0] != source:
            with _making if state.shape in catalogue.NAMES else nullcontext():
                self._shape = (source, load_shape(*source))
        return self._shape[1]

    def press(self, state: PressState, runs: tuple[str, ...] = ()) -> PressResult:
        """Presses, takes the picture and translates it by the runs of these names.

        Raises T2TwinError for what cannot be pressed, with the sentence of `t2twin press`.
        """
        steps: dict[str, float] = dict.fromkeys(STEPS, 0.0)
        shape, sensors = self.shape(state), self._sensors_for(state)
        force_n = state.force_n if state.depth_mm is None else None
        command = press_command(
            shape, force_n, state.x_mm, state.y_mm, state.yaw_deg, state.depth_mm, sensors.digit
        )
        rng = None if state.seed is None else np.random.default_rng(state.seed)

        @contextmanager
        def timed(step: str) -> Iterator[None]:
            started = time.perf_counter()
            yield
            steps[step] += 1e3 * (time.perf_counter() - started)

        sample = sensors.press(shape, command, rng, timed)
        touch = Touch(
            shape,
            command,
            sample.image,
            sample.counts,
            sample.digit,
            sample.cyskin,
            sensors.cyskin.layout,
            sensors.digit.calibration,
        )
        with timed("tactile image"):
            phi = self._phi_of(sensors.cyskin)
            tactile = None if isinstance(phi, T2TwinError) else phi(touch.counts)
        with timed(TRANSLATING):
            background = self._background_of(sensors.digit) if runs else None
            translations = self.translators.translate_touch(touch, runs, background)
        no_image = str(phi) if isinstance(phi, T2TwinError) else ""
        return PressResult(state, touch, tactile, no_image, translations, steps)

    def _sensors_for(self, state: PressState) -> SensorPair:
        digit, cyskin, before = self._sensors.digit, self._sensors.cyskin, self._made_for
        if state.calibration != before.calibration:
            digit = replace(digit, calibration=state.calibration)
        if (state.layout, state.imperfections) != (before.layout, before.imperfections):
            cyskin = replace(cyskin, layout_source=state.layout, imperfections=state.imperfections)
        self._sensors, self._made_for = SensorPair(digit, cyskin), state
        return self._sensors

    def _background_of(self, digit: Digit) -> np.ndarray:
        """The frame of a DIGIT with nothing touching it; kept while the DIGIT stays."""
        if self._background is None or self._background[0] is not digit:
            self._background = (digit, digit.untouched())
        return self._background[1]

    def _phi_of(self, cyskin: CySkin) -> Phi | T2TwinError:
        """phi of an array, or why it has none; kept while the array stays."""
        if self._phi is None or self._phi[0] is not cyskin:
            try:
                self._phi = (cyskin, Phi(cyskin.layout.x_mm, cyskin.layout.y_mm))
            except T2TwinError as error:
                self._phi = (cyskin, error)
        return self._phi[1]
