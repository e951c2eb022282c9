"""The loss of shape: truths of the soft overlap, what it adds to a training, what is refused."""

from copy import deepcopy
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from t2twin.core.errors import T2TwinError
from t2twin.translate.data.pairs import Examples, load_info
from t2twin.translate.models.presets import PRESETS, Preset
from t2twin.translate.models.touch2touch import CONTACT_LEVEL, Touch2Touch, soft_iou_loss
from t2twin.translate.runs.checkpoint import build
from t2twin.translate.runs.config import RunConfig
from t2twin.translate.training.train import train

SMOKE = PRESETS["touch2touch"]["smoke"]


pytestmark = pytest.mark.usefixtures("one_thread")


def square(left: int, height: float = 0.5, size: int = 32) -> torch.Tensor:
    """(1, 1, size, size): 8 x 8 pixels of a height, nothing elsewhere."""
    image = torch.zeros(1, 1, size, size)
    image[..., 4:12, left : left + 8] = height
    return image


def hill(width: float) -> torch.Tensor:
    places = torch.arange(32.0) - 15.5
    return 0.6 * torch.exp(-(places[:, None] ** 2 + places**2) / (2 * width**2))[None, None]


def test_equal_images_lose_nothing_and_contacts_apart_lose_all() -> None:
    for image in (square(4), hill(5.0), torch.rand(3, 1, 32, 32)):
        assert soft_iou_loss(image, image).item() == 0.0
    assert soft_iou_loss(square(4), square(20)).item() == 1.0
    assert soft_iou_loss(torch.zeros(1, 1, 32, 32), square(4)).item() == 1.0


def test_it_asks_for_the_shape_and_not_for_how_much_is_felt() -> None:
    for height in (0.2, 0.9):
        assert soft_iou_loss(square(4, height), square(4)).item() == pytest.approx(0.0, abs=1e-6)
    assert soft_iou_loss(0.4 * hill(5.0), hill(5.0)).item() == pytest.approx(0.0, abs=1e-6)


def test_it_grows_with_the_distance_and_follows_the_contact_iou() -> None:
    """A hill of another width: the loss is near what the sharp overlap leaves."""
    losses = [soft_iou_loss(hill(width), hill(5.0)).item() for width in (5.0, 5.5, 6.0, 7.0, 9.0)]
    assert losses == sorted(losses)
    for width in (6.0, 7.0, 9.0):
        ours, wanted = (each > CONTACT_LEVEL * each.max() for each in (hill(width), hill(5.0)))
        sharp = 1 - ((ours & wanted).sum() / (ours | wanted).sum()).item()
        assert soft_iou_loss(hill(width), hill(5.0)).item() == pytest.approx(sharp, abs=0.1)


def test_real_images_of_nothing_have_no_say() -> None:
    nothing = torch.zeros(1, 1, 32, 32)
    drawn, real = torch.cat([square(4), square(4)]), torch.cat([square(20), nothing])
    assert soft_iou_loss(drawn, real).item() == 1.0
    assert soft_iou_loss(square(4), nothing).item() == 0.0


def test_its_gradient_is_finite_and_leads_to_the_shape() -> None:
    torch.manual_seed(0)
    drawn = (0.05 * torch.rand(1, 1, 32, 32)).requires_grad_()
    real = hill(5.0)
    first = soft_iou_loss(drawn, real)
    for _ in range(200):
        (gradient,) = torch.autograd.grad(soft_iou_loss(drawn, real), drawn)
        assert torch.isfinite(gradient).all()
        drawn = (drawn - 0.3 * gradient).clamp(0, 1).detach().requires_grad_()
    assert soft_iou_loss(drawn, real).item() < first.item() / 2
    empty = torch.zeros(1, 1, 32, 32, requires_grad=True)
    (gradient,) = torch.autograd.grad(soft_iou_loss(empty, real), empty)
    assert torch.isfinite(gradient).all() and gradient.abs().max() < 10


def translator(data_dir: Path, preset: Preset) -> Touch2Touch:
    info = load_info(data_dir)
    made = build(RunConfig("touch2touch", preset, 0, info, None, None, 1, False, 1))
    assert isinstance(made, Touch2Touch)
    return made


def test_the_generator_minimises_it_with_its_weight(data_dir: Path) -> None:
    """Beside the adversarial loss and 100 L1, written out; without a weight nothing is added."""
    torch.manual_seed(0)
    counts = 40_000.0 * torch.rand(4, 20)
    images = 2 * torch.rand(4, 1, 32, 32) - 1
    losses, gradients = {}, {}
    for weight in (0.0, 7.0):
        one = translator(data_dir, replace(SMOKE, iou_weight=weight))
        before = deepcopy(one)
        torch.manual_seed(1)  # dropout
        losses[weight] = one.step(Examples(images, counts))
        gradients[weight] = [p.grad for p in one.generator.parameters()]
        torch.manual_seed(1)
        drawn = before.generator(images)
        real = before.target_pictures(counts)
        pairs = (
            before.discriminator(torch.cat([images, each], dim=1))
            for each in (real, drawn.detach())
        )
        likely_real, likely_drawn = map(torch.sigmoid, pairs)
        expected = -0.5 * (likely_real.log().mean() + (1 - likely_drawn).log().mean())
        assert losses[weight]["discriminator"] == pytest.approx(expected.item(), rel=1e-4)
        before.discriminator.load_state_dict(one.discriminator.state_dict())
        likely = torch.sigmoid(before.discriminator(torch.cat([images, drawn], dim=1)))
        shape = soft_iou_loss((drawn + 1) / 2, (real + 1) / 2)
        whole = -likely.log().mean() + 100 * (drawn - real).abs().mean() + weight * shape
        whole.backward()
        for ours, parameter in zip(gradients[weight], before.generator.parameters(), strict=True):
            assert ours is not None and parameter.grad is not None
            scale = parameter.grad.abs().max().item()
            torch.testing.assert_close(ours, parameter.grad, rtol=0, atol=2e-3 * scale + 1e-9)
        if weight:
            assert losses[weight]["iou"] == pytest.approx(shape.item(), rel=1e-4)
    assert set(losses[0.0]) == {"discriminator", "adversarial", "l1"}


def test_a_weight_is_for_tactile_images_alone(data_dir: Path, tmp_path: Path) -> None:
    for model, direction in (("resnet18", "image-to-counts"), ("touch2touch", "counts-to-image")):
        with pytest.raises(T2TwinError, match="run predicts no tactile image"):
            train(model, data_dir, "smoke", tmp_path, direction=direction, iou_weight=1.0)
    assert not list(tmp_path.iterdir())
