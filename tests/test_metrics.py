"""Metrics on cases whose figures are known."""

import numpy as np
import pytest

from t2twin.sim.taxels.layout import load_layout
from t2twin.sim.taxels.phi import Phi
from t2twin.translate.evaluation.metrics import compare, overall

FULL_SCALE = 40000.0


def test_perfect_prediction(phi: Phi, true: np.ndarray) -> None:
    summary = overall(compare(true, true, phi, FULL_SCALE), FULL_SCALE)
    assert summary["pairs"] == 6
    assert summary["rmse_counts"] == summary["rmse_percent"] == 0.0
    assert summary["ssim"] == summary["ssim_contact"] == pytest.approx(1.0)
    assert summary["contact_iou"] == 1.0
    assert summary["centroid_error_mm"] == summary["total_error_percent"] == 0.0


def test_rmse_is_over_samples_and_taxels(phi: Phi, true: np.ndarray) -> None:
    """One taxel of one sample off by 12,000 of 6 x 20: 12,000 / sqrt(120)."""
    off, some = true.copy(), np.arange(20) < 8
    off[2, 7] += 12000.0
    groups = {"under": some, "near": ~some, "beyond": np.zeros(20, bool)}
    summary = overall(compare(off, true, phi, FULL_SCALE, taxel_groups=groups), FULL_SCALE)
    assert summary["rmse_counts"] == pytest.approx(12000.0 / np.sqrt(120))
    assert summary["rmse_percent"] == pytest.approx(30.0 / np.sqrt(120))
    assert summary["rmse_under_counts"] == pytest.approx(12000.0 / np.sqrt(6 * 8))
    assert summary["rmse_near_counts"] == 0.0 and "rmse_beyond_counts" not in summary


def test_weaker_response_keeps_its_shape(phi: Phi, true: np.ndarray) -> None:
    summary = overall(compare(0.8 * true, true, phi, FULL_SCALE), FULL_SCALE)
    assert summary["total_error_percent"] == pytest.approx(20.0)
    assert summary["contact_iou"] == pytest.approx(1.0, abs=1e-3)
    assert summary["centroid_error_mm"] == pytest.approx(0.0, abs=1e-6)
    assert summary["ssim_contact"] < summary["ssim"] < 1.0


def test_centroid_and_contact_of_single_taxels(phi: Phi) -> None:
    """Two inner taxels answer with the same hexagon of triangles, as far apart as they are."""
    layout = load_layout()
    inner = [n for n in range(20) if (phi.matrix.sum(axis=0)[n] > 0.98 * phi.matrix.sum(0).max())]
    assert len(inner) == 6
    a, b = np.zeros((1, 20)), np.zeros((1, 20))
    a[0, inner[0]] = b[0, inner[-1]] = 20000.0
    figures = compare(a, b, phi, FULL_SCALE)
    apart = np.hypot(
        layout.x_mm[inner[0]] - layout.x_mm[inner[-1]],
        layout.y_mm[inner[0]] - layout.y_mm[inner[-1]],
    )
    assert figures.centroid_error_mm[0] == pytest.approx(apart, abs=0.05)
    assert figures.contact_iou[0] == pytest.approx(0.0, abs=0.02)


def test_no_contact_leaves_the_contacts_figures_out(phi: Phi, true: np.ndarray) -> None:
    nothing = np.zeros_like(true[:1])
    figures = compare(np.vstack([nothing, true]), np.vstack([nothing, true]), phi, FULL_SCALE)
    assert np.isnan([figures.contact_iou[0], figures.centroid_error_mm[0]]).all()
    assert overall(figures, FULL_SCALE)["contact_iou"] == 1.0
    alone = overall(compare(nothing, nothing, phi, FULL_SCALE), FULL_SCALE)
    assert alone["ssim"] == 1.0
    assert "contact_iou" not in alone
    missed = compare(np.zeros_like(true), true, phi, FULL_SCALE)
    assert (missed.contact_iou == 0.0).all()
    assert np.isfinite(missed.centroid_error_mm).all()
