"""How much a network has to lean to weed, so that it names plants on rows and between them alike.

Weeds between rows are few, and a training forgets them for the crop. On pictures that it does not
learn from, the logit of weed is raised or lowered until crop on rows and weed between them are
named rightly most often, in their mean.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import torch
from torch import Tensor, nn

from agribot.core.messages import FloatArray, PlantClass
from agribot.lab.adapt.row_figures import LOWER_RATIO
from agribot.lab.train.data import LabelledImage
from agribot.lab.train.export import make_deployed
from agribot.lab.train.features import centred_rgb
from agribot.lab.train.judged_figures import BALANCED
from agribot.lab.train.standing import Judgement
from agribot.lab.train.validation import shrink_pair

OFFSETS = np.linspace(-2.0, 2.0, 41)  # offsets of the logit of weed


class BalanceJudge:
    """Judges networks on pictures and what their rows say, at their input of (height, width)."""

    def __init__(
        self,
        pictures: Sequence[LabelledImage],
        size_px: tuple[int, int],
        features: Callable[[Tensor], Tensor] = centred_rgb,
    ) -> None:
        self._pictures = [shrink_pair(*picture, size_px) for picture in pictures]
        self._size_px, self._features = size_px, features

    def __call__(self, network: nn.Module) -> Judgement:
        """Return the mean of crop on rows and weed between them, with the best offset."""
        return {BALANCED: float(self._score(network).max())}

    def balance(self, network: nn.Module) -> float:
        """Give a network the best offset, and return it; 0 where its last layer has none."""
        head = find_head(network)
        if head is None or head.bias is None:
            return 0.0
        scores = self._score(network)
        best = OFFSETS[scores >= scores.max() - 1e-9]
        offset = float(best[np.abs(best).argmin()])
        with torch.no_grad():
            head.bias[PlantClass.WEED] += offset
        return offset

    def _score(self, network: nn.Module) -> FloatArray:
        """Score each of the offsets, 0 to 1."""
        deployed = make_deployed(network, *self._size_px, self._features).eval()
        right = {PlantClass.CROP: np.zeros(len(OFFSETS)), PlantClass.WEED: np.zeros(len(OFFSETS))}
        count = dict.fromkeys(right, 0)
        for image_rgb, truth in self._pictures:
            logits = self._answer(deployed, image_rgb)
            top = round((1.0 - LOWER_RATIO) * len(truth))
            for kind in right:
                here = logits[:, top:][:, truth[top:] == kind]
                right[kind] += _count_right(here, kind)
                count[kind] += here.shape[1]
        shares = [right[kind] / max(count[kind], 1) for kind in right]
        mean: FloatArray = np.mean(shares, axis=0)
        return mean

    @staticmethod
    def _answer(deployed: nn.Module, image_rgb: np.ndarray) -> FloatArray:
        with torch.no_grad():
            logits: Tensor = deployed.logits(torch.from_numpy(image_rgb[None].copy()))  # type: ignore[operator]
        answer: FloatArray = logits[0].double().numpy()
        return answer


def _count_right(logits: FloatArray, kind: PlantClass) -> FloatArray:
    """Count the pixels (3, N) that get this name, for each offset."""
    weed = logits[PlantClass.WEED] + OFFSETS[:, np.newaxis]
    crop, soil = logits[PlantClass.CROP], logits[PlantClass.SOIL]
    if kind is PlantClass.WEED:
        is_right = (weed > crop) & (weed > soil)
    else:
        is_right = (crop >= weed) & (crop > soil)
    counts: FloatArray = is_right.sum(axis=1).astype(np.float64)
    return counts


def find_head(network: nn.Module) -> nn.Conv2d | None:
    """Find the layer that makes the logits of the classes; None in a network of another build."""
    decoder = getattr(getattr(network, "classes", network), "decoder", None)
    head = getattr(decoder, "head", None)
    return head if isinstance(head, nn.Conv2d) else None
