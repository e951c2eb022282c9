"""Figures of drawn DIGIT pictures, on cases whose figures are known."""

import numpy as np
import pytest

from benchmarks.networks.image_metrics import (
    CONTACT_GREY,
    DETAILS_MM,
    compare_images,
    explained_by_detail,
    in_contact,
    intervals,
    replicates,
    scores,
)

UNTOUCHED = np.full((64, 64), 120, np.uint8)
MM_PER_PX = (0.25, 0.2)


@pytest.fixture
def real() -> np.ndarray:
    """(4, 64, 64): a bright square at four places."""
    pictures = np.tile(UNTOUCHED, (4, 1, 1))
    for number, picture in enumerate(pictures):
        picture[10 : 30, 5 + 10 * number : 25 + 10 * number] = 180  # fmt: skip
    return pictures


def test_the_contact_is_where_the_background_frame_has_changed(real: np.ndarray) -> None:
    assert (in_contact(real, UNTOUCHED) == (real == 180)).all()
    barely = UNTOUCHED + np.uint8(CONTACT_GREY)
    assert not in_contact(barely[None], UNTOUCHED).any()
    assert in_contact((barely + 1)[None], UNTOUCHED).all()


def test_the_real_picture_itself_is_without_fault(real: np.ndarray) -> None:
    result = scores(compare_images(real, real, UNTOUCHED))
    assert result.rmse_percent == result.rmse_contact_percent == 0.0
    assert result.ssim_contact == pytest.approx(1.0) and result.psnr_contact_db > 70.0


def test_only_the_contact_counts(real: np.ndarray) -> None:
    """25.5 grey levels are a tenth of full scale: 20 dB. Elsewhere they change the RMSE alone."""
    drawn = real.copy()
    drawn[real == 180] -= 25
    result = scores(compare_images(drawn, real, UNTOUCHED))
    assert result.rmse_contact_percent == pytest.approx(100 * 25 / 255)
    assert result.psnr_contact_db == pytest.approx(20 * np.log10(255 / 25))
    assert result.rmse_percent == pytest.approx(100 * 25 / 255 * np.sqrt(400 / 4096))
    elsewhere = real.copy()
    elsewhere[:, 50:] = 0
    result = scores(compare_images(elsewhere, real, UNTOUCHED))
    assert result.rmse_contact_percent == 0.0 and result.rmse_percent > 10
    assert result.ssim_contact == pytest.approx(1.0)


def test_a_picture_without_contact_has_no_say(real: np.ndarray) -> None:
    more = np.concatenate([real, UNTOUCHED[None]])
    drawn = np.concatenate([real, 0 * UNTOUCHED[None]])
    figures = compare_images(drawn, more, UNTOUCHED)
    assert np.isnan(figures.ssim_contact[-1])
    assert scores(figures).ssim_contact == pytest.approx(1.0)


def test_resamples_are_of_whole_shapes(real: np.ndarray) -> None:
    drawn = real.copy()
    drawn[2:, 10:20, :] += np.uint8(20)
    shapes = np.array(["good", "good", "bad", "bad"])
    found = intervals(replicates(compare_images(drawn, real, UNTOUCHED), shapes))
    low, high = found["rmse_percent"] or (0, 0)
    worst = scores(compare_images(drawn[2:], real[2:], UNTOUCHED)).rmse_percent
    assert low == 0.0 and high == pytest.approx(worst)


def test_what_is_explained_is_one_of_the_truth_and_none_of_the_mean(real: np.ndarray) -> None:
    mean = real.mean(axis=0)
    every = len(DETAILS_MM) + 1
    assert explained_by_detail(real, real, mean, MM_PER_PX) == [1.0] * every
    average = np.tile(mean.astype(np.uint8), (4, 1, 1))
    of_mean = explained_by_detail(average, real, average[0], MM_PER_PX)
    assert of_mean == pytest.approx([0.0] * every, abs=1e-6)


def test_fine_detail_left_out_is_missing_in_the_fine_part_only(real: np.ndarray) -> None:
    """A fine chequer on the square, 0.25 mm wide, is drawn as its mean."""
    rows, columns = np.indices((64, 64))
    chequer = np.where((rows + columns) % 2, 40, -40)
    fine = np.where(real == 180, real + chequer, real).astype(np.uint8)
    parts = explained_by_detail(real, fine, UNTOUCHED, MM_PER_PX)
    assert min(parts[:3]) > 0.95 and parts[3] < 0.5
