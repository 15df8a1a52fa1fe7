"""The two networks of the original robot, layer by layer, for comparison.

Both start from Glorot-uniform weights and zero biases, as Keras does. Source: the public code of
the original robot; Ronneberger et al. 2015 (U-Net), Milioto et al. 2018 (Bonnet).
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from agribot.lab.train.network import CLASS_COUNT

UNET_WIDTHS = (16, 32, 64, 128)
UNET_BOTTOM = 256
BONNET_WIDTH = 16
BONNET_INNER = 8
BONNET_CHANNELS = 10
BONNET_LEVELS = 4
BLOCKS_PER_LEVEL = 3


def _make_conv_relu(channels_in: int, channels_out: int) -> nn.Sequential:
    return nn.Sequential(nn.Conv2d(channels_in, channels_out, 3, padding=1), nn.ReLU())


def _initialise(network: nn.Module) -> None:
    for module in network.modules():
        if isinstance(module, nn.Conv2d) and module.bias is not None:
            nn.init.xavier_uniform_(module.weight)
            nn.init.zeros_(module.bias)


class OriginalUNet(nn.Module):
    """(N, 3, H, W) in [0, 1] to logits (N, 3, H, W); H and W multiples of 16.

    The original's last layer is linear, as it should be: `relu_logits` only repeats on this
    network what spoils the original's Bonnet.
    """

    def __init__(self, relu_logits: bool = False, dropout: float = 0.5) -> None:
        super().__init__()
        deep = (*UNET_WIDTHS[1:], UNET_BOTTOM)
        self.encoder = nn.ModuleList(
            nn.Sequential(
                _make_conv_relu(before, width), *(_make_conv_relu(width, width) for _ in range(2))
            )
            for before, width in zip((3, *UNET_WIDTHS), UNET_WIDTHS, strict=False)
        )
        self.bottom = nn.Sequential(
            _make_conv_relu(UNET_WIDTHS[-1], UNET_BOTTOM), _make_conv_relu(UNET_BOTTOM, UNET_BOTTOM)
        )
        levels = list(zip(deep, UNET_WIDTHS, strict=True))[::-1]
        self.up = nn.ModuleList(_make_conv_relu(below, width) for below, width in levels)
        self.decoder = nn.ModuleList(
            nn.Sequential(_make_conv_relu(2 * width, width), _make_conv_relu(width, width))
            for _, width in levels
        )
        self.dropout = nn.Dropout(dropout)
        self.head = nn.Conv2d(UNET_WIDTHS[0], CLASS_COUNT, 1)
        self.relu_logits = relu_logits
        _initialise(self)

    def forward(self, x: Tensor) -> Tensor:
        skips = []
        for block in self.encoder:
            x = block(x)
            skips.append(x)
            x = self.dropout(functional.max_pool2d(x, 2))
        x = self.bottom(x)
        for up, block in zip(self.up, self.decoder, strict=True):
            x = up(functional.interpolate(x, scale_factor=2.0, mode="nearest"))
            x = self.dropout(block(torch.cat([skips.pop(), x], dim=1)))
        logits: Tensor = self.head(x)
        return functional.relu(logits) if self.relu_logits else logits


class BonnetResidual(nn.Module):
    """Four thin convolutions with bias and ReLU, added to their input (N, C, H, W)."""

    def __init__(self) -> None:
        super().__init__()
        wide, thin = BONNET_WIDTH, BONNET_INNER
        self.layers = nn.Sequential(
            nn.Conv2d(wide, thin, 1), nn.ReLU(),
            nn.Conv2d(thin, thin, (5, 1), padding=(2, 0)), nn.ReLU(),
            nn.Conv2d(thin, thin, (1, 5), padding=(0, 2)), nn.ReLU(),
            nn.Conv2d(thin, wide, 1), nn.ReLU(),
        )  # fmt: skip

    def forward(self, x: Tensor) -> Tensor:
        added: Tensor = x + self.layers(x)
        return added


class OriginalBonnet(nn.Module):
    """(N, 10, H, W) channels to logits (N, 3, H, W); H and W multiples of 16.

    With `relu_logits`, as in the original, a negative logit is lost: a pixel can be sure of no
    class, and where all three are negative nothing is learnt. Without it the head is corrected.
    """

    def __init__(self, relu_logits: bool) -> None:
        super().__init__()
        self.stem = nn.Conv2d(BONNET_CHANNELS, BONNET_WIDTH, 5, padding=2)
        self.norm = nn.BatchNorm2d(BONNET_WIDTH, eps=1e-3, momentum=0.01)
        self.encoder = nn.ModuleList(_make_residuals() for _ in range(BONNET_LEVELS))
        self.decoder = nn.ModuleList(_make_residuals() for _ in range(BONNET_LEVELS))
        self.head = nn.Conv2d(BONNET_WIDTH, CLASS_COUNT, 1)
        self.relu_logits = relu_logits
        _initialise(self)

    def forward(self, x: Tensor) -> Tensor:
        x = self.norm(functional.relu(self.stem(x)))
        masks = []
        for level in self.encoder:
            full = level(x)
            x = functional.max_pool2d(full, 2)
            masks.append(unpooling_mask(full, x))
        for level in self.decoder:
            x = functional.interpolate(x, scale_factor=2.0, mode="nearest")
            x = level(x * masks.pop())
        logits: Tensor = self.head(x)
        return functional.relu(logits) if self.relu_logits else logits


def _make_residuals() -> nn.Sequential:
    return nn.Sequential(*(BonnetResidual() for _ in range(BLOCKS_PER_LEVEL)))


def unpooling_mask(full: Tensor, pooled: Tensor) -> Tensor:
    """Mark with 1 what equals the maximum of its 2 x 2 window in (N, C, H, W); ties all count."""
    enlarged = functional.interpolate(pooled, scale_factor=2.0, mode="nearest")
    return (full >= enlarged).to(full.dtype)


def count_keras_parameters(network: nn.Module) -> int:
    """Count parameters as Keras does, with the running statistics of the normalisation."""
    statistics = sum(
        buffer.numel() for name, buffer in network.named_buffers() if "running" in name
    )
    return statistics + sum(parameter.numel() for parameter in network.parameters())
