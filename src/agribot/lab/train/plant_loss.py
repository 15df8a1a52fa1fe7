"""The loss of stems and ways against `plant_targets`; maps are (N, WAY.stop, rows, columns)."""

from __future__ import annotations

from collections.abc import Callable

from torch import Tensor
from torch.nn import functional

from agribot.lab.train.plant_targets import (
    HEAT,
    HEAT_WEIGHT,
    SQUARES,
    WAY,
    WAY_WEIGHT,
    join_labels,
)

# Source: Zhou et al. 2019 (CenterNet), equation 1.
SURE_POWER, NEAR_POWER = 2.0, 4.0
WAY_SHARE = 5.0
CLASS_SHARE = 2.0


def joint_loss(
    logits: Tensor, maps: Tensor, target: Tensor, class_loss: Callable[[Tensor, Tensor], Tensor]
) -> Tensor:
    """Add the loss of classes, from logits (N, 3, h, w), to that of stems and ways.

    Where a batch has no stems, such as photographs, the classes alone count; where the
    classes do not learn, the stems and ways.
    """
    plants = plant_loss(maps, target)
    if not logits.requires_grad:
        return plants
    return CLASS_SHARE * class_loss(logits, join_labels(target)) + plants


def plant_loss(maps: Tensor, target: Tensor) -> Tensor:
    """Add the focal loss of the heat, for each stem, and the mean error of the ways.

    `maps` are the logits of the heat of weeds and crops in each square, and the ways, right and
    down; `target` (N, MAPS, rows, columns). A square without a stem counts as its share of a cell,
    so that scores mean the same however fine the squares are.
    """
    heat, truth = maps[:, HEAT], target[:, HEAT]
    sure = heat.sigmoid()
    is_stem = truth == 1.0
    hit = (1.0 - sure) ** SURE_POWER * functional.logsigmoid(heat)
    clear = (1.0 - truth) ** NEAR_POWER * sure**SURE_POWER * functional.logsigmoid(-heat)
    focal = -(hit.where(is_stem, clear / SQUARES**2) * target[:, HEAT_WEIGHT]).sum()
    stems = (is_stem * target[:, HEAT_WEIGHT]).sum().clamp(min=1.0)
    weight = target[:, WAY_WEIGHT]
    error = (maps[:, WAY] - target[:, WAY]).abs().sum(dim=1, keepdim=True)
    return focal / stems + WAY_SHARE * (weight * error).sum() / weight.sum().clamp(min=1e-6)
