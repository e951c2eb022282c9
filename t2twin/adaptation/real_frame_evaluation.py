"""Evaluation of translators on real frames, with simulated presses as reference; the one to keep.

The true counts of the real presses are unknown. The reference is the simulated target, a taxel
array, pressed at the position and depth that the optics found in each frame.

The trained run and the one that initialized its training are evaluated on the same held-out
presses. The trained run is kept if its RMSE is lower on the real frames and also on their simulated
frames; one of the two may be lower by chance. It must not refuse more of the real frames, which are
all touches of the unit.
"""

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np
from PIL import Image
from skimage.measure import label

from t2twin.core.draw import Panel, panels_image, tactile_panel
from t2twin.core.files import atomic_write
from t2twin.core.tables import Table
from t2twin.core.templates import render
from t2twin.primitives_cad.shape import Shape
from t2twin.report.page import write_page
from t2twin.sim.calibrate.measurements import OpticsUncertainty, uncertainty_table
from t2twin.sim.contact.contact_solver import force_at_depth
from t2twin.sim.contact.types import PressCommand
from t2twin.sim.sensors.pair import SensorPair
from t2twin.translate.evaluation.metrics import REPORTED_LEVEL
from t2twin.translate.inference.contact import ContactEstimate
from t2twin.translate.inference.load import load_run
from t2twin.translate.inference.predictor import TrainedTranslator
from t2twin.translate.models.contact import CONTACT_KPA
from t2twin.translate.runs.card import CARD, LIMITS
from t2twin.translate.runs.config import BEST, CONFIG, FRAME_CHECK, LOG
from t2twin.translate.uncertainty.ood import OODClass

REGION_SHARE = 0.2  # contact threshold of a tactile image, as a share of its maximum (assumed)

MIN_CONTACT_SHARE = 0.01  # smallest count of a contact, in parts of full scale (assumed)

TITLE = "Translator adapted to this sensor"

TRAINED, INITIAL = "trained", "initial"
"""Names of the runs of an adaptation: its own, and the one that initialized the training."""


@dataclass(frozen=True)
class SimulatedReference:
    """A real frame and the simulated press that corresponds to it.

    pose: x_mm, y_mm, depth_mm, found in the frame. force_n: simulated force at this depth. frame,
    simulated: (rows, columns, 3) uint8, the real and the simulated image, the latter with the noise
    of one frame. counts: (N,) of the simulated target. depth_mm: (rows, columns) of the cells of
    the contact maps, of the simulated press. in_contact: the same of bool, its contact.
    """

    name: str
    pose: tuple[float, float, float]
    force_n: float
    frame: np.ndarray
    simulated: np.ndarray
    counts: np.ndarray
    depth_mm: np.ndarray
    in_contact: np.ndarray


@dataclass(frozen=True)
class FrameResult:
    """Prediction and errors of one frame, relative to the simulated target.

    rmse_percent: of full scale. centroid_mm: distance between predicted and reference centroid.
    regions: connected contact regions of the predicted tactile image. force_error: relative error
    of the predicted force; of a run without a predicted force, relative error of the summed counts.
    coverage: share of the taxels whose 90 % interval covers the reference, None without intervals.
    depth_rmse_mm: RMSE of the gel's depth in the contact, None if the run does not predict it.
    refused: whether the run's out-of-distribution detection names the frame unlike its images.
    """

    counts: np.ndarray
    rmse_percent: float
    centroid_mm: float
    regions: int
    force_error: float
    coverage: float | None = None
    depth_rmse_mm: float | None = None
    refused: bool = False


@dataclass(frozen=True)
class PressComparison:
    """Results of the real and the simulated frame of one press."""

    reference: SimulatedReference
    real: FrameResult
    simulated: FrameResult


@dataclass(frozen=True)
class AdaptationScores:
    """Scores of a translator over the held-out presses, relative to the simulated target.

    rmse_percent: over all presses, percent of full scale. centroid_mm: median. single_region:
    presses with exactly one predicted contact region. force_error: median absolute relative error.
    interval_coverage_percent: counts within their 90 % intervals, None without intervals.
    depth_rmse_mm: median RMSE of the gel's depth in the contact, None if it is not predicted.
    refused: presses whose frame the run refuses.
    """

    rmse_percent: float
    centroid_mm: float
    single_region: int
    force_error: float
    interval_coverage_percent: float | None
    depth_rmse_mm: float | None = None
    refused: int = 0

    @classmethod
    def of(cls, results: Sequence[FrameResult]) -> "AdaptationScores":
        covered = [result.coverage for result in results if result.coverage is not None]
        depths = [result.depth_rmse_mm for result in results if result.depth_rmse_mm is not None]
        return cls(
            rmse_percent=float(np.sqrt(np.mean([result.rmse_percent**2 for result in results]))),
            centroid_mm=float(np.median([result.centroid_mm for result in results])),
            single_region=sum(result.regions == 1 for result in results),
            force_error=float(np.median([abs(result.force_error) for result in results])),
            interval_coverage_percent=100.0 * float(np.mean(covered)) if covered else None,
            depth_rmse_mm=float(np.median(depths)) if depths else None,
            refused=sum(result.refused for result in results),
        )


