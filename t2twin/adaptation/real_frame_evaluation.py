"""Evaluation of translators on real frames, with simulated presses as reference; the one to keep.

The reference is the simulated target, pressed at the position and depth found in each frame.

Shape letters: P presses, N taxels.
"""

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np
import pandas as pd
from PIL import Image
from skimage.measure import label

from t2twin.core.draw import Panel, panels_image
from t2twin.core.files import atomic_write
from t2twin.core.tables import Table
from t2twin.core.templates import render
from t2twin.primitives_cad.shape import ball
from t2twin.report.page import write_page
from t2twin.sim.calibrate.calibrate import OpticsUncertainty, uncertainty_table
from t2twin.sim.contact.contact_solver import force_at_depth
from t2twin.sim.contact.types import PressCommand
from t2twin.sim.sensors.pair import SensorPair
from t2twin.translate.evaluation.metrics import REPORTED_LEVEL
from t2twin.translate.inference.estimate import ContactEstimate
from t2twin.translate.inference.predictor import TrainedTranslator
from t2twin.translate.models.field import CONTACT_KPA
from t2twin.translate.runs.card import CARD, LIMITS
from t2twin.translate.runs.config import BEST, CONFIG, FRAME_CHECK, LOG

REGION_SHARE = 0.2  # contact threshold of a tactile image, as a share of its maximum (assumed)
MIN_CONTACT_SHARE = 0.01  # smallest count of a contact, in parts of full scale (assumed)
TRAINED, INITIAL = "trained", "initial"  # run of the adaptation; the one that initialized it


@dataclass(frozen=True)
class References:
    """Real frames of presses, and the simulated presses that correspond to them."""

    names: Sequence[str]
    poses: np.ndarray  # (P, 3) x_mm, y_mm, depth_mm, found in the frames
    force_n: np.ndarray  # (P,) simulated forces at these depths
    frames: np.ndarray  # (P, rows, columns, 3) uint8, the real images
    simulated: np.ndarray  # the same, simulated, with the noise of one frame
    counts: np.ndarray  # (P, N) of the simulated target
    depth_mm: np.ndarray  # of each simulated press, in the cells of the contact maps, as in_contact
    in_contact: np.ndarray


@dataclass(frozen=True)
class AdaptationScores:
    """Scores of a translator over the held-out presses, relative to the simulated target."""

    rmse_percent: float  # over all presses, percent of full scale
    centroid_mm: float  # median distance of the predicted centroid
    single_region: int  # presses with exactly one predicted contact region
    force_error: float  # median absolute relative error of the force, else of the summed counts
    interval_coverage_percent: float | None  # counts within their 90 % intervals, if predicted
    depth_rmse_mm: float | None = (
        None  # median RMSE of the gel's depth in the contact, if predicted
    )
    refused: int = 0  # presses whose frame the run names unlike its images

    @classmethod
    def of(cls, errors: pd.DataFrame) -> "AdaptationScores":
        """The scores of the errors of presses, see `evaluate_frames`."""
        covered, depth_mm = errors.covered.mean(), errors.depth_rmse_mm.median()
        return cls(
            rmse_percent=float(np.sqrt(np.square(errors.rmse_percent).mean())),
            centroid_mm=float(errors.centroid_mm.median()),
            single_region=int((errors.regions == 1).sum()),
            force_error=float(errors.force_error.abs().median()),
            interval_coverage_percent=None if np.isnan(covered) else 100.0 * float(covered),
            depth_rmse_mm=None if np.isnan(depth_mm) else float(depth_mm),
            refused=int(errors.refused.sum()),
        )


@dataclass(frozen=True)
class AdaptationResult:
    """Content of adapted.json."""

    model: str  # the trained model
    kept: str  # name of the more accurate run, "trained" or "initial"
    # Scores on real and simulated frames of the held-out presses, and largest predicted count on
    # the real background frame, by run; "initial", which initialized the training, if any
    real: dict[str, AdaptationScores]
    simulated: dict[str, AdaptationScores]
    background_counts: dict[str, float]
    presses: int  # number of held-out presses
    optics_psnr_db: float  # of the calibrated optics on them, as optics_ssim
    optics_ssim: float
    zero_rmse_percent: float  # baselines: of no counts, and of the mean array of the presses
    mean_array_rmse_percent: float
    minutes: dict[str, float]  # by step
    uncertainty: OpticsUncertainty  # ranges of the presses' depths and forces


