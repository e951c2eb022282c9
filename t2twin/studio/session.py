"""The studio's core: presses both sensors and translates the image, for one client.

It has no part of the web page. Shape letters: R rows and C columns of a tactile image.
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
from t2twin.sim.touch import Touch
from t2twin.studio.press_state import PressState
from t2twin.studio.translators import Translation, Translators
from t2twin.twin import load_shape, press_command

TRANSLATING = "translate"
"""Step of the translators, next to the stages of t2twin.sim.sensors.SensorPair.press."""

STEPS = ("press digit", "picture", "press cyskin", "taxels", "tactile image", TRANSLATING)
"""Steps of a press, in their order."""

_catalogue_lock = Lock()
"""Held while a shape of the catalogue is loaded, so that two sessions do not build the same one."""


@dataclass(frozen=True)
class PressResult:
    """The results of one press.

    tactile_image: (R, C) float32, counts; None for a layout without one, for the reason `no_image`.
    steps_ms: milliseconds of each of STEPS.
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
    """One client's shape and sensors; a press rebuilds only those that changed.

    sensors: the default ones, which sessions may share. Not thread-safe.
    """

    def __init__(self, translators: Translators, sensors: SensorPair | None = None) -> None:
        self.translators = translators
        self._sensors = sensors or SensorPair()
        self._made_for = PressState()
        self._shape: tuple[tuple[str, float | None], Shape] | None = None
        self._background: tuple[Digit, np.ndarray] | None = None
        self._phi: tuple[CySkin, Phi | T2TwinError] | None = None

    def shape(self, state: PressState) -> Shape:
        """The shape of a press. Raises T2TwinError as load_shape does."""
        source = (state.shape, state.scale)
        if self._shape is None or self._shape[0] != source:
            with _catalogue_lock if state.shape in catalogue.NAMES else nullcontext():
                self._shape = (source, load_shape(*source))
        return self._shape[1]

    def press(self, state: PressState, runs: tuple[str, ...] = ()) -> PressResult:
        """Press, and translate the image with the runs of these names.

        Raises T2TwinError with the messages of `t2twin press`.
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

        touch = sensors.press(shape, command, rng, timed)
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
        """The background frame of a DIGIT, cached for the last DIGIT."""
        if self._background is None or self._background[0] is not digit:
            self._background = (digit, digit.background_frame())
        return self._background[1]

    def _phi_of(self, cyskin: CySkin) -> Phi | T2TwinError:
        """phi of an array, or the reason why it has none, cached for the last array."""
        if self._phi is None or self._phi[0] is not cyskin:
            try:
                self._phi = (cyskin, Phi(cyskin.layout.x_mm, cyskin.layout.y_mm))
            except T2TwinError as error:
                self._phi = (cyskin, error)
        return self._phi[1]
