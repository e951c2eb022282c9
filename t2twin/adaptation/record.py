"""Files of an adaptation: the fitted optics, its held-out presses, the results, and the page.

optics.npz has the format of `t2twin calibrate`. presses.json contains positions, depths and
scores of the held-out presses, so that an interrupted adaptation resumes without a new fit.
adapted.json contains the results, which index.html shows with images of every held-out press.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from t2twin.adaptation.real_frame_evaluation import (
    MIN_CONTACT_SHARE,
    PressComparison,
    RunScores,
)
from t2twin.core.draw import Panel, panels_image
from t2twin.core.files import write_json
from t2twin.core.records import read_json
from t2twin.core.tables import Table
from t2twin.report.page import write_page
from t2twin.sim.calibrate.calibrate import OpticsReport, write_coverage
from t2twin.sim.calibrate.uncertainty import OpticsUncertainty, uncertainty_table
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.translate.inference.predictor import CountsPredictor

OPTICS, PRESSES, RECORD = "optics.npz", "presses.json", "adapted.json"
COVERAGE = "optics_coverage.png"

FORMAT = 3
"""Format of presses.json."""

TITLE = "Translator adapted to this sensor"


@dataclass(frozen=True)
class HeldOutPress:
    """A held-out press, and scores of its image, simulated with an optics file without it."""

    name: str
    x_mm: float
    y_mm: float
    depth_mm: float
    psnr_db: float
    ssim: float


@dataclass(frozen=True)
class FittedOptics:
    """Content of presses.json.

    inputs_digest: SHA-256 of the frames and numbers of the fit. trained: number of presses of the
    scored fit. psnr_db, ssim: means over the contact crops of the held-out presses.
    uncertainty: ranges of depths and forces.
    """

    format: int
    inputs_digest: str
    ball_diameter_mm: float
    trained: int
    psnr_db: float
    ssim: float
    held_out: tuple[HeldOutPress, ...]
    uncertainty: OpticsUncertainty

    @property
    def poses(self) -> np.ndarray:
        """(n, 3): x_mm, y_mm, depth_mm of the held-out presses."""
        return np.array([(press.x_mm, press.y_mm, press.depth_mm) for press in self.held_out])

    @property
    def diameters_mm(self) -> list[float]:
        """Ball diameters of the held-out presses."""
        diameters = {press.name: press.ball_diameter_mm for press in self.uncertainty.presses}
        return [diameters[press.name] for press in self.held_out]


@dataclass(frozen=True)
class AdaptationResult:
    """Content of adapted.json.

    model: the trained model. kept: name of the more accurate run, TRAINED or INITIAL. runs: scores
    by name; INITIAL, the run that initialized the training, is missing if there is none. presses:
    number of held-out presses. optics_psnr_db, optics_ssim: of the calibrated optics on them.
    zero_rmse_percent, mean_array_rmse_percent: baselines, no counts and the mean array of the
    presses. minutes: by step. uncertainty: ranges of the presses' depths and forces.
    """

    model: str
    kept: str
    runs: dict[str, RunScores]
    presses: int
    optics_psnr_db: float
    optics_ssim: float
    zero_rmse_percent: float
    mean_array_rmse_percent: float
    minutes: dict[str, float]
    uncertainty: OpticsUncertainty

    @property
    def scores(self) -> RunScores:
        """Scores of the kept run."""
        return self.runs[self.kept]


def write_fitted(
    folder: Path, report: OpticsReport, inputs_digest: str, ball_diameter_mm: float, gel: Elastomer
) -> FittedOptics:
    """Writes optics.npz and its coverage, then presses.json; returns the content of the latter.

    report: of an optics file with tolerances. gel: of the sensor.
    """
    assert report.uncertainty is not None
    fitted = FittedOptics(
        format=FORMAT,
        inputs_digest=inputs_digest,
        ball_diameter_mm=ball_diameter_mm,
        trained=len(report.trained),
        psnr_db=report.scores.calibrated.psnr_db,
        ssim=report.scores.calibrated.ssim,
        held_out=tuple(
            HeldOutPress(name, float(x), float(y), float(depth), score.psnr_db, score.ssim)
            for name, (x, y, depth), score in zip(
                report.held_out, report.poses, report.each, strict=True
            )
        ),
        uncertainty=report.uncertainty,
    )
    report.optics.save(folder / OPTICS)
    write_coverage(folder / COVERAGE, report, gel)
    write_json(folder / PRESSES, asdict(fitted))
    return fitted


def read_fitted(folder: Path) -> FittedOptics | None:
    """Reads presses.json; None if the fit is missing or incomplete.

    Raises T2TwinError for an unreadable file.
    """
    path = folder / PRESSES
    if not path.is_file() or not (folder / OPTICS).is_file():
        return None
    return read_json(path, FittedOptics, FORMAT)


def write_adapt_page(
    out: Path,
    run: CountsPredictor,
    comparisons: Sequence[PressComparison],
    result: AdaptationResult,
) -> Path:
    """Writes out/index.html and returns its path."""
    sections = {
        "summary": ("", lambda: _summary(result, run)),
        "presses": (
            "Presses",
            lambda: {"presses": [(one, _figure(run, one)) for one in comparisons]},
        ),
        "uncertainty": ("Uncertainty", lambda: {"table": uncertainty_table(result.uncertainty)}),
    }
    templates = ["adaptation/templates/adaptation.html"]
    return write_page(out, TITLE, templates, sections, result=result)


def _summary(result: AdaptationResult, run: CountsPredictor) -> dict[str, Any]:
    rows = [
        [
            name,
            f"{scores.rmse_percent:.2f}",
            f"{scores.centroid_mm:.2f}",
            f"{100 * scores.force_error:.0f}",
            f"{scores.single_region}",
            "" if scores.depth_rmse_mm is None else f"{scores.depth_rmse_mm:.3f}",
            f"{scores.refused}",
        ]
        for run, each in result.runs.items()
        for name, scores in (
            (f"{run} run, real frames", each.real),
            (f"{run} run, simulated frames", each.simulated),
        )
    ]
    heads = ["", "RMSE, %", "centroid, mm", "force error, %", "one region", "depth, mm", "refused"]
    least = MIN_CONTACT_SHARE * run.config.data.array.full_scale_counts
    return {"table": Table(heads, {"": rows}), "min_contact_counts": least}


def _figure(run: CountsPredictor, comparison: PressComparison) -> bytes:
    """Content of a PNG file with both frames of a press, their translations and the reference."""
    reference, layout = comparison.reference, run.config.data.array
    phi = layout.phi
    panels = [
        Panel("real frame", reference.frame),
        Panel("translated", phi(comparison.real.counts)),
        Panel("simulated frame", reference.simulated),
        Panel("translated", phi(comparison.simulated.counts)),
        Panel("simulated target", phi(reference.counts)),
    ]
    return panels_image(panels, phi.centers_mm, layout.x_mm, layout.y_mm)