def simulate_references(
    names: Sequence[str],
    poses: np.ndarray,
    frames: np.ndarray,
    diameters_mm: Sequence[float],
    sensors: SensorPair,
) -> References:
    """Simulates the press of a ball for each frame. poses, frames: as in `References`. sensors: a
    gel camera and a taxel array. Raises T2TwinError for a depth that no force reaches."""
    rows, camera = [], sensors.camera
    for number, (pose, diameter_mm) in enumerate(zip(poses.tolist(), diameters_mm, strict=True)):
        shape, (x_mm, y_mm, depth_mm) = ball(diameter_mm / 2), pose
        command = PressCommand(shape.name, x_mm, y_mm, 0.0, 1.0)
        force_n = force_at_depth(partial(camera.press, shape), command, depth_mm)
        sample = sensors.press(shape, replace(command, force_n=force_n))
        touched = sample.of_camera
        noisy = camera.image(touched.contact, np.random.default_rng((0, number)))
        in_contact = touched.pressure_map_kpa > CONTACT_KPA
        rows.append((force_n, noisy, sample.counts.astype(float), touched.depth_map_mm, in_contact))
    force_n, *simulated = (np.array(each) for each in zip(*rows, strict=True))
    return References(names, poses, force_n, frames, *simulated)


def evaluate_frames(
    run: TrainedTranslator,
    images: np.ndarray,
    references: References,
    background: np.ndarray | None,
) -> tuple[np.ndarray, pd.DataFrame]:
    """Counts (P, N) that a run predicts of the real or the simulated frames of the presses, and a
    row of errors for each press, NaN where not predicted. background: the unit's, (rows, columns,
    3) uint8, an input of field runs."""
    layout, truth = run.config.data.array, references.counts
    least = MIN_CONTACT_SHARE * layout.full_scale_counts
    own = background if run.config.has_uncertainty else None
    estimate = run._classified_estimate(images, own, contact=run.config.predicts_contact)
    contacts = estimate.contact
    counts = estimate.counts.astype(float)
    apart_mm = centroids_mm(run, counts) - centroids_mm(run, truth)
    images_of = layout.phi(counts)
    regions = [label(image > max(REGION_SHARE * image.max(), least)) for image in images_of]
    ratio = counts.sum(axis=1) / truth.sum(axis=1)
    if estimate.force_n is not None:
        ratio = estimate.force_n / references.force_n
    errors = pd.DataFrame(
        {
            "rmse_percent": _rmse_percent(counts - truth, run),
            "centroid_mm": np.linalg.norm(apart_mm, axis=1),
            "regions": [cast(np.ndarray, each).max() for each in regions],
            "force_error": ratio - 1.0,
            "covered": np.nan,
            "depth_rmse_mm": np.nan,
            "refused": [each.inside is False for each in estimate.ood_class],
        }
    )
    if estimate.counts_std is not None:
        low, high = estimate.interval(REPORTED_LEVEL)
        errors["covered"] = ((low <= truth) & (truth <= high)).mean(axis=1)
    if contacts is not None:
        size = references.depth_mm.shape[:0:-1]
        found_mm = [
            np.asarray(Image.fromarray(one.depth_mm).resize(size, Image.Resampling.BOX), float)
            for one in cast(list[ContactEstimate], contacts)
        ]
        squares, inside = np.square(found_mm - references.depth_mm), references.in_contact
        errors["depth_rmse_mm"] = np.sqrt(squares.mean(axis=(1, 2), where=inside))
    return counts, errors


def _rmse_percent(error: np.ndarray, run: TrainedTranslator) -> np.ndarray:
    """(P,) RMSE of counts (P, N), percent of full scale."""
    rmse = np.sqrt(np.mean(np.square(error), axis=1))
    return 100.0 * rmse / run.config.data.array.full_scale_counts


def centroids_mm(run: TrainedTranslator, counts: np.ndarray) -> np.ndarray:
    """(P, 2) mm: count-weighted centroids of the contacts in counts of the run's layout, (P, N);
    center of the array without contact."""
    layout = run.config.data.array
    places = np.stack([layout.x_mm, layout.y_mm], axis=1)
    weight = np.where(counts > MIN_CONTACT_SHARE * layout.full_scale_counts, counts, 0.0)
    weight[~weight.any(axis=1)] = 1.0
    return weight @ places / weight.sum(axis=1, keepdims=True)


def background_counts(run: TrainedTranslator, background: np.ndarray) -> float:
    """Largest predicted count on a background frame, which a field run also receives as such."""
    return float(run.predict(background, background if run.config.has_uncertainty else None).max())


