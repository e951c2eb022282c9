import numpy as np
import pytest
import torch

from t2twin.core.errors import T2TwinError
from t2twin.sim.taxels.layout import load_layout
from t2twin.sim.taxels.phi import TACTILE_SHAPE, Phi


@pytest.fixture(scope="module")
def counts() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 40001, (16, load_layout().size))


@pytest.mark.parametrize("shape", [TACTILE_SHAPE, (32, 32)])
def test_inverse_gives_the_array_back_within_a_count(
    phi: Phi, counts: np.ndarray, shape: tuple[int, int]
) -> None:
    sized = phi if shape == TACTILE_SHAPE else phi.resized(shape)
    assert sized(counts).shape == (16, *shape)
    assert np.abs(sized.inverse(sized(counts)) - counts).max() < 1.0
    assert np.abs(sized.inverse(sized(counts[3])) - counts[3]).max() < 1.0


def test_linear_field_is_exact_inside_the_hull_and_zero_outside(phi: Phi) -> None:
    layout = load_layout()
    x_mm, y_mm = np.meshgrid(*phi.centers_mm)
    image = phi(1000.0 + 30.0 * layout.x_mm - 20.0 * layout.y_mm)
    plane = 1000.0 + 30.0 * x_mm - 20.0 * y_mm
    hull = phi(np.ones(layout.size)) > 0
    np.testing.assert_allclose(image[hull], plane[hull], rtol=1e-5)
    assert not image[~hull].any()
    # Four rows of five at 7.5 mm, equilateral: 4 x 3 rhombi of 7.5 x 6.495 mm.
    area_mm2 = np.count_nonzero(hull) / 8.8**2
    assert area_mm2 == pytest.approx(12 * 7.5**2 * np.sqrt(3) / 2, rel=0.01)


def test_inverse_is_least_squares(phi: Phi) -> None:
    image = np.random.default_rng(1).normal(size=TACTILE_SHAPE)
    expected = np.linalg.lstsq(phi.matrix.toarray(), image.ravel(), rcond=None)[0]
    np.testing.assert_allclose(phi.inverse(image), expected, atol=1e-4)


def test_what_is_not_read_does_not_count(phi: Phi, counts: np.ndarray) -> None:
    """Counts come from the pixels that are read alone, as from all where nothing is disturbed."""
    small = phi.resized((64, 64))
    unread = np.arange(0, 64 * 64, 7)
    reading = small.with_inverse_from(np.setdiff1d(np.arange(64 * 64), unread))
    images = small(counts).reshape(16, -1)
    images[:, unread] = 1e5
    disturbed = images.reshape(16, 64, 64)
    assert np.abs(reading.inverse(disturbed) - counts).max() < 1.0
    assert np.abs(small.inverse(disturbed) - counts).max() > 1000.0
    np.testing.assert_array_equal(reading(counts), small(counts))
    with pytest.raises(T2TwinError, match="too near the rim"):
        small.with_inverse_from(np.arange(64))


def test_torch_says_the_same_and_has_gradients(phi: Phi, counts: np.ndarray) -> None:
    small = phi.resized((64, 64))
    of_torch = torch.tensor(counts, dtype=torch.float32, requires_grad=True)
    images = small.to_torch(of_torch)
    assert images.shape == (16, 1, 64, 64)
    np.testing.assert_allclose(images[:, 0].detach().numpy(), small(counts), rtol=1e-4, atol=0.1)
    back = small.from_torch(images)
    back.sum().backward()
    assert of_torch.grad is not None
    np.testing.assert_allclose(of_torch.grad.numpy(), 1.0, atol=1e-3)


@pytest.mark.parametrize(
    ("x_mm", "y_mm", "words"),
    [
        ([0.0, 5.0], [0.0, 5.0], "at least 3"),
        ([0.0, 5.0, 5.0, 0.0], [0.0, 0.0, 0.0, 5.0], "in one place"),
        ([0.0, 1.0, 2.0, 3.0], [0.0, 2.0, 4.0, 6.0], "one line"),
        ([0.0, 5.0, 20.0], [0.0, 5.0, 0.0], "outside the tactile image"),
        ([0.0, 5.0, 0.0, 0.1], [0.0, 0.0, 5.0, 5.1], "a pixel apart"),
    ],
)
def test_bad_layouts_are_refused(x_mm: list[float], y_mm: list[float], words: str) -> None:
    with pytest.raises(T2TwinError, match=words):
        Phi(np.array(x_mm), np.array(y_mm), (40, 24), 0.88)
