"""What a touch lacks, and where it is approximate."""

from dataclasses import dataclass
from math import hypot


@dataclass(frozen=True)
class Notice:
    """One cause for which a touch differs from what a physics engine computes.

    body: name of the touching body. reason: a clause that names the cause. force_n: the force on
    the sensor that the contact lacks, along x, y and z of the sensor frame, N; 0 where only the
    shape is approximate.
    """

    body: str
    reason: str
    force_n: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def unread_n(self) -> float:
        """Size of the force that the contact lacks, N."""
        return hypot(*self.force_n)

    def __str__(self) -> str:
        lacking = f"{self.unread_n:.3g} N of {self.body} not read" if self.unread_n else self.body
        return f"{lacking}: {self.reason}"
