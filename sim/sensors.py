"""Both simulated sensors, and the one way in which anything is pressed into them."""

import hashlib
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad.shape import Shape
from t2twin.sim.contact.contact_solver import (
    CYSKIN_PITCH_MM,
    DIGIT_PITCH_MM,
    solve_contact,
    surface_on,
)
from t2twin.sim.contact.elastomer import CYSKIN_COVER, DIGIT_GEL, Elastomer
from t2twin.sim.contact.types import Contact, PressCommand
from t2twin.sim.cyskin import reading, taxels
from t2twin.sim.cyskin.layout import DEFAULT_LAYOUT, Layout, load_layout
from t2twin.sim.digit.calibration import DEFAULT_PATH, Calibration
from t2twin.sim.digit.camera.pinhole import optical_grid
from t2twin.sim.digit.light.leds import DIGIT_LEDS
from t2twin.sim.digit.optics import FRAMES, NOISE_GREY, DigitOptics
from t2twin.sim.digit.randomization.unit import Unit
from t2twin.sim.digit.rendered import RenderedOptics

Renderer = Literal["baked", "pyrender"]
"""What makes the DIGIT's pictures: the baked model, in milliseconds, or pyrender itself, in about
t2twin.sim.digit.rendered.FRAME_SECONDS."""

Timed = Callable[[str], AbstractContextManager[None]]
"""Wraps the stages of a press, named as in t2twin.sim.dataset.timing.STAGES."""


def _untimed(stage: str) -> AbstractContextManager[None]:
    return nullcontext()


@dataclass(frozen=True)
class DigitTouch:
    """What a press did to the DIGIT. image: (320, 240, 3) uint8. calibration: the file with the
    light that it is in, None for the one that ships. renderer: what made the image."""

    contact: Contact
    image: np.ndarray
    calibration: str | None
    renderer: Renderer = "baked"


@dataclass(frozen=True)
class CySkinTouch:
    """What a press did to the CySkin. counts: (n,) uint16, one for each taxel of the layout."""

    contact: Contact
    counts: np.ndarray
    layout: Layout


@dataclass(frozen=True)
class Digit:
    """A DIGIT: its gel, its optics' calibration file (None: the one that ships), its noise.

    renderer: what makes its pictures. unit: a drawn light, which is taken instead of the file's.
    elastomer: what is pressed into: the gel, of the modulus that the calibration was fitted, where
    it was and the gel is not one of another modulus or law than the DIGIT's.
    Raises T2TwinError for a file that is no calibration, and for pyrender where it has no LEDs to
    render: a calibration's are known by their response only.
    """

    gel: Elastomer = DIGIT_GEL
    pitch_mm: float = DIGIT_PITCH_MM
    calibration: str | None = None
    noise_grey: float = NOISE_GREY / np.sqrt(FRAMES)
    renderer: Renderer = "baked"
    unit: Unit | None = field(default=None, repr=False)
    optics: DigitOptics | RenderedOptics = field(init=False, repr=False, compare=False)
    elastomer: Elastomer = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        arguments.instance(self.gel, "gel", Elastomer)
        arguments.choice(self.renderer, "optics", get_args(Renderer))
        light = self.unit.calibration if self.unit else Calibration.load(self._file)
        object.__setattr__(self, "optics", self._optics(light))
        object.__setattr__(self, "elastomer", self._elastomer(light))

    def _optics(self, light: Calibration) -> DigitOptics | RenderedOptics:
        if self.renderer == "baked":
            return DigitOptics(light, gel=self.gel)
        if self.unit is None and self.calibration is None:
            return RenderedOptics(light, DIGIT_LEDS, self.gel)
        if self.unit is None or self.unit.leds is None:
            raise T2TwinError(
                "pyrender cannot render a calibration file's light, which is not known LED by LED; "
                "it renders the light that ships and units drawn without a calibration"
            )
        return RenderedOptics(light, self.unit.leds, self.gel)

    def _elastomer(self, light: Calibration) -> Elastomer:
        assumed = (DIGIT_GEL.young_mpa, DIGIT_GEL.law)
        if light.young_mpa is None or (self.gel.young_mpa, self.gel.law) != assumed:
            return self.gel
        return replace(self.gel, young_mpa=light.young_mpa)

    def with_unit(self, unit: Unit) -> "Digit":
        """The same gel, pitch and renderer under the light of a drawn unit, with its noise, of
        which as much is averaged away as of this one's."""
        noise_grey = unit.noise_grey * self.noise_grey / NOISE_GREY
        return replace(self, unit=unit, noise_grey=float(noise_grey))

    def untouched(self, rng: np.random.Generator | None = None) -> np.ndarray:
        """The image of the untouched gel, (320, 240, 3) uint8; with camera noise where rng is
        given."""
        x, y = optical_grid(self.gel)
        surface = np.zeros((y.size, x.size))
        return self.optics.render(surface, rng=rng, noise_grey=self.noise_grey)

    @property
    def _file(self) -> Path:
        return DEFAULT_PATH if self.calibration is None else Path(self.calibration)

    @property
    def calibration_sha256(self) -> str:
        return hashlib.sha256(self._file.read_bytes()).hexdigest()

    def press(self, shape: Shape, command: PressCommand) -> Contact:
        """The contact of a shape with the gel. Raises T2TwinError as solve_contact does."""
        return solve_contact(shape, command, self.elastomer, self.pitch_mm)

    def image(self, contact: Contact, rng: np.random.Generator | None = None) -> np.ndarray:
        """The image of a contact, (320, 240, 3) uint8; with camera noise where rng is given."""
        surface = surface_on(contact, *optical_grid())
        return self.optics.render(surface, rng=rng, noise_grey=self.noise_grey)

    def touch(
        self,
        shape: Shape,
        command: PressCommand,
        rng: np.random.Generator | None = None,
        timed: Timed = _untimed,
    ) -> DigitTouch:
        """Both: the contact, and its image."""
        with timed("press digit"):
            contact = self.press(shape, command)
            _ = contact.surface_mm  # which the picture needs
        with timed("picture"):
            return DigitTouch(contact, self.image(contact, rng), self.calibration, self.renderer)


