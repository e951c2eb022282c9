"""Tangential contact against closed forms, and spectra of the layer against tamaas.

The contacts have radius 1 mm, the pressure of Hertz with a peak of 1 MPa, and lie on a layer so
thick that it is a half-space. tamaas (Frérot et al., Journal of Open Source Software 5, 2020) is an
independent half-space.
"""

from importlib import import_module
from typing import Any

import numpy as np
from scipy import integrate, special

from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.closed_forms import shear_kernels, spectra
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.friction import solve_traction
from t2twin.sim.contact.layer import DomedLayer, WindowTransforms

YOUNG_MPA, THICK_MM = 1.0, 200.0

FRICTION = 0.5

SAMPLES = 6
"""Points per side of a cell over which a pressure is averaged."""

FORCE_N = 2 / 3 * np.pi
"""Force of a pressure of Hertz with radius 1 mm and a peak of 1 MPa."""


class Contact:
    """A layer, and a circular contact of radius 1 mm on a grid of pitch_mm."""

    def __init__(self, poisson: float, pitch_mm: float, thickness_mm: float = THICK_MM) -> None:
        self.pitch_mm = pitch_mm
        self.shear_mpa = YOUNG_MPA / 2 / (1 + poisson)
        n = 2 * int(1.05 / pitch_mm + 1)
        axis = (np.arange(n) - (n - 1) / 2) * pitch_mm
        self.x, self.y = np.meshgrid(axis, axis)
        elastomer = Elastomer("test", thickness_mm, YOUNG_MPA, poisson, 20.0, 20.0, law="linear")
        kernels = shear_kernels(elastomer, thickness_mm, *self.x.shape, pitch_mm)
        self.layer = WindowTransforms(kernels, odd=2)
        self.response = DomedLayer(self.layer, None, np.zeros(self.x.shape))

    def hertz(self, radius_mm: float = 1.0) -> np.ndarray:
        """Cell means of sqrt(1 - (r / radius)^2)."""
        offsets = ((np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5) * self.pitch_mm
        squares = ((self.x + u) ** 2 + (self.y + v) ** 2 for u in offsets for v in offsets)
        fields = [np.sqrt(np.maximum(0.0, 1 - r2 / radius_mm**2)) for r2 in squares]
        return np.mean(fields, axis=0)

    def solve(self, limit_mpa: np.ndarray, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
        """(2, rows, columns) traction for a wanted displacement, from none."""
        wanted = np.stack(np.broadcast_arrays(x_mm, y_mm, self.x)[:2])
        return solve_traction(self.layer, limit_mpa, wanted, np.zeros_like(wanted))[0]

    def integral(self, field: np.ndarray) -> float:
        return float(field.sum() * self.pitch_mm**2)


def stick_radius_mm(contact: Contact, q_mpa: np.ndarray, limit_mpa: np.ndarray) -> float:
    sticks = np.hypot(*q_mpa) < limit_mpa * (1 - 1e-3)
    return float(np.sqrt(contact.integral(sticks) / np.pi))


def pushed_ball(poisson: float, share: float, pitch_mm: float) -> dict[str, float]:
    """Cattaneo 1938, Mindlin 1949: a ball pushed with a share of the friction limit.

    Errors of traction (L2), stick radius, and tangential force at the closed form's displacement.
    The closed form neglects the traction across the push, which is 0 for a Poisson's ratio of 0.
    """
    contact = Contact(poisson, pitch_mm)
    pressure, stick = contact.hertz(), (1 - share) ** (1 / 3)
    full_mm = 3 * FRICTION * FORCE_N * (2 - poisson) / (16 * contact.shear_mpa)
    q_mpa = contact.solve(FRICTION * pressure, np.array(full_mm * (1 - stick**2)), np.array(0.0))
    expected = FRICTION * (pressure - stick * contact.hertz(stick))
    radius = stick_radius_mm(contact, q_mpa, FRICTION * pressure)
    return {
        "traction_error": distance(q_mpa[0], expected),
        "stick_radius_error": radius / stick - 1,
        "compliance_error": contact.integral(q_mpa[0]) / (share * FRICTION * FORCE_N) - 1,
    }


def torsion(stick: float, friction_mpa: float, shear_mpa: float) -> tuple[float, float]:
    """Rotation, rad, and torque, N mm, at which a ball sticks within a share of the contact's
    radius of 1 mm; friction_mpa is friction times the peak pressure (Lubkin 1951, Jaeger 1995).

    A disc of radius s that turns by b has the traction 4 G b r / (pi sqrt(s^2 - r^2)) and the
    torque 16 G s^3 b / 3 (Reissner and Sagoci 1944). Discs of all radii s from the stick radius c
    to 1, each turned by phi(s) ds, displace r < c as one body. Their traction is the friction
    limit on r > c if phi = -(f / 2 G) d/ds [K(k) - E(k)], k^2 = 1 - s^2 (Abel's equation; K and E
    are complete elliptic integrals, f is friction_mpa). The integrals of phi and of the torques
    follow, the latter by parts.
    """

    def turned(s: float) -> float:
        return float(special.ellipkm1(s**2) - special.ellipe(1 - s**2))

    rest = integrate.quad(lambda s: s**2 * turned(s), stick, 1.0)[0]
    torque = 8 / 3 * friction_mpa * (stick**3 * turned(stick) + 3 * rest)
    return friction_mpa / (2 * shear_mpa) * turned(stick), torque


def twisted_ball(stick: float, pitch_mm: float) -> dict[str, float]:
    """A ball twisted until it sticks within this share of the contact radius; see `torsion`."""
    contact = Contact(0.3, pitch_mm)
    limit = FRICTION * contact.hertz()
    angle, torque = torsion(stick, FRICTION, contact.shear_mpa)
    q = contact.solve(limit, -angle * contact.y, angle * contact.x)
    return {
        "torque_error": contact.integral(contact.x * q[1] - contact.y * q[0]) / torque - 1,
        "stick_radius_error": stick_radius_mm(contact, q, limit) / stick - 1,
    }


TOP = 0.8
"""Share of the friction limit at which a loop turns."""

BRANCHES = {
    "loading": (1, 0.0, (0.3, 0.6, TOP)),
    "unloading": (-1, TOP, (0.6, 0.2, -0.4, -TOP)),
    "reloading": (1, -TOP, (-0.2, 0.5, TOP)),
}
"""Direction, share of the friction limit at the start, and shares on the way."""


def loop(pitch_mm: float) -> dict[str, float]:
    """Mindlin and Deresiewicz 1953: a ball is pushed forth, back, and forth again.

    Each later branch is the first loading, doubled. Errors of force on each branch and of the
    closed loop's traction are over the friction limit and the traction.
    """
    contact, moved_mm, found = Contact(0.0, pitch_mm), 0.0, {}
    limit = FRICTION * contact.hertz()
    full_mm = 3 * FRICTION * FORCE_N * 2 / (16 * contact.shear_mpa)
    q, work, top = np.zeros((2, *limit.shape)), [], np.zeros(())
    for name, (sign, start, shares) in BRANCHES.items():
        times, origin_mm, off = (1 if name == "loading" else 2), moved_mm, []
        for share in shares:
            part = 1 - (1 - abs(share - start) / times) ** (2 / 3)
            to_mm = origin_mm + sign * times * part * full_mm
            wanted = contact.response.response_mm(q)[:2]
            wanted[0] += to_mm - moved_mm
            q, by_traction_mm, _ = solve_traction(contact.layer, limit, wanted, q)
            slip_mm = (wanted - by_traction_mm) * (limit > 0)
            work.append(contact.integral((slip_mm * q).sum(axis=0)))
            moved_mm = to_mm
            off.append(abs(contact.integral(q[0]) / (FRICTION * FORCE_N) - share))
        found[f"{name}_error"] = max(off)
        top = q if name == "loading" else top
    return found | {
        "closed_loop_error": distance(q, top),
        "least_work_share": min(work) / sum(work),
    }


def stuck_punches(pitch_mm: float) -> dict[str, float]:
    """A stuck disc on a thick layer, 8 G a / (2 - nu) (Mindlin 1949), and in the middle of a disc
    on a thin one, G / h a unit of area."""
    poisson, thin_mm = 0.47, 0.1
    thick, thin = Contact(poisson, pitch_mm), Contact(poisson, pitch_mm, thin_mm)
    radius = np.hypot(thick.x, thick.y)
    limit, one, zero = np.where(radius <= 1, 1e6, 0.0), np.array(1.0), np.array(0.0)
    force = thick.integral(thick.solve(limit, one, zero)[0])
    middle = thin.solve(limit, one, zero)[0][radius < 0.5].mean()
    return {
        "thick_error": force / (8 * thick.shear_mpa / (2 - poisson)) - 1,
        "thin_error": float(middle) / (thin.shear_mpa / thin_mm) - 1,
    }


def against_tamaas(poisson: float, n: int = 32, pitch_mm: float = 0.1) -> dict[str, float]:
    """Largest difference of a displacement component by one traction component from tamaas, over
    it, for random tractions on a periodic half-space.

    The tractions have no waves at the Nyquist frequency, where odd spectra have no meaning. The
    layer is as thick as two periods, so that it is a half-space for the longest wave.

    Raises T2TwinError without tamaas.
    """
    try:
        tamaas: Any = import_module("tamaas")
    except ImportError:
        raise T2TwinError("tamaas is not installed; pip install '.[oracle]'") from None
    side, rng = n * pitch_mm, np.random.default_rng(0)
    model = tamaas.Model(tamaas.model_type.surface_2d, [side, side], [n, n])
    model.E, model.nu = YOUNG_MPA, poisson
    response = _response(2 * np.pi * np.fft.fftfreq(n, pitch_mm), 2 * side, poisson)
    found = {}
    for j, source in enumerate("xyz"):
        values = np.zeros((n, n, 3))
        wave = np.fft.fft2(rng.normal(size=(n, n)))
        wave[n // 2], wave[:, n // 2] = 0.0, 0.0
        values[..., j] = np.fft.ifft2(wave).real
        model.traction[:] = values
        model.solveNeumann()
        given = np.array(model.displacement)
        ours = np.fft.ifft2(response[..., j] * wave[..., None], axes=(0, 1)).real
        for i, target in enumerate("xyz"):
            size = np.linalg.norm(given[..., i]) or np.linalg.norm(given)
            found[target + source] = float(np.linalg.norm((ours - given)[..., i]) / size)
    return found


def _response(k: np.ndarray, thickness_mm: float, poisson: float) -> np.ndarray:
    """(n, n, 3, 3) displacement by traction along x, y and into the layer; axes are x, y."""
    kx, ky = np.meshgrid(k, k, indexing="ij")
    radius = np.maximum(np.hypot(kx, ky), 1e-9)
    layer = spectra(radius, thickness_mm, YOUNG_MPA, poisson)
    e = np.stack([kx, ky], axis=-1) / radius[..., None]
    along = e[..., :, None] * e[..., None, :]
    found = np.zeros((*kx.shape, 3, 3), complex)
    found[..., :2, :2] = layer.longitudinal[..., None, None] * along
    found[..., :2, :2] += layer.transverse[..., None, None] * (np.eye(2) - along)
    found[..., 2, :2] = 1j * layer.coupling[..., None] * e
    found[..., :2, 2] = -found[..., 2, :2]
    found[..., 2, 2] = layer.normal
    found[0, 0] = 0.0
    return found


def distance(given: np.ndarray, expected: np.ndarray) -> float:
    """Relative L2 distance."""
    return float(np.linalg.norm(given - expected) / np.linalg.norm(expected))


def largest(rows: list[dict[str, float]]) -> dict[str, float]:
    """The largest magnitude of each error."""
    return {key: max(abs(row[key]) for row in rows) for key in rows[0]}