def baseline_rmse_percent(references: References, run: TrainedTranslator) -> list[float]:
    """RMSE, percent of full scale, of zero counts and of the mean array of the presses."""
    truth = references.counts
    errors = np.stack([truth.ravel(), (truth - truth.mean(axis=0)).ravel()])
    return _rmse_percent(errors, run).tolist()


def choose(real: Mapping[str, AdaptationScores], simulated: Mapping[str, AdaptationScores]) -> str:
    """TRAINED or INITIAL, the name of the run to keep.

    TRAINED if its RMSE is lower on the real and on their simulated frames, as one of them may be by
    chance. It must also refuse no more of the real frames, which are all touches of the unit.
    """
    is_better = INITIAL not in real or (
        real[TRAINED].rmse_percent < real[INITIAL].rmse_percent
        and simulated[TRAINED].rmse_percent < simulated[INITIAL].rmse_percent
        and real[TRAINED].refused <= real[INITIAL].refused
    )
    return TRAINED if is_better else INITIAL


def publish(
    source: Path, kept: str, real: Mapping[str, AdaptationScores],
    simulated: Mapping[str, AdaptationScores], out_dir: Path,
) -> None:  # fmt: skip
    """Copies the kept run to out_dir, with the scores of all runs in its card."""
    out_dir.mkdir(exist_ok=True)
    for name in (BEST, LOG, CONFIG, FRAME_CHECK):
        if (source / name).is_file():
            with atomic_write(out_dir / name) as temporary:
                shutil.copyfile(source / name, temporary)
    card = source / CARD
    text = card.read_text(encoding="utf-8") if card.is_file() else LIMITS
    section = render("adaptation/templates/card.md", kept=kept, real=real, simulated=simulated)
    with atomic_write(out_dir / CARD) as temporary:
        temporary.write_text(text.replace(LIMITS, f"{section}\n{LIMITS}", 1), encoding="utf-8")


def scores_table(result: AdaptationResult) -> Table:
    """The scores of the runs on real and on simulated frames."""

    def cells(scores: AdaptationScores) -> list[str]:
        known = [
            (scores.rmse_percent, ".2f"), (scores.centroid_mm, ".2f"),
            (100 * scores.force_error, ".0f"), (scores.single_region, "d"),
            (scores.interval_coverage_percent, ".0f"), (scores.depth_rmse_mm, ".3f"),
            (scores.refused, "d"),
        ]  # fmt: skip
        return ["" if value is None else format(value, style) for value, style in known]

    heads = ["", "RMSE, %", "centroid, mm", "force error, %", "one region", "in 90 % interval, %",
             "depth, mm", "refused"]  # fmt: skip
    rows = [
        [f"{run} run, {name} frames", *cells(scores[run])]
        for run in result.real
        for name, scores in (("real", result.real), ("simulated", result.simulated))
    ]
    return Table(heads, {"": rows})


def write_adapt_page(
    out: Path,
    run: TrainedTranslator,
    real: tuple[np.ndarray, pd.DataFrame],
    simulated: tuple[np.ndarray, pd.DataFrame],
    references: References,
    result: AdaptationResult,
) -> Path:
    """Writes out/index.html and returns its path. real, simulated: what `evaluate_frames` found
    of the kept run."""
    least = MIN_CONTACT_SHARE * run.config.data.array.full_scale_counts
    summary = {"table": scores_table(result), "min_contact_counts": least}

    def presses() -> dict[str, Any]:
        found, layout = [], run.config.data.array
        for n, name in enumerate(references.names):
            panels = [
                Panel(title, values[n])
                if values.ndim == 4
                else Panel(title, layout.phi(values[n]), layout.phi, layout, "counts")
                for title, values in (
                    ("real frame", references.frames), ("translated", real[0]),
                    ("simulated frame", references.simulated), ("translated", simulated[0]),
                    ("simulated target", references.counts),
                )
            ]  # fmt: skip
            errors = (each.rmse_percent[n] for _, each in (real, simulated))
            pose, force_n = references.poses[n], references.force_n[n]
            found.append((name, pose, force_n, panels_image(panels), *errors))
        return {"presses": found}

    sections = {
        "summary": ("", lambda: summary),
        "presses": ("Presses", presses),
        "uncertainty": ("Uncertainty", lambda: {"table": uncertainty_table(result.uncertainty)}),
    }
    templates = ["adaptation/templates/adaptation.html"]
    return write_page(out, "Translator adapted to this sensor", templates, sections, result=result)
