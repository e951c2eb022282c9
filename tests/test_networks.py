from copy import deepcopy
from dataclasses import replace

import pytest
import torch
from kinds import gel_camera, taxel_array
from torch import nn

from t2twin.core.errors import T2TwinError
from t2twin.sim.dataset.generate import sensor_info
from t2twin.translate.data.pairs import DataInfo, Examples
from t2twin.translate.inference.load import fold_batchnorm
from t2twin.translate.models.presets import find_preset
from t2twin.translate.models.resnet18 import ResNet18, ResNet18Translator
from t2twin.translate.models.touch2touch import Touch2Touch, UNet, patch_gan
from t2twin.translate.runs.checkpoint import TRANSLATORS

CPU = torch.device("cpu")
FULL_SCALE = 40_000.0


def info() -> DataInfo:
    return DataInfo("0" * 64, sensor_info(gel_camera()), sensor_info(taxel_array()))


def parameters(network: nn.Module) -> int:
    return sum(p.numel() for p in network.parameters())


def test_unet_256_has_the_papers_parameters() -> None:
    network = UNet(256, 64)
    assert round(parameters(network) / 1e6, 1) == 54.4
    assert parameters(network) == 54_407_809


@pytest.mark.parametrize("size", [0, 8, 96, 255])
def test_unet_refuses_other_sizes(size: int) -> None:
    with pytest.raises(T2TwinError, match="power of two"):
        UNet(size, 4)


def test_patchgan_sees_70_pixels() -> None:
    """The gradient of one logit of the middle reaches a patch of 70 x 70 pixels and no more."""
    network = patch_gan(2, 4).eval()
    image = torch.randn(1, 1, 256, 256, requires_grad=True)
    logits = network(torch.cat([image, torch.zeros(1, 1, 256, 256)], dim=1))
    assert logits.shape == (1, 1, 30, 30)
    logits[0, 0, 15, 15].backward()
    assert image.grad is not None
    rows, columns = torch.nonzero(image.grad[0, 0], as_tuple=True)
    assert rows.max() - rows.min() + 1 == 70
    assert columns.max() - columns.min() + 1 == 70


def test_paper_preset_trains_the_published_networks() -> None:
    """The pair that touch2touch trains: one channel in, one out, both at their full width."""
    translator = Touch2Touch(find_preset("touch2touch", "paper"), info(), CPU, bf16=False)
    assert parameters(translator.generator) == 54_407_809
    discriminator = translator.discriminator
    first = next(each for each in discriminator.modules() if isinstance(each, nn.Conv2d))
    assert first.weight.shape == (64, 2, 4, 4)  # the grey picture and the image
    assert parameters(discriminator) == 2_768_705 - 4 * 64 * 16


@pytest.mark.parametrize(
    ("model", "rate", "betas"),
    [("touch2touch", 2e-4, (0.5, 0.999)), ("resnet18", 1e-3, (0.9, 0.999))],
)
def test_adam_is_set_as_in_the_paper(model: str, rate: float, betas: tuple[float, float]) -> None:
    """The settings of the optimizers themselves, which hold every weight once, without decay."""
    preset = replace(find_preset(model, "paper"), filters=16)
    translator = TRANSLATORS["counts"][model](preset, info(), CPU, False)
    assert translator.optimizers.keys() == translator.networks.keys()
    for name, optimizer in translator.optimizers.items():
        assert isinstance(optimizer, torch.optim.Adam)
        [group] = optimizer.param_groups
        assert (group["lr"], group["betas"], group["weight_decay"]) == (rate, betas, 0)
        held = {id(parameter) for parameter in group["params"]}
        assert held == {id(parameter) for parameter in translator.networks[name].parameters()}


def test_resnet18_minimises_l3() -> None:
    """L3 is the mean squared error of the counts: over all taxels of all pairs, in counts^2."""
    torch.manual_seed(0)
    preset = replace(find_preset("resnet18", "paper"), size=64, filters=16)
    translator = ResNet18Translator(preset, info(), CPU, bf16=False)
    images, counts = torch.randn(3, 3, 64, 64), torch.rand(3, 20) * FULL_SCALE
    with torch.no_grad():
        predicted = deepcopy(translator.predictor)(images) * FULL_SCALE
    l3 = ((predicted - counts) ** 2).sum() / (3 * 20)
    loss = translator.step(Examples(images, counts))["l3"]
    assert loss * FULL_SCALE**2 == pytest.approx(l3.item(), rel=1e-4)


def torchvision_names() -> list[str]:
    """The state_dict of torchvision's resnet18, in its order."""

    def norm(name: str) -> list[str]:
        kept = ("weight", "bias", "running_mean", "running_var", "num_batches_tracked")
        return [f"{name}.{what}" for what in kept]

    names = ["conv1.weight", *norm("bn1")]
    for stage in ("layer1", "layer2", "layer3", "layer4"):
        for block in (f"{stage}.0", f"{stage}.1"):
            names += [f"{block}.conv1.weight", *norm(f"{block}.bn1")]
            names += [f"{block}.conv2.weight", *norm(f"{block}.bn2")]
            if block.endswith(".0") and stage != "layer1":
                names += [f"{block}.downsample.0.weight", *norm(f"{block}.downsample.1")]
    return [*names, "fc.weight", "fc.bias"]


def test_resnet18_has_the_published_parameters_and_names() -> None:
    network = ResNet18(1000)
    assert parameters(network) == 11_689_512
    weights = network.state_dict()
    assert list(weights) == torchvision_names()
    assert len(weights) == 122
    for name, shape in {
        "conv1.weight": (64, 3, 7, 7),
        "layer1.0.conv1.weight": (64, 64, 3, 3),
        "layer2.0.conv1.weight": (128, 64, 3, 3),
        "layer2.0.downsample.0.weight": (128, 64, 1, 1),
        "layer4.1.conv2.weight": (512, 512, 3, 3),
        "layer4.1.bn2.running_var": (512,),
        "fc.weight": (1000, 512),
    }.items():
        assert weights[name].shape == shape, name


def test_a_resnet18_too_narrow_to_be_trained_safely_is_refused() -> None:
    with pytest.raises(T2TwinError, match="at least 16"):
        ResNet18(20, filters=8)


@pytest.mark.parametrize("network", [UNet(64, 8), ResNet18(20, 16)], ids=["unet", "resnet18"])
def test_folding_the_batch_norms_changes_nothing(network: nn.Module) -> None:
    """With statistics as a training leaves them, far from zero and one."""
    torch.manual_seed(0)
    norms = [module for module in network.modules() if isinstance(module, nn.BatchNorm2d)]
    for norm in norms:
        norm.running_mean = torch.randn(norm.num_features)
        norm.running_var = torch.rand(norm.num_features) + 0.5
        nn.init.uniform_(norm.weight, 0.5, 1.5)
        nn.init.uniform_(norm.bias, -0.5, 0.5)
    images = torch.randn(2, 1 if isinstance(network, UNet) else 3, 64, 64)
    expected = network.eval()(images).detach()
    assert len(norms) > 5
    fold_batchnorm(network)
    assert not any(isinstance(module, nn.BatchNorm2d) for module in network.modules())
    torch.testing.assert_close(network(images), expected, rtol=1e-3, atol=1e-4)
