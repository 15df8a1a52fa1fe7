"""What the network is taught to make small."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from agribot.train.network import CLASS_COUNT

# Order weed, crop, soil: the rarer, the heavier.
CLASS_WEIGHTS = (2.0, 1.5, 0.6)
# Label of a pixel that does not count: above the horizon, or outside an augmented crop.
IGNORED = 255


def dice_loss(logits: Tensor, target: Tensor) -> Tensor:
    """1 - mean overlap of the classes present in the batch; `target` (N, H, W) int64.

    It sees small classes as large as big ones, which cross-entropy does not.
    Source: Milletari et al. 2016.
    """
    valid = (target != IGNORED).unsqueeze(1)
    truth = functional.one_hot(target.clamp(max=CLASS_COUNT - 1), CLASS_COUNT)
    truth = truth.permute(0, 3, 1, 2) * valid
    guess = logits.softmax(dim=1) * valid
    overlap = (guess * truth).sum(dim=(0, 2, 3))
    total = guess.sum(dim=(0, 2, 3)) + truth.sum(dim=(0, 2, 3))
    present = truth.sum(dim=(0, 2, 3)) > 0
    ratio = (2.0 * overlap + 1.0) / (total + 1.0)
    return 1.0 - ratio[present].mean()


def segmentation_loss(logits: Tensor, target: Tensor) -> Tensor:
    """Weighted cross-entropy plus dice, on logits at half the resolution of `target`."""
    full = functional.interpolate(logits, scale_factor=2.0, mode="bilinear", align_corners=False)
    weights = torch.tensor(CLASS_WEIGHTS)
    entropy = functional.cross_entropy(full, target, weights, ignore_index=IGNORED)
    return entropy + dice_loss(full, target)
