import pytest
import torch
from torch import nn

from primitives_cad.errors import T2TwinError
from translate.networks.patchgan import PatchGAN
from translate.networks.resnet18 import ResNet18
from translate.networks.unet import UNet


def parameters(network: nn.Module) -> int:
    return sum(p.numel() for p in network.parameters())


def test_unet_256_has_the_papers_parameters() -> None:
    network = UNet(256, 64)
    assert round(parameters(network) / 1e6, 1) == 54.4
    assert parameters(network) == 54_407_809


def test_unet_goes_down_to_one_pixel_at_every_size() -> None:
    for size in (32, 64, 128):
        network = UNet(size, 4)
        innermost = torch.zeros(2, 1, size, size)
        for block in network.encoder:
            innermost = block(innermost)
        assert innermost.shape[2:] == (1, 1)
        assert network(torch.zeros(2, 1, size, size)).shape == (2, 1, size, size)


def test_unet_drops_out_in_the_three_innermost_decoder_blocks() -> None:
    network = UNet(64, 4)
    has = [
        any(isinstance(module, nn.Dropout) and module.p == 0.5 for module in block.children())
        for block in network.decoder
    ]
    assert has == [True, True, True, False, False]


def test_initial_weights_are_normal_with_a_deviation_of_a_fiftieth() -> None:
    torch.manual_seed(0)
    for network in (UNet(64, 16), PatchGAN()):
        for module in network.modules():
            if isinstance(module, nn.Conv2d | nn.ConvTranspose2d) and module.weight.numel() > 1e4:
                assert module.weight.std().item() == pytest.approx(0.02, rel=0.05)
            if isinstance(module, nn.BatchNorm2d):
                assert module.weight.mean().item() == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("size", [0, 8, 96, 255])
def test_unet_refuses_other_sizes(size: int) -> None:
    with pytest.raises(T2TwinError, match="power of two"):
        UNet(size, 4)


def test_patchgan_sees_70_pixels() -> None:
    """The gradient of one logit of the middle reaches a patch of 70 x 70 pixels and no more."""
    network = PatchGAN(filters=4).eval()
    image = torch.randn(1, 1, 256, 256, requires_grad=True)
    logits = network(image, torch.zeros(1, 1, 256, 256))
    assert logits.shape == (1, 1, 30, 30)
    logits[0, 0, 15, 15].backward()
    assert image.grad is not None
    rows, columns = torch.nonzero(image.grad[0, 0], as_tuple=True)
    assert rows.max() - rows.min() + 1 == 70
    assert columns.max() - columns.min() + 1 == 70


def test_patchgan_has_the_published_parameters() -> None:
    assert parameters(PatchGAN(channels_in=6)) == 2_768_705


def test_resnet18_has_the_published_parameters_and_names() -> None:
    network = ResNet18(1000)
    assert parameters(network) == 11_689_512
    keys = set(network.state_dict())
    assert len(keys) == 122
    assert {
        "conv1.weight",
        "bn1.running_var",
        "layer1.1.conv2.weight",
        "layer2.0.downsample.0.weight",
        "layer4.0.downsample.1.num_batches_tracked",
        "layer4.1.bn2.bias",
        "fc.weight",
    } <= keys
    assert "layer1.0.downsample.0.weight" not in keys
    assert network.fc.weight.shape == (1000, 512)


def test_resnet18_strides_by_32() -> None:
    network = ResNet18(20, filters=4).eval()
    images = torch.zeros(2, 3, 64, 64)
    x = network.maxpool(network.conv1(images))
    x = network.layer4(network.layer3(network.layer2(network.layer1(x))))
    assert x.shape == (2, 32, 2, 2)
    assert network(images).shape == (2, 20)
