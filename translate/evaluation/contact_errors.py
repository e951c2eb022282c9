"""Errors of the predicted contact: depth, pressure, mask and center of pressure.

They are measured in the cells of the network's maps. Errors of a press are those in its true
contact.

Shape letters: P pairs, B batch, H side of the maps.
"""

from types import SimpleNamespace

import numpy as np
import torch

from t2twin.translate.data.images import to_input
from t2twin.translate.data.pairs import ImageFile, Pictures
from t2twin.translate.evaluation.records import ContactMetrics
from t2twin.translate.inference.predictor import TrainedTranslator, parts_of
from t2twin.translate.models.contact import CONTACT_KPA, EVEN, center_of_pressure
from t2twin.translate.uncertainty.estimate import half_width

LEVEL = 0.9
"""Level of the intervals whose coverage is reported."""

MIN_CELLS = 4
"""Least number of cells of a contact (assumed: smaller ones are not resolved)."""


def contact_metrics(
    run: TrainedTranslator,
    pictures: Pictures,
    contact: ImageFile,
    force_n: np.ndarray,
    progress: str | None = None,
) -> ContactMetrics:
    """The errors of a run that predicts the contact.

    pictures: inputs of P pairs, as for `estimate_pixels`. contact: their contact maps. force_n:
    (P,), 0 without contact; other pairs may have their contact outside the view.
    """
    half = half_width(LEVEL)
    view_mm = run.config.data.camera.view_mm
    parts, false_contacts = [], []
    for part in parts_of(len(contact), progress):
        inputs = to_input(pictures[part].astype(np.float32) / 255.0)
        found = SimpleNamespace(**run.translator.predict_all(inputs, with_contact=True))
        maps = torch.from_numpy(contact[part].astype(np.float32)).to(found.depth_mm.device)
        depth, pressure = maps.unbind(dim=1)
        inside, mask = pressure > CONTACT_KPA, found.probability > EVEN
        cells = inside.sum(dim=(1, 2))
        error = found.depth_mm - depth
        deepest = (depth * inside).amax(dim=(1, 2))
        center, _ = center_of_pressure(pressure, pressure, view_mm)
        total = pressure.sum(dim=(1, 2))
        values = [
            ((error.square() * inside).sum(dim=(1, 2)) / cells).sqrt(),
            ((found.depth_mm * inside).amax(dim=(1, 2)) - deepest).abs() / deepest,
            (inside & mask).sum(dim=(1, 2)) / (inside | mask).sum(dim=(1, 2)),
            (found.pressure_kpa.sum(dim=(1, 2)) - total).abs() / total,
            (found.center_mm - center).square().sum(dim=1).sqrt(),
            ((error.abs() <= half * found.depth_std_mm) & inside).sum(dim=(1, 2)) / cells,
            ((found.center_mm - center).abs() <= half * found.center_std_mm).float().mean(dim=1),
        ]
        with_contact = (cells >= MIN_CELLS).cpu()
        parts.append(torch.stack(values, dim=1).cpu()[with_contact])
        without_contact = torch.from_numpy(force_n[part] == 0.0)
        false_contacts.append(mask.any(dim=2).any(dim=1).cpu()[without_contact])
    depth, deepest, iou, force, center, covered, centered = torch.cat(parts).double().numpy().T
    false = torch.cat(false_contacts).double().numpy()
    missed = np.isnan(center)
    return ContactMetrics(
        pairs=len(depth),
        depth_rmse_mm=float(np.median(depth)),
        depth_mean_rmse_mm=float(depth.mean()),
        deepest_error_percent=100.0 * float(np.median(deepest)),
        deepest_worst_percent=100.0 * float(deepest.max()),
        iou=float(iou.mean()),
        force_in_view_error_percent=100.0 * float(np.median(force)),
        center_error_mm=float(np.median(center[~missed])) if not missed.all() else None,
        depth_coverage_percent=100.0 * float(covered.mean()),
        center_coverage_percent=100.0 * float(centered.mean()),
        missed_percent=100.0 * float(missed.mean()),
        false_percent=100.0 * float(false.mean()) if len(false) else None,
    )
