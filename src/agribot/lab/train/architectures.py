"""The networks that can be trained, by name."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from torch import Tensor, nn

from agribot.core.errors import ConfigError
from agribot.lab.train.efficientnet import STAGES, STAGES_TO_STRIDE_16
from agribot.lab.train.features import centred_rgb, ten_channels, unit_rgb
from agribot.lab.train.network import CropWeedNet, LiteNet, PlainBlock, load_encoder
from agribot.lab.train.originals import OriginalBonnet, OriginalUNet
from agribot.lab.train.plant_network import PlantNet


class Architecture(NamedTuple):
    """`features` turns an image (N, 3, H, W) in 0..255 into the input of what `build` builds.

    `load_imagenet` gives the network what an encoder of its kind learned on ImageNet. One that
    `finds_plants` answers with stems as well.
    """

    build: Callable[[], nn.Module]
    features: Callable[[Tensor], Tensor]
    about: str
    load_imagenet: Callable[[nn.Module], None] | None = None
    finds_plants: bool = False


ARCHITECTURES = {
    "agribot-s": Architecture(
        partial(LiteNet, stages=STAGES_TO_STRIDE_16, decoder=(16, 32, 48), block=PlainBlock),
        centred_rgb,
        "U-Net with the first half of an encoder that knows ImageNet, for the robot",
        load_encoder,
    ),
    "agribot-m": Architecture(
        partial(LiteNet, stages=len(STAGES), decoder=(16, 32, 48, 96)),
        centred_rgb,
        "the same with the whole encoder, for accuracy",
        load_encoder,
    ),
    "agribot-sim": Architecture(
        CropWeedNet, centred_rgb, "residual U-Net of the default weights, the smallest"
    ),
    "agribot-plants": Architecture(
        PlantNet,
        centred_rgb,
        "agribot-sim with a branch that finds the stems of single plants",
        finds_plants=True,
    ),
    "original-unet": Architecture(OriginalUNet, unit_rgb, "U-Net of the original robot"),
    "original-bonnet": Architecture(
        partial(OriginalBonnet, relu_logits=True), ten_channels, "Bonnet of the original robot"
    ),
    "bonnet": Architecture(
        partial(OriginalBonnet, relu_logits=False),
        ten_channels,
        "the same with a corrected, linear head",
    ),
    "unet-relu": Architecture(
        partial(OriginalUNet, relu_logits=True),
        unit_rgb,
        "the original's U-Net with the faulty head of its Bonnet",
    ),
}


def find_architecture(name: str) -> Architecture:
    """Find a network by its name.

    Raises: ConfigError: no network has this name.
    """
    if name not in ARCHITECTURES:
        raise ConfigError(f"no network is called {name}; known: {', '.join(ARCHITECTURES)}")
    return ARCHITECTURES[name]
