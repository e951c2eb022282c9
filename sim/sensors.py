"""The simulated DIGIT and CySkin, and the press of one shape into both."""

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
)
from t2twin.sim.contact.elastomer import CYSKIN_COVER, DIGIT_GEL, Elastomer
from t2twin.sim.contact.layer import cached_layer
from t2twin.sim.contact.pin_layout import Survey
from t2twin.sim.contact.sliding import COVER_FRICTION, GEL_FRICTION, advance
from t2twin.sim.contact.types import Contact, PressCommand
from t2twin.sim.optical.camera.pinhole import optical_grid
from t2twin.sim.optical.image_renderer import FRAMES, NOISE_GREY, ImageRenderer, Renderer
from t2twin.sim.optical.light.leds import DIGIT_LEDS
from t2twin.sim.optical.markers import Markers, surface_shift
from t2twin.sim.optical.optics import DEFAULT_PATH, Optics
from t2twin.sim.optical.pyrender_renderer import PyrenderRenderer
from t2twin.sim.optical.randomization.unit import Unit
from t2twin.sim.optical.surface import surface_on
from t2twin.sim.taxels import pads, reading
from t2twin.sim.taxels.layout import DEFAULT_LAYOUT, Layout, load_layout
from t2twin.sim.touch import Touch

Sensor = Literal["both", "digit", "cyskin"]

StageTimer = Callable[[str], AbstractContextManager[None]]
"""Context manager around each stage of a press, named as in t2twin.sim.dataset.timing.STAGES."""


def _untimed(stage: str) -> AbstractContextManager[None]:
    return nullcontext()


@dataclass(frozen=True)
class Digit:
    """A DIGIT: its gel, its light, its camera noise, its markers.

    optics_file: file of the light, None for the default optics. renderer: what makes the
    images. unit: a sampled unit, whose light replaces the file's. markers: printed on the gel; None
    for none. elastomer: the gel that is pressed. It has the optics file's Young's modulus, if the
    file has one and `gel` has the default modulus and law.

    Raises T2TwinError for a file that is not an optics file, and for renderer "pyrender" with an
    optics file, which has no LEDs to render.
    """

    gel: Elastomer = DIGIT_GEL
    pitch_mm: float = DIGIT_PITCH_MM
    optics_file: str | None = None
    noise_grey: float = NOISE_GREY / np.sqrt(FRAMES)
    renderer: Renderer = "baked"
    unit: Unit | None = field(default=None, repr=False)
    markers: Markers | None = None
    optics: Optics = field(init=False, repr=False, compare=False)
    image_renderer: ImageRenderer = field(init=False, repr=False, compare=False)
    elastomer: Elastomer = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        arguments.instance(self.gel, "gel", Elastomer)
        arguments.choice(self.renderer, "renderer", get_args(Renderer))
        if self.markers is not None:
            arguments.instance(self.markers, "markers", Markers)
        optics = self.unit.optics if self.unit else Optics.load(self._file)
        object.__setattr__(self, "optics", optics)
        object.__setattr__(self, "image_renderer", self._image_renderer(optics))
        object.__setattr__(self, "elastomer", self._elastomer(optics))

    def _image_renderer(self, optics: Optics) -> ImageRenderer:
        if self.renderer == "baked":
            return ImageRenderer(optics, gel=self.gel, markers=self.markers)
        of_file = DIGIT_LEDS if self.optics_file is None else None
        leds = of_file if self.unit is None else self.unit.leds
        if leds is None:
            raise T2TwinError(
                "pyrender cannot render an optics file, which has no description of single "
                "LEDs; it renders the default optics and units sampled without an optics file"
            )
        return PyrenderRenderer(optics, leds, self.gel, self.markers)

    def _elastomer(self, optics: Optics) -> Elastomer:
        default = (DIGIT_GEL.young_mpa, DIGIT_GEL.law)
        if optics.young_mpa is None or (self.gel.young_mpa, self.gel.law) != default:
            return self.gel
        return replace(self.gel, young_mpa=optics.young_mpa)

    def with_unit(self, unit: Unit) -> "Digit":
        """The same gel, pitch and renderer with the light and noise of a sampled unit.

        The unit's noise is reduced by averaging as much as this sensor's is.
        """
        noise_grey = unit.noise_grey * self.noise_grey / NOISE_GREY
        return replace(self, unit=unit, noise_grey=float(noise_grey))

    @property
    def _file(self) -> Path:
        return DEFAULT_PATH if self.optics_file is None else Path(self.optics_file)

    @property
    def optics_sha256(self) -> str:
        return hashlib.sha256(self._file.read_bytes()).hexdigest()

    def press(self, shape: Shape, command: PressCommand) -> Contact:
        """The contact of a shape with the gel. Raises T2TwinError as solve_contact does."""
        return solve_contact(shape, command, self.elastomer, self.pitch_mm)

    def image(self, contact: Contact | None, rng: np.random.Generator | None = None) -> np.ndarray:
        """(320, 240, 3) uint8: the image of a contact, of None the background frame.

        rng: of the camera noise; None for none.
        """
        if contact is None:
            return self.image_renderer.render(self._flat, rng, self.noise_grey)
        surface = surface_on(contact, *optical_grid())
        shift = None if self.markers is None else surface_shift(contact)
        return self.image_renderer.render(surface, rng, self.noise_grey, shift)

    def background_frame(self, rng: np.random.Generator | None = None) -> np.ndarray:
        """(320, 240, 3) uint8: the image without contact, of a sampled unit before its light
        drifted. rng: as for image."""
        earlier = None if self.unit is None else self.unit.earlier_background
        return self.image_renderer.render(self._flat, rng, self.noise_grey, background=earlier)

    @property
    def _flat(self) -> np.ndarray:
        """The deflection of a gel at rest."""
        x, y = optical_grid(self.gel)
        return np.zeros((y.size, x.size))


