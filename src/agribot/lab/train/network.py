"""The crop/weed network: a small residual U-Net that is cheap on a CPU.

Two early strides leave few pixels for the wide layers, plain 3x3 convolutions run at full
speed in every inference engine, and the decoder adds its skips instead of concatenating
them. Source: He et al. 2016 (residual blocks), Ronneberger et al. 2015 (U-Net).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from torch import Tensor, nn
from torch.nn import functional

from agribot.core.messages import PlantClass
from agribot.lab.train.efficientnet import LiteEncoder, load_imagenet

CLASS_COUNT = len(PlantClass)
# Smallest multiple of pixels that all strides divide.
STRIDE_PX = 32

Widths = tuple[int, int, int, int, int]


def make_conv(
    channels_in: int, channels_out: int, kernel: int = 3, stride: int = 1
) -> nn.Sequential:
    """Make a convolution with its normalisation."""
    return nn.Sequential(
        nn.Conv2d(channels_in, channels_out, kernel, stride, kernel // 2, bias=False),
        nn.BatchNorm2d(channels_out),
    )


class ResidualBlock(nn.Module):
    """Two convolutions, added to their input: (N, C, H, W) to the same shape."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = make_conv(channels, channels)
        self.second = make_conv(channels, channels)

    def forward(self, x: Tensor) -> Tensor:
        inner = self.second(functional.relu(self.first(x), inplace=True))
        return functional.relu(x + inner, inplace=True)


class PlainBlock(nn.Module):
    """One convolution, (N, C, H, W) to the same shape: half the time of a residual block."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.only = make_conv(channels, channels)

    def forward(self, x: Tensor) -> Tensor:
        return functional.relu(self.only(x), inplace=True)


Block = Callable[[int], nn.Module]  # maker of a block from a number of channels


class EncoderStage(nn.Module):
    """Halve the resolution, then `blocks` residual blocks: (N, C, H, W) to (N, C', H/2, W/2)."""

    def __init__(self, channels_in: int, channels_out: int, blocks: int) -> None:
        super().__init__()
        self.down = make_conv(channels_in, channels_out, stride=2)
        self.blocks = nn.Sequential(*(ResidualBlock(channels_out) for _ in range(blocks)))

    def forward(self, x: Tensor) -> Tensor:
        features: Tensor = self.blocks(functional.relu(self.down(x), inplace=True))
        return features


class DecoderStage(nn.Module):
    """Double the resolution of (N, C, H, W) and add the encoder's features of that size."""

    def __init__(self, channels_in: int, skip: int, channels_out: int, block: Block) -> None:
        super().__init__()
        self.reduce = make_conv(channels_in, channels_out, kernel=1)
        self.lateral = make_conv(skip, channels_out, kernel=1)
        self.block = block(channels_out)

    def forward(self, x: Tensor, skip: Tensor) -> Tensor:
        up = functional.interpolate(self.reduce(x), scale_factor=2.0, mode="nearest")
        merged: Tensor = self.block(functional.relu(up + self.lateral(skip), inplace=True))
        return merged


class Decoder(nn.Module):
    """Features at ever doubled strides, (N, C, H, W) each, to `maps` at the first: class logits.

    `channels` are those of the features, `widths` those of each stage, both from the first stride
    on, which is 2 for the networks of classes.
    """

    def __init__(
        self,
        channels: Sequence[int],
        widths: Sequence[int],
        block: Block = ResidualBlock,
        maps: int = CLASS_COUNT,
    ) -> None:
        super().__init__()
        deep = (*widths[1:], channels[-1])
        self.stages = nn.ModuleList(
            DecoderStage(deep[i], channels[i], widths[i], block)
            for i in reversed(range(len(widths)))
        )
        self.head = nn.Conv2d(widths[0], maps, 1)

    def merge(self, features: list[Tensor]) -> list[Tensor]:
        """Merge the features from the deepest on: what each stage makes, the first stride last."""
        *skips, x = features
        merged = []
        for stage in self.stages:
            x = stage(x, skips.pop())
            merged.append(x)
        return merged

    def forward(self, features: list[Tensor]) -> Tensor:
        logits: Tensor = self.head(self.merge(features)[-1])
        return logits


class CropWeedNet(nn.Module):
    """Image to class logits, in the class order of `PlantClass`.

    Input (N, 3, H, W): red green blue in [-1, 1], H and W multiples of STRIDE_PX.
    Output (N, 3, H / 2, W / 2).
    """

    def __init__(
        self,
        widths: Widths = (16, 24, 48, 64, 96),
        blocks: tuple[int, int, int, int] = (1, 1, 2, 2),
        decoder: tuple[int, int, int, int] = (16, 24, 32, 48),
    ) -> None:
        super().__init__()
        self.stem = make_conv(3, widths[0], stride=2)
        self.encoder = nn.ModuleList(
            EncoderStage(widths[i], widths[i + 1], blocks[i]) for i in range(4)
        )
        self.decoder = Decoder(widths, decoder)

    def encode(self, x: Tensor) -> list[Tensor]:
        """Make the features at strides of 2, 4, 8, 16 and 32."""
        features = [functional.relu(self.stem(x), inplace=True)]
        for stage in self.encoder:
            features.append(stage(features[-1]))
        return features

    def forward(self, x: Tensor) -> Tensor:
        logits: Tensor = self.decoder(self.encode(x))
        return logits


class LiteNet(nn.Module):
    """As `CropWeedNet`, (N, 3, H, W) too, with an encoder of `efficientnet.LiteEncoder`."""

    def __init__(self, stages: int, decoder: Sequence[int], block: Block = ResidualBlock) -> None:
        super().__init__()
        self.encoder = LiteEncoder(stages)
        self.decoder = Decoder(self.encoder.channels, decoder, block)

    def forward(self, x: Tensor) -> Tensor:
        logits: Tensor = self.decoder(self.encoder(x))
        return logits


def load_encoder(network: nn.Module) -> None:
    """Load the encoder's weights of ImageNet.

    Raises: ConfigError: the package with the weights of ImageNet is not installed.
    """
    assert isinstance(network, LiteNet)
    load_imagenet(network.encoder)


def count_parameters(network: nn.Module) -> int:
    return sum(parameter.numel() for parameter in network.parameters())
