"""How the frames of a unit are stored. Commands import it; it imports nothing that is slow."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from t2twin.core.errors import T2TwinError

if TYPE_CHECKING:
    import numpy as np

TURNS_DEG = (0, 90, 180, 270)  # clockwise rotations of frames


@dataclass(frozen=True)
class FrameOrder:
    """How the files or the camera of a unit store its frames.

    Args:
        turn_deg: Clockwise rotation that makes all frames upright.
        mirror: Left and right are swapped in all frames, once they are rotated.
        bgr: Blue comes before red in all frames.
    """

    turn_deg: Literal[0, 90, 180, 270] = 0
    mirror: bool = False
    bgr: bool = False

    def __post_init__(self) -> None:
        if [*map(type, (self.turn_deg, self.mirror, self.bgr))] != [int, bool, bool]:
            from t2twin.core import arguments  # slow to import

            checks = arguments.whole_number, arguments.flag, arguments.flag
            for (name, value), check in zip([*vars(self).items()], checks, strict=True):
                object.__setattr__(self, name, check(value, name))
        if self.turn_deg not in TURNS_DEG:
            raise T2TwinError(f"turn_deg is {self.turn_deg}; expected one of {TURNS_DEG}")

    def __str__(self) -> str:
        """The options that set it."""
        turn = f"--turn-deg {self.turn_deg}" * (self.turn_deg != 0)
        return " ".join(filter(None, (turn, "--mirror" * self.mirror, "--bgr" * self.bgr)))

    def upright(self, frame: "np.ndarray") -> "np.ndarray":
        """A stored frame, (h, w) or (h, w, 3), upright and with red before blue."""
        import numpy as np

        from t2twin.core import arguments

        frame = arguments.array(frame, "frame")
        if frame.ndim != 2 and frame.shape[2:] != (3,):
            raise T2TwinError(f"frame has shape {frame.shape}; expected (h, w) or (h, w, 3)")
        frame = np.rot90(frame, -self.turn_deg // 90)
        frame = frame[:, ::-1] if self.mirror else frame
        return np.ascontiguousarray(frame[..., ::-1] if self.bgr and frame.ndim == 3 else frame)


UPRIGHT = FrameOrder()
