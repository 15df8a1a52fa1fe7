"""The plant network: the classes of pixels, and a branch for the stems of single plants."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from agribot.lab.train.network import (
    CropWeedNet,
    Decoder,
    EncoderStage,
    PlainBlock,
    make_conv,
)
from agribot.lab.train.plant_targets import HEAT, WAY

# Widths of the branch at strides of 4, 8, 16 and 32, and its residual blocks from the second on.
WIDTHS, BLOCKS = (32, 48, 80, 128), (1, 2, 2)
# Network of the classes: widths of the encoder at strides of 2 to 32, the blocks of each stage, and
# the way back up.
CLASS_WIDTHS, CLASS_BLOCKS, CLASS_DECODER = (16, 24, 48, 80, 128), (1, 1, 2, 2), (16, 24, 32, 48)
ENCODED_WIDTH, MERGED_WIDTH = CLASS_WIDTHS[1], CLASS_DECODER[1]  # their features at stride 4
BRANCH_MAPS = WAY.stop  # heat of weeds and of crops in each square, way right and down
# Bias before training, when nearly every cell holds no stem.
HEAT_BIAS = -3.0


class PlantBranch(nn.Module):
    """Features at stride 4, (N, C, H, W), to (N, BRANCH_MAPS, H, W).

    It looks anew at the shape of whole plants: the network of classes separates leaves from soil.
    """

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.enter = make_conv(channels, WIDTHS[0], kernel=1)
        self.encoder = nn.ModuleList(
            EncoderStage(WIDTHS[i], WIDTHS[i + 1], BLOCKS[i]) for i in range(len(BLOCKS))
        )
        self.decoder = Decoder(WIDTHS, WIDTHS[:-1], PlainBlock, BRANCH_MAPS)
        bias = self.decoder.head.bias
        assert bias is not None
        with torch.no_grad():
            bias[HEAT] = HEAT_BIAS

    def forward(self, x: Tensor) -> Tensor:
        features = [functional.relu(self.enter(x), inplace=True)]
        for stage in self.encoder:
            features.append(stage(features[-1]))
        maps: Tensor = self.decoder(features)
        return maps


class PlantNet(nn.Module):
    """Image to class logits, and to heat and ways of the stems, cell by cell as in targets.

    Input as of `CropWeedNet`, (N, 3, H, W). Output its logits (N, 3, H / 2, W / 2) and
    (N, BRANCH_MAPS, H / 4, W / 4).
    """

    def __init__(self) -> None:
        super().__init__()
        self.classes = CropWeedNet(CLASS_WIDTHS, CLASS_BLOCKS, CLASS_DECODER)
        self.plants = PlantBranch(ENCODED_WIDTH + MERGED_WIDTH)
        self._keeps_classes = False

    def keep_classes(self) -> None:
        """Let only the stems learn: the classes stay, bit by bit, what they are."""
        self._keeps_classes = True
        self.classes.requires_grad_(requires_grad=False)

    def train(self, mode: bool = True) -> PlantNet:
        super().train(mode)
        if self._keeps_classes:
            self.classes.eval()
        return self

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        features = self.classes.encode(x)
        merged = self.classes.decoder.merge(features)
        logits = self.classes.decoder.head(merged[-1])
        return logits, self.plants(torch.cat([features[1], merged[-2]], dim=1))
