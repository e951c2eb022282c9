"""The transducer of a taxel: from the mean pressure on its pad to a signal, and to counts."""

from typing import Annotated, Literal

import numpy as np
from msgspec import Meta, Struct

from t2twin.core.errors import T2TwinError

MAX_BITS = 16
"""Largest number of bits of a count."""


class TransducerTable(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The law of a taxel.

    capacitive: strain m (1 - exp(-p / (M m))) of a dielectric of modulus M and largest strain m.
    The signal is strain / (1 - strain), the relative increase of the capacitance of parallel plates
    (Schmitz et al. 2011). piezoresistive: the conductance a p / (1 + b p), which saturates.
    """

    law: Annotated[Literal["capacitive", "piezoresistive"], Meta(description="law of the signal")]
    modulus_mpa: Annotated[
        float | None, Meta(description="capacitive: small-strain modulus of the dielectric")
    ] = None
    largest_strain: Annotated[
        float | None, Meta(description="capacitive: largest strain of the dielectric")
    ] = None
    a_per_kpa: Annotated[
        float | None, Meta(description="piezoresistive: slope of the conductance at no pressure")
    ] = None
    b_per_kpa: Annotated[
        float | None, Meta(description="piezoresistive: pressure that halves the slope, inverted")
    ] = None

    def __post_init__(self) -> None:
        limits = {
            "capacitive": {"modulus_mpa": (0.001, 1e3), "largest_strain": (0.01, 0.95)},
            "piezoresistive": {"a_per_kpa": (1e-6, 1e3), "b_per_kpa": (0.0, 1e3)},
        }
        for law, names in limits.items():
            for name, (low, high) in names.items():
                value = getattr(self, name)
                if law != self.law and value is not None:
                    raise T2TwinError(f"{name} is not of the law {self.law}; leave it out")
                if law == self.law and (value is None or not low <= value <= high):
                    given = "missing" if value is None else f"{value:g}"
                    raise T2TwinError(
                        f"{name} is {given}; the law {law} needs it, from {low:g} to {high:g}"
                    )

    def signal(self, pressure_mpa: np.ndarray) -> np.ndarray:
        """The signal of pressures, same shape; 0 where there is none."""
        pressed = np.maximum(pressure_mpa, 0.0)
        if self.law == "piezoresistive":
            assert self.a_per_kpa is not None and self.b_per_kpa is not None
            pressed = 1e3 * pressed
            return self.a_per_kpa * pressed / (1.0 + self.b_per_kpa * pressed)
        assert self.modulus_mpa is not None and self.largest_strain is not None
        limit = self.largest_strain
        strain = -limit * np.expm1(-pressed / (self.modulus_mpa * limit))
        return strain / (1.0 - strain)


class CountsTable(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The counts that are read."""

    gain: Annotated[float, Meta(gt=0.0, le=1e9, description="counts for a signal of 1")]
    full_scale: Annotated[
        int, Meta(ge=2, le=2**MAX_BITS - 1, description="count at which a taxel saturates")
    ]
    bits: Annotated[int, Meta(ge=2, le=MAX_BITS, description="bits of a count")]
    rate_hz: Annotated[float, Meta(gt=0.0, le=1e4, description="readings per second")]
    readings: Annotated[
        int, Meta(ge=1, le=10_000, description="readings averaged for the counts of a press")
    ] = 1

    def __post_init__(self) -> None:
        if self.full_scale >= 2**self.bits:
            raise T2TwinError(
                f"full_scale is {self.full_scale}; {self.bits} bits hold at most {2**self.bits - 1}"
            )

    @property
    def sample_s(self) -> float:
        """Duration of the averaged readings, s."""
        return self.readings / self.rate_hz
