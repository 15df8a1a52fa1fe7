"""How well a network does while it learns, on pictures set aside for that alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt
import torch
from PIL import Image
from torch import Tensor, nn

from agribot.autonomy.perceive.stems import PlantMaps, find_stems
from agribot.core.messages import ByteArray
from agribot.lab.dataset.pictures import resize_nearest
from agribot.lab.train.data import LabelledImage
from agribot.lab.train.evaluate import compute_scores, count_confusion
from agribot.lab.train.export import DeployedNet, make_deployed
from agribot.lab.train.features import centred_rgb
from agribot.lab.train.judged_figures import MIOU, STEM_F1
from agribot.lab.train.plant_truth import DrawnView, PlantTruth
from agribot.lab.train.standing import Judgement
from agribot.sim.plant_judge import find_pairs

Counts = npt.NDArray[np.int64]

LEAST_STEM_SCORE = 0.2
STEM_RADIUS_PX = 12.0
LEAST_PX = 30  # pixels of a plant that has to be found; one with fewer may be


class HeldOutPictures:
    """Judges a network on pictures at the size at which it works: (`height_px`, `width_px`).

    Views with plants judge the stems as well, of a network that finds them.
    """

    def __init__(
        self,
        pictures: Sequence[LabelledImage | DrawnView],
        size_px: tuple[int, int],
        features: Callable[[Tensor], Tensor] = centred_rgb,
    ) -> None:
        self._pictures, self._size_px, self._features = pictures, size_px, features

    def __call__(self, network: nn.Module) -> Judgement:
        deployed = make_deployed(network, *self._size_px, self._features).eval()
        confusion = np.zeros((3, 3), dtype=np.int64)
        stems = np.zeros(3, dtype=np.int64)
        for picture in self._pictures:
            class_id, *maps = _answer(deployed, network, picture[0])
            confusion += count_confusion(resize_nearest(picture[1], self._size_px), class_id)
            if maps and isinstance(picture, DrawnView):
                stems += count_stems(PlantMaps(stem_score=maps[0], way_px=maps[1]), picture.plants)
        judged = {MIOU: compute_scores(confusion, len(self._pictures)).miou}
        pairs, found, true = stems.tolist()
        if found + true:
            judged[STEM_F1] = 2.0 * pairs / (found + true)
        return judged


def shrink_pair(image_rgb: ByteArray, label: ByteArray, size_px: tuple[int, int]) -> LabelledImage:
    """Bring a photograph (H, W, 3) and its classes (H, W) to the size at which it is judged."""
    picture = Image.fromarray(image_rgb).resize(size_px[::-1], Image.Resampling.BILINEAR)
    return np.asarray(picture), resize_nearest(label, size_px)


def _answer(deployed: DeployedNet, network: nn.Module, image_rgb: np.ndarray) -> list[np.ndarray]:
    """Return the classes, and the maps of stems and ways if the network makes any."""
    device = next(network.parameters()).device
    with torch.inference_mode():
        class_id, _, *maps = deployed(torch.from_numpy(image_rgb.copy())[None].to(device))
    return [one.cpu().numpy() for one in (class_id, *maps)]


def count_stems(maps: PlantMaps, plants: PlantTruth) -> Counts:
    """Count pairs of found and true stems of one class, those found, and those to be found.

    A stem that fits a plant with too few visible pixels counts as not found.
    """
    stems = find_stems(maps, LEAST_STEM_SCORE)
    found_kind = stems.kind_scores.argmax(axis=1)
    height, width = plants.number.shape
    seen_px = np.bincount(plants.number.ravel(), minlength=len(plants.kind) + 1)[1:]
    inside = ((plants.stem_px >= -0.5) & (plants.stem_px < (width - 0.5, height - 0.5))).all(axis=1)
    is_wanted = inside & (seen_px >= LEAST_PX)
    counts = np.zeros(3, dtype=np.int64)
    for kind in np.unique([*plants.kind, *found_kind]):
        found_px = stems.uv_px[found_kind == kind]
        wanted_px = plants.stem_px[is_wanted & (plants.kind == kind)]
        pairs = find_pairs(wanted_px, found_px, STEM_RADIUS_PX)
        spare_px = np.delete(found_px, pairs[:, 1], axis=0)
        others_px = plants.stem_px[~is_wanted & (plants.kind == kind)]
        small = find_pairs(others_px, spare_px, STEM_RADIUS_PX)
        counts += (len(pairs), len(found_px) - len(small), len(wanted_px))
    return counts