@dataclass(frozen=True)
class CySkin:
    """A CySkin: its cover, its taxels (a layout's name or file), its imperfections.

    dead: indices of taxels that always count 0.
    """

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

    def counts(self, contact: Contact | None, rng: np.random.Generator | None = None) -> np.ndarray:
        """(n,) uint16: the counts of a contact; None for no contact.

        rng: of the imperfections; None for none. Raises T2TwinError for a layout that reaches
        beyond the cover.
        """
        return self.read(contact, rng)[0]

    def read(
        self,
        contact: Contact | None,
        rng: np.random.Generator | None = None,
        before: Touch | None = None,
        seconds: float = reading.SAMPLE_S,
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """The counts as by `counts`, and the memory after them (Touch.memory).

        before: the array's sample `seconds` earlier; None for a contact that has lasted long.
        """
        if contact is None:
            noiseless = np.zeros(self.layout.size)
        else:
            noiseless = pads.counts(pads.pad_pressure_mpa(contact, self.layout))
        if rng is None:
            return np.rint(noiseless).astype(np.uint16), None
        memory = self._memory(before)
        return reading.read_after(memory, noiseless, self.layout, self.flaws, rng, seconds=seconds)

    def _memory(self, before: Touch | None) -> np.ndarray | None:
        """The memory of a touch; None for one of another array."""
        if before is None or before.memory is None:
            return None
        own, other = (np.stack([each.x_mm, each.y_mm]) for each in (self.layout, before.layout))
        is_own = np.array_equal(own, other) and len(before.memory) == len(self.flaws.memory_shares)
        return before.memory if is_own else None


@dataclass(frozen=True)
class SensorPair:
    """Both sensors, to be pressed by the same shape with the same command."""

    digit: Digit = field(default_factory=Digit)
    cyskin: CySkin = field(default_factory=CySkin)

    def press(
        self,
        shape: Shape,
        command: PressCommand,
        rng: np.random.Generator | None = None,
        timed: StageTimer = _untimed,
        sensor: Sensor = "both",
        before: Touch | None = None,
    ) -> Touch:
        """Press a shape into both sensors or one of them.

        command: a force of 0 N gives the image and the counts without contact. rng: of the camera
        noise, then of the CySkin's imperfections; None for neither. before: the touch one sample
        earlier, which the CySkin's memory continues; None for none.
        Raises T2TwinError as solve_contact does.
        """
        digit, cyskin, is_contact = self.digit, self.cyskin, command.force_n != 0.0
        image = counts = memory = on_digit = on_cyskin = None
        if sensor != "cyskin":
            with timed("press digit"):
                if is_contact:
                    on_digit = digit.press(shape, command)
                    _ = on_digit.surface_mm  # computed on first access; the image needs it
            with timed("picture"):
                image = digit.image(on_digit, rng)
        if sensor != "digit":
            with timed("press cyskin"):
                if is_contact:
                    on_cyskin = cyskin.press(shape, command)
            with timed("taxels"):
                counts, memory = cyskin.read(on_cyskin, rng, before)
        return Touch(
            shape=shape,
            command=command,
            image=image,
            counts=counts,
            digit=on_digit,
            cyskin=on_cyskin,
            layout=None if sensor == "digit" else cyskin.layout,
            optics=digit.optics_file,
            renderer=digit.renderer,
            markers=None if sensor == "cyskin" else digit.markers,
            memory=memory,
        )

    def check_over_pads(self, touch: Touch, command: PressCommand) -> None:
        """Raises OffPadError if the shape of a touch does not lie over its pads at another pose."""
        for contact in touch.contacts.values():
            Survey(touch.shape, command, cached_layer(contact.elastomer, contact.pitch_mm))

    def advance(self, touch: Touch, command: PressCommand, friction: float | None) -> Touch:
        """Move the shape of a touch by a small step, with friction; without image and counts.

        command: the new pose and force. friction: of both elastomers; None is each one's own.
        Raises T2TwinError as solve_contact does.
        """
        before = touch.command
        motion = (
            command.x_mm - before.x_mm,
            command.y_mm - before.y_mm,
            command.yaw_rad - before.yaw_rad,
            command.force_n,
        )
        own = {"digit": GEL_FRICTION, "cyskin": COVER_FRICTION}
        moved = {
            sensor: advance(contact, *motion, own[sensor] if friction is None else friction)
            for sensor, contact in touch.contacts.items()
        }
        return replace(touch, command=command, image=None, counts=None, **moved)

    def with_readings(
        self, touch: Touch, rng: np.random.Generator | None = None, before: Touch | None = None
    ) -> Touch:
        """The touch with the image and the counts of its contacts; rng, before as for `press`."""
        image = None if touch.digit is None else self.digit.image(touch.digit, rng)
        counts = memory = None
        if touch.cyskin is not None:
            counts, memory = self.cyskin.read(touch.cyskin, rng, before)
        return replace(touch, image=image, counts=counts, memory=memory)