@dataclass(frozen=True)
class CySkin:
    """A CySkin: its cover, its taxels (a layout's name or file), how imperfect it is."""

    cover: Elastomer = CYSKIN_COVER
    pitch_mm: float = CYSKIN_PITCH_MM
    layout_source: str = DEFAULT_LAYOUT
    imperfections: str = "white"
    dead: tuple[int, ...] = ()
    layout: Layout = field(init=False, repr=False, compare=False)
    flaws: reading.Imperfections = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        arguments.instance(self.cover, "cover", Elastomer)
        object.__setattr__(self, "layout", load_layout(self.layout_source))
        object.__setattr__(
            self, "flaws", reading.imperfections(self.imperfections, tuple(self.dead))
        )
        self.flaws.check_dead(self.layout.size)

    def press(self, shape: Shape, command: PressCommand) -> Contact:
        """The contact of a shape with the cover. Raises T2TwinError as solve_contact does."""
        return solve_contact(shape, command, self.cover, self.pitch_mm)

    def counts(self, contact: Contact, rng: np.random.Generator | None = None) -> np.ndarray:
        """The counts of a contact, (n,) uint16; with imperfections where rng is given.

        Raises T2TwinError for a layout that reaches beyond the cover.
        """
        true = taxels.counts(taxels.pad_pressure_mpa(contact, self.layout))
        if rng is None:
            return np.rint(true).astype(np.uint16)
        return reading.read(true, self.layout, self.flaws, rng)

    def untouched(self, rng: np.random.Generator | None = None) -> np.ndarray:
        """What it counts while nothing touches it, (n,) uint16."""
        nothing = np.zeros(self.layout.size)
        if rng is None:
            return nothing.astype(np.uint16)
        return reading.read(nothing, self.layout, self.flaws, rng)

    def touch(
        self,
        shape: Shape,
        command: PressCommand,
        rng: np.random.Generator | None = None,
        timed: Timed = _untimed,
    ) -> CySkinTouch:
        """Both: the contact, and its counts."""
        with timed("press cyskin"):
            contact = self.press(shape, command)
        with timed("taxels"):
            return CySkinTouch(contact, self.counts(contact, rng), self.layout)


@dataclass(frozen=True)
class Sample:
    """One pair: the same press seen by the DIGIT and felt by the CySkin.

    image: (320, 240, 3) uint8. counts: (20,) uint16, or as many taxels as the layout has.
    """

    command: PressCommand
    image: np.ndarray
    counts: np.ndarray
    digit: Contact
    cyskin: Contact


@dataclass(frozen=True)
class SensorPair:
    """Both sensors side by side, touched by the same shape in the same way."""

    digit: Digit = field(default_factory=Digit)
    cyskin: CySkin = field(default_factory=CySkin)

    def press(
        self,
        shape: Shape,
        command: PressCommand,
        rng: np.random.Generator | None = None,
        timed: Timed = _untimed,
    ) -> Sample:
        """One pair.

        rng: noise and imperfections are drawn from it, the DIGIT's first; none without.
        Raises T2TwinError where either sensor does.
        """
        seen = self.digit.touch(shape, command, rng, timed)
        felt = self.cyskin.touch(shape, command, rng, timed)
        return Sample(command, seen.image, felt.counts, seen.contact, felt.contact)