@dataclass(frozen=True)
class RunScores:
    """Scores of a run on the real and the simulated frames of the held-out presses.

    background_counts: largest predicted count on the real background frame.
    """

    real: AdaptationScores
    simulated: AdaptationScores
    background_counts: float


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


def simulate_reference(
    names: Sequence[str],
    poses: np.ndarray,
    frames: np.ndarray,
    balls: Sequence[Shape],
    sensors: SensorPair,
    seed: int = 0,
) -> list[SimulatedReference]:
    """Simulates the press of each frame.

    poses: (n, 3) x_mm, y_mm, depth_mm. frames: (n, rows, columns, 3). balls: pressed shapes, one a
    frame. sensors: a gel camera and a taxel array. Raises T2TwinError for a depth that no force
    reaches.
    """
    references, camera = [], sensors.camera
    pressed = zip(names, poses.tolist(), frames, balls, strict=True)
    for number, (name, pose, frame, ball) in enumerate(pressed):
        rng, (x_mm, y_mm, depth_mm) = np.random.default_rng((seed, number)), pose
        command = PressCommand(ball.name, x_mm, y_mm, 0.0, 1.0)
        force_n = force_at_depth(partial(camera.press, ball), command, depth_mm)
        sample = sensors.press(ball, replace(command, force_n=force_n))
        noisy, counts = camera.image(sample.of_camera.contact, rng), sample.counts.astype(float)
        touched, pose = sample.of_camera, (x_mm, y_mm, depth_mm)
        maps = touched.depth_map_mm, touched.pressure_map_kpa > CONTACT_KPA
        references.append(SimulatedReference(name, pose, force_n, frame, noisy, counts, *maps))
    return references


def evaluate_frames(
    run: TrainedTranslator, references: Sequence[SimulatedReference], background: np.ndarray | None
) -> list[PressComparison]:
    """Evaluates a run on the real and the simulated frame of every press.

    background: (rows, columns, 3) uint8, background frame of the unit, an input of field runs; None
    for none.
    """
    return [
        PressComparison(
            reference,
            evaluate_frame(run, reference.frame, reference, background),
            evaluate_frame(run, reference.simulated, reference, background),
        )
        for reference in references
    ]


def _depth_rmse_mm(contact: ContactEstimate | None, reference: SimulatedReference) -> float | None:
    """RMSE of the depth in the contact, in cells of the maps; None if it is not predicted."""
    if contact is None:
        return None
    rows, columns = reference.depth_mm.shape
    cells = Image.fromarray(contact.depth_mm).resize((columns, rows), Image.Resampling.BOX)
    error = np.asarray(cells, float) - reference.depth_mm
    return float(np.sqrt(np.mean(error[reference.in_contact] ** 2)))


def evaluate_frame(
    run: TrainedTranslator,
    image: np.ndarray,
    reference: SimulatedReference,
    background: np.ndarray | None,
) -> FrameResult:
    """Evaluates a run on one frame, (rows, columns, 3) uint8.

    reference: the simulated press, with counts in the run's layout. background: as for
    `evaluate_frames`.
    """
    layout, truth = run.config.data.array, reference.counts
    own = background if run.has_uncertainty else None
    counts, predicted_n, coverage, depth_rmse_mm = _predict(run, image, reference, own)
    rmse = float(np.sqrt(np.mean((counts - truth) ** 2)))
    least = MIN_CONTACT_SHARE * layout.full_scale_counts
    apart_mm = centroid_mm(run, counts) - centroid_mm(run, truth)
    ratio = counts.sum() / truth.sum() if predicted_n is None else predicted_n / reference.force_n
    return FrameResult(
        counts=counts,
        rmse_percent=100.0 * rmse / layout.full_scale_counts,
        centroid_mm=float(np.linalg.norm(apart_mm)),
        regions=_regions(layout.phi(counts), least),
        force_error=float(ratio) - 1.0,
        coverage=coverage,
        depth_rmse_mm=depth_rmse_mm,
        refused=run.classify_frames(image, own) != [OODClass.IN_DISTRIBUTION],
    )


def predict_counts(
    run: TrainedTranslator, image: np.ndarray, background: np.ndarray | None
) -> np.ndarray:
    """Predicted counts, (N,); a field run also receives the background frame."""
    own = background if run.has_uncertainty else None
    return np.asarray(run.predict(image, own), dtype=float)


