"""Forces that a field run predicts for frames of a real DIGIT, beside measured ones.

    python -m benchmarks measured_forces FRAMES BACKGROUND

FRAMES is the folder force_estimation/code/test_data of AUROVA-LAB/aurova_tactile_sensing, one press
of the flat end of a printed cylinder, with the force that an array on the opposite finger measured.
BACKGROUND is digit_ros/src/digit_interface/scripts/background.png in the file Tactile_sensing/
Digit_sensor/ForceEstimation/digit_ros.zip of AUROVA-LAB/aurova_grasping, assumed to be of the same
unit. Neither is part of the project. The run is not adapted: `adapt` needs presses of a ball.
"""

from argparse import Namespace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.evidence import Argument, Benchmark, Figure
from t2twin.core.errors import T2TwinError

BENCHMARK = Benchmark(
    module="benchmarks.networks.measured_forces",
    minutes=0.5,
    sources=("sim", "translate"),
    figures=(Figure("*.rmse_n", "N"), Figure("*.slope"), Figure("*.in_distribution")),
    arguments=(
        Argument("frames", "folder of images/N.png and forces/force_N.txt", Path),
        Argument("background", "background frame of the unit", Path),
        Argument(
            "--run", "field run, by default the pretrained one", default="field", partial=True
        ),
    ),
)

PARTS_N = {"all": (0.0, np.inf), "below 5 N": (0.0, 5.0), "above 5 N": (5.0, np.inf)}


def measure(options: Namespace) -> dict[str, Any]:
    from t2twin.sim.calibrate.frames import read_frame
    from t2twin.translate.evaluation.metrics import REPORTED_LEVEL
    from t2twin.translate.inference.estimate import half_width
    from t2twin.translate.inference.load import load_run
    from t2twin.translate.uncertainty.ood import OODClass

    paths = sorted((options.frames / "images").glob("*.png"))
    if not paths:
        raise T2TwinError(
            f"{options.frames} has no images/*.png, which are not part of the project"
        )
    forces = (options.frames / "forces" / f"force_{path.stem}.txt" for path in paths)
    true_n = np.array([float(path.read_text().split()[0]) for path in forces])
    found = load_run(options.run)._classified_estimate(
        [read_frame(path) for path in paths], read_frame(options.background)
    )
    off_n, known = found.force_n - true_n, found.ood_class == OODClass.IN_DISTRIBUTION
    covered = np.abs(off_n) <= half_width(REPORTED_LEVEL) * found.force_std_n
    return {
        name: {
            "frames": int(part.sum()),
            "in_distribution": int(known[part].sum()),
            "rmse_n": float(np.sqrt(np.square(off_n[part]).mean())),
            "mean_error_n": float(off_n[part].mean()),
            "slope": float(found.force_n[part] @ true_n[part] / np.square(true_n[part]).sum()),
            "coverage_percent": 100.0 * float(covered[part].mean()),
        }
        for name, (low, high) in PARTS_N.items()
        if (part := (low <= true_n) & (true_n < high)).any()
    }
