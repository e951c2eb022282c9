"""What is assumed, and what the page is not good for."""

import numpy as np

from t2twin.report.data import ReportData
from t2twin.report.html import markup
from t2twin.report.html.labels import forces_in_words
from t2twin.sim.cyskin.taxels import DIELECTRIC_MODULUS_MPA
from t2twin.sim.dataset.info import Parameters
from t2twin.sim.dataset.store import sha256_of
from t2twin.sim.digit.calibration import DEFAULT_PATH

IMPORTED = [
    "How the pairs were taken, and how exactly a picture and its counts are of one touch, is for "
    "their owner to say; no part of an error can be laid to it here.",
    "Where a split has presses of shapes that training saw, as one drawn at random has, its errors "
    "say little of other shapes.",
    "The results hold for these two sensors. Another gel, another light or another array is "
    "another task.",
]


def section(report: ReportData) -> str:
    """A short list; figures of a simulated dataset are read from its info.json."""
    parameters = report.info.parameters
    said = IMPORTED if parameters is None else limits(parameters, report.forces_n)
    return markup.section(
        "limits", "What is assumed, and what this is not good for", [markup.items(said)]
    )


def limits(parameters: Parameters, forces_n: np.ndarray) -> list[str]:
    """One sentence or two each. parameters: what the dataset was simulated with. forces_n: (k,)
    its different forces, N, 0 for presses that touch nothing."""
    one_force = np.count_nonzero(forces_n) == 1
    named = f"{'one commanded force' if one_force else 'forces'} ({forces_in_words(forces_n)})"
    gel, skin = parameters.digit, parameters.cyskin
    pads = sorted(set(skin.pad_diameter_mm))
    return [
        f"Assumed, because nobody has published them: the gel's modulus ({gel.young_mpa:g} MPa) "
        f"and Poisson's ratio ({gel.poisson:g}); the skin's cover "
        f"({skin.thickness_mm:g} mm, {skin.young_mpa:g} MPa), its taxels' pads "
        f"({', '.join(f'{pad:g}' for pad in pads)} mm across), the dielectric under them "
        f"({DIELECTRIC_MODULUS_MPA:g} MPa), the counts per pressure, and the layout of the taxels.",
        "Contact is frictionless and quasi-static: a shape goes straight in and rests. There is no "
        "sliding, shear, twist, adhesion or creep.",
        "The elastomer is a linear layer bonded to a rigid base, laterally unbounded, whose "
        "deflection then stiffens as that of a neo-Hookean solid, so that no press goes through. "
        "That is an effective law and was not fitted to the real materials.",
        calibration(gel.calibration_sha256),
        f"Every result is on simulated data, with one sensor of each kind and {named}. It "
        "says which method copes with this problem, not how many counts either will be off on "
        "hardware.",
        "Validation and test pictures come from the same simulated sensor as the training "
        "pictures; two real sensors differ more than that.",
    ]


def calibration(sha256: str) -> str:
    """Whose DIGIT the pictures look like. sha256: of the calibration that they were made with."""
    if sha256 == sha256_of(DEFAULT_PATH):
        return (
            "The DIGIT's pictures come from a fast model calibrated on a pyrender reference, not "
            "on your sensor. Calibrate it from your own background and ball presses before you "
            "carry anything over to a real DIGIT."
        )
    return (
        f"The DIGIT's pictures come from a fast model with a calibration of its own (SHA-256 "
        f"{sha256[:12]}), not the one that t2twin ships. `t2twin calibrate` says how near that "
        "model comes to frames of the sensor that were held out. It holds for that sensor alone."
    )