def _predict(
    run: TrainedTranslator,
    image: np.ndarray,
    reference: SimulatedReference,
    background: np.ndarray | None,
) -> tuple[np.ndarray, float | None, float | None, float | None]:
    """Counts, force, N, covered share of the true counts, RMSE of the contact's depth, mm."""
    if not run.has_uncertainty:
        return predict_counts(run, image, background), None, None, None
    contact = None
    if run.predicts_contact:
        estimate, contact = run.estimate_with_contact(image, background)
        assert isinstance(contact, ContactEstimate)
    else:
        estimate = run.estimate(image, background)
    low, high = estimate.interval(REPORTED_LEVEL)
    coverage = float(((low <= reference.counts) & (reference.counts <= high)).mean())
    force_n = None if estimate.force_n is None else float(estimate.force_n)
    return estimate.counts.astype(float), force_n, coverage, _depth_rmse_mm(contact, reference)


def centroid_mm(run: TrainedTranslator, counts: np.ndarray) -> np.ndarray:
    """(2,) mm: count-weighted centroid of the contact in counts of the run's layout, (N,); center
    of the array without contact."""
    layout = run.config.data.array
    places = np.stack([layout.x_mm, layout.y_mm], axis=1)
    weight = np.where(counts > MIN_CONTACT_SHARE * layout.full_scale_counts, counts, 0.0)
    return weight @ places / weight.sum() if weight.any() else places.mean(axis=0)


def _regions(image: np.ndarray, least: float) -> int:
    """Number of connected regions of a tactile image whose counts are at least a contact's."""
    contact = image > max(REGION_SHARE * float(image.max()), least)
    return int(cast(np.ndarray, label(contact)).max())


def baseline_rmse_percent(
    references: Sequence[SimulatedReference], run: TrainedTranslator
) -> tuple[float, float]:
    """RMSE, percent of full scale, of zero counts and of the mean array of the presses."""
    truth = np.array([reference.counts for reference in references])
    zero, mean_array = (
        100.0 * float(np.sqrt(np.mean(residual**2))) / run.config.data.array.full_scale_counts
        for residual in (truth, truth - truth.mean(axis=0))
    )
    return zero, mean_array


@dataclass(frozen=True)
class Candidate:
    """A run, with its scores on the held-out presses."""

    run_dir: Path
    run: TrainedTranslator
    comparisons: list[PressComparison]
    scores: RunScores

    @classmethod
    def of(
        cls, run_dir: Path, references: Sequence[SimulatedReference], background: np.ndarray
    ) -> "Candidate":
        """Evaluates a run. background: (rows, columns, 3) uint8, of the real unit."""
        run = load_run(run_dir)
        comparisons = evaluate_frames(run, references, background)
        counts = predict_counts(run, background, background)
        real = AdaptationScores.of([one.real for one in comparisons])
        simulated = AdaptationScores.of([one.simulated for one in comparisons])
        return cls(run_dir, run, comparisons, RunScores(real, simulated, float(counts.max())))


def choose(candidates: Mapping[str, Candidate]) -> str:
    """TRAINED or INITIAL, the name of the candidate to keep."""
    trained, initial = candidates[TRAINED].scores, candidates.get(INITIAL)
    if initial is None:
        return TRAINED
    is_better = all(
        getattr(trained, frames).rmse_percent < getattr(initial.scores, frames).rmse_percent
        for frames in ("real", "simulated")
    )
    refuses_more = trained.real.refused > initial.scores.real.refused
    return TRAINED if is_better and not refuses_more else INITIAL


def publish(candidates: Mapping[str, Candidate], kept: str, out_dir: Path) -> None:
    """Copies the kept run to out_dir, with the scores of all candidates in its card."""
    out_dir.mkdir(exist_ok=True)
    source = candidates[kept].run_dir
    for name in (BEST, LOG, CONFIG, FRAME_CHECK):
        if (source / name).is_file():
            with atomic_write(out_dir / name) as temporary:
                shutil.copyfile(source / name, temporary)
    card = source / CARD
    text = card.read_text(encoding="utf-8") if card.is_file() else LIMITS
    scores = {name: candidate.scores for name, candidate in candidates.items()}
    section = render("adaptation/templates/card.md", kept=kept, scores=scores)
    with atomic_write(out_dir / CARD) as temporary:
        temporary.write_text(text.replace(LIMITS, f"{section}\n{LIMITS}", 1), encoding="utf-8")


def write_adapt_page(
    out: Path,
    run: TrainedTranslator,
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


def _summary(result: AdaptationResult, run: TrainedTranslator) -> dict[str, Any]:
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


def _figure(run: TrainedTranslator, comparison: PressComparison) -> bytes:
    """A PNG of both frames of a press, their translations and the reference."""
    reference, layout = comparison.reference, run.config.data.array
    phi = layout.phi
    panels = [
        Panel("real frame", reference.frame),
        tactile_panel("translated", phi(comparison.real.counts), phi, layout, "counts"),
        Panel("simulated frame", reference.simulated),
        tactile_panel("translated", phi(comparison.simulated.counts), phi, layout, "counts"),
        tactile_panel("simulated target", phi(reference.counts), phi, layout, "counts"),
    ]
    return panels_image(panels)
