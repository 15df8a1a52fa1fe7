"""What a network knew when it began: on drawn images it goes on to learn its own first answers.

Source: Li and Hoiem 2016, Learning without Forgetting.
"""

from __future__ import annotations

import copy

import torch
from torch import Tensor, nn
from torch.nn import functional

from agribot.lab.train.plant_targets import HEAT, HEAT_WEIGHT

# Weights of the classes and of the stems in the loss: both are small where little is forgotten.
CLASS_SHARE, STEM_SHARE = 4.0, 20.0

Answer = tuple[Tensor, Tensor]  # logits (N, 3, h, w) and maps (N, WAY.stop, rows, columns)


class FirstAnswers:
    """Compares answers with those of a network that finds plants, as it is now."""

    def __init__(self, network: nn.Module) -> None:
        self._first = copy.deepcopy(network).eval().requires_grad_(requires_grad=False)

    def lose(self, x: Tensor, answer: Answer, target: Tensor, *, bf16: bool) -> Tensor:
        """Compute how far classes and stems of the drawn images of a batch are from the first ones.

        `target` is (N, MAPS, rows, columns); a batch of photographs alone loses 0.
        """
        is_drawn = target[:, HEAT_WEIGHT].flatten(1).any(dim=1)
        if not is_drawn.any():
            return answer[0].sum() * 0.0
        with torch.no_grad(), torch.autocast(x.device.type, torch.bfloat16, enabled=bf16):
            logits, maps = self._first(x[is_drawn])
        classes = _diverge(answer[0][is_drawn].float(), logits.float())
        heat = _diverge_heat(answer[1][is_drawn, HEAT].float(), maps[:, HEAT].float())
        return CLASS_SHARE * classes + STEM_SHARE * heat


def _diverge(logits: Tensor, first: Tensor) -> Tensor:
    """Compute the mean Kullback-Leibler divergence of pixels."""
    found, wanted = (one.log_softmax(dim=1) for one in (logits, first))
    each = functional.kl_div(found, wanted, log_target=True, reduction="none")
    return each.sum(dim=1).mean()


def _diverge_heat(heat: Tensor, first: Tensor) -> Tensor:
    """Compute the mean Kullback-Leibler divergence of squares, 0 where both are the same."""
    wanted = first.sigmoid()
    found, least = (
        functional.binary_cross_entropy_with_logits(one, wanted) for one in (heat, first)
    )
    return found - least


def keep_norms(network: nn.Module) -> None:
    """Let normalisations keep their statistics, which a few pictures of a new kind would change."""
    for module in network.modules():
        if isinstance(module, nn.BatchNorm2d):
            module.eval()
