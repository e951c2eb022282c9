"""Assumptions and limitations."""

import numpy as np

from t2twin.report.data import ReportData
from t2twin.report.html import markup
from t2twin.report.html.labels import forces_text
from t2twin.sim.cyskin.taxels import DIELECTRIC_MODULUS_MPA
from t2twin.sim.dataset.info import Parameters
from t2twin.sim.dataset.store import sha256_of
from t2twin.sim.digit.calibration import DEFAULT_PATH

IMPORTED = [
    "The accuracy of the measurement, and the correspondence of an image and its counts, are "
    "unknown; their contribution to the errors cannot be separated.",
    "If a split contains shapes of the training split, as random splits do, its errors do not "
    "indicate those on other shapes.",
    "The results hold for these two sensors. Another gel, light or array requires another "
    "training.",
]


def section(report: ReportData) -> str:
    """List of assumptions and limitations."""
    parameters = report.info.parameters
    texts = IMPORTED if parameters is None else limits(parameters, report.forces_n)
    return markup.section("limits", "Assumptions and limitations", [markup.items(texts)])


def limits(parameters: Parameters, forces_n: np.ndarray) -> list[str]:
    """Assumptions and limitations of a simulated dataset.

    forces_n: (k,) unique forces, N, 0 for presses without contact.
    """
    one_force = np.count_nonzero(forces_n) == 1
    forces = f"{'one commanded force' if one_force else 'forces'} ({forces_text(forces_n)})"
    gel, skin = parameters.digit, parameters.cyskin
    pads = sorted(set(skin.pad_diameter_mm))
    return [
        f"Assumed, without published values: the gel's modulus ({gel.young_mpa:g} MPa) and "
        f"Poisson's ratio ({gel.poisson:g}); the CySkin's cover ({skin.thickness_mm:g} mm, "
        f"{skin.young_mpa:g} MPa), the diameter of its pads "
        f"({', '.join(f'{pad:g}' for pad in pads)} mm), the dielectric under them "
        f"({DIELECTRIC_MODULUS_MPA:g} MPa), the counts per pressure, and the layout of the taxels.",
        "Contact is frictionless and quasi-static: a shape is pressed along the normal. There is "
        "no sliding, shear, torsion, adhesion or creep.",
        "The elastomer is a linear layer, bonded to a rigid base and laterally unbounded. Its "
        "deflection stiffens like that of a neo-Hookean solid, which limits the depth. This is an "
        "effective law that was not fitted to the real materials.",
        calibration(gel.calibration_sha256),
        f"All results are on simulated data, with one sensor of each kind and {forces}. They "
        "compare methods; they do not predict the error on hardware.",
        "Validation and test images come from the same simulated sensor as the training images; "
        "two real sensors differ more.",
    ]


def calibration(sha256: str) -> str:
    """Origin of the optics. sha256: of the calibration of the dataset."""
    if sha256 == sha256_of(DEFAULT_PATH):
        return (
            "The DIGIT images come from a fast model, calibrated on a pyrender reference, not on "
            "your sensor. Before a transfer to a real DIGIT, calibrate it with a background frame "
            "and ball presses of that sensor."
        )
    return (
        f"The DIGIT images come from a fast model with a custom calibration (SHA-256 "
        f"{sha256[:12]}). `t2twin calibrate` reports its accuracy on held-out frames of the "
        "sensor. It is valid for that sensor only."
    )
