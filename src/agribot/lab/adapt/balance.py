"""How much a network has to lean to weed or crop, so that plants get the right names.

Weeds between rows are few, and a training forgets them for the crop. On pictures that it does not
learn from, the logit of weed is raised or lowered until crop on rows and weed between them are
named rightly most often, in their mean: while it learns by look, in the end as a robot names them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import torch
from torch import Tensor, nn

from agribot.autonomy.perceive.class_map import ClassMap
from agribot.autonomy.perceive.pictures import PictureClasses
from agribot.autonomy.perceive.plant_names import name_plants
from agribot.autonomy.perceive.stems import PlantMaps
from agribot.core.messages import ByteArray, FloatArray, PlantClass
from agribot.lab.adapt.place_names import PlaceNames, TaughtPicture
from agribot.lab.adapt.row_figures import LOWER_RATIO, RowTally
from agribot.lab.train.export import DeployedNet, make_deployed
from agribot.lab.train.features import centred_rgb
from agribot.lab.train.judged_figures import BALANCED
from agribot.lab.train.standing import Judgement
from agribot.lab.train.validation import shrink_pair

# Offsets of the logit of weed: by look, and as a robot names plants.
OFFSETS, NAMED_OFFSETS = np.linspace(-2.0, 2.0, 41), np.linspace(-1.6, 1.6, 17)


class BalanceJudge:
    """Judges networks on pictures and what their rows say, at their input of (height, width)."""

    def __init__(
        self,
        pictures: Sequence[TaughtPicture],
        size_px: tuple[int, int],
        features: Callable[[Tensor], Tensor] = centred_rgb,
    ) -> None:
        self._pictures = [
            TaughtPicture(*shrink_pair(*picture.labelled, size_px), picture.camera)
            for picture in pictures
        ]
        self._size_px, self._features = size_px, features

    def __call__(self, network: nn.Module) -> Judgement:
        """Return the mean of crop on rows and weed between them, by look, at its best offset."""
        return {BALANCED: float(self._score(network).max())}

    def balance(self, network: nn.Module) -> float:
        """Give the logit of weed its best offset, and return it; 0 where the last layer has none.

        Of equally good ones it is the smallest.
        """
        head = find_head(network)
        if head is None or head.bias is None:
            return 0.0
        scores = self._score_names(network)
        best = NAMED_OFFSETS[scores >= scores.max() - 1e-9]
        offset = float(best[np.abs(best).argmin()])
        with torch.no_grad():
            head.bias[PlantClass.WEED] += offset
        return offset

    def _score_names(self, network: nn.Module) -> FloatArray:
        """Score each of NAMED_OFFSETS, 0 to 1, by the names that a robot would give."""
        deployed, names = self._deploy(network), PlaceNames()
        tallies = [RowTally() for _ in NAMED_OFFSETS]
        for picture in self._pictures:
            leant = _lean(deployed, picture.image_rgb, NAMED_OFFSETS)
            for tally, class_map in zip(tallies, leant, strict=True):
                classes = PictureClasses(class_map.class_id, class_map.confidence)
                tally.add(*names.name(classes, picture))
        return np.array([tally.make_figures().balanced or 0.0 for tally in tallies])

    def _deploy(self, network: nn.Module) -> DeployedNet:
        return make_deployed(network, *self._size_px, self._features).eval()

    def _score(self, network: nn.Module) -> FloatArray:
        """Score each of OFFSETS, 0 to 1, by look."""
        deployed = self._deploy(network)
        right = {PlantClass.CROP: np.zeros(len(OFFSETS)), PlantClass.WEED: np.zeros(len(OFFSETS))}
        count = dict.fromkeys(right, 0)
        for image_rgb, truth, _ in self._pictures:
            logits = _answer(deployed, image_rgb)[0].double().numpy()
            top = round((1.0 - LOWER_RATIO) * len(truth))
            for kind in right:
                here = logits[:, top:][:, truth[top:] == kind]
                right[kind] += _count_right(here, kind)
                count[kind] += here.shape[1]
        shares = [right[kind] / max(count[kind], 1) for kind in right]
        mean: FloatArray = np.mean(shares, axis=0)
        return mean


def _answer(deployed: DeployedNet, image_rgb: ByteArray) -> Tensor:
    """Return the logits (1, 3, h, w) of a picture."""
    with torch.no_grad():
        return deployed.logits(torch.from_numpy(image_rgb[None].copy()))


def _lean(deployed: DeployedNet, image_rgb: ByteArray, offsets: FloatArray) -> Iterator[ClassMap]:
    """Classify a picture with each offset of the logit of weed; a plant has one name."""
    logits = _answer(deployed, image_rgb)
    with torch.no_grad():
        _, _, *maps = deployed(torch.from_numpy(image_rgb[None].copy()))
    plants = PlantMaps(stem_score=maps[0].numpy(), way_px=maps[1].numpy()) if maps else None
    for offset in offsets.tolist():
        leant = logits.clone()
        leant[:, PlantClass.WEED] += offset
        class_id, confidence = (one.numpy() for one in deployed.classify(leant))
        yield name_plants(
            ClassMap(class_id=class_id, confidence=confidence, scale_px=(1.0, 1.0), plants=plants)
        )


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
