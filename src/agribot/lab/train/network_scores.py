"""The scores of a network on a labelled set, gathered image by image."""

from __future__ import annotations

from typing import NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt

from agribot.autonomy.perceive.boundaries import boundary_counts, boundary_f1
from agribot.autonomy.perceive.instances import PlantRecall, plant_recall
from agribot.autonomy.perceive.pictures import PictureClasses
from agribot.core.messages import ByteArray, PlantClass
from agribot.lab.dataset.pictures import resize_nearest
from agribot.lab.train.evaluate import (
    CLASS_NAMES,
    ByClass,
    Confusion,
    Scores,
    compute_scores,
    count_confusion,
)

# Least piece of vegetation that is a plant to look for, at the resolution of the labels.
LEAST_PLANT_PX = 500
RELIABILITY_BINS = 15
# Width of a judged picture, kept small for the sheet of the worst ones.
THUMB_WIDTH_PX = 432

Curve = npt.NDArray[np.float64]
Sums = npt.NDArray[np.number]


class ImageScore(msgspec.Struct, frozen=True, kw_only=True):
    name: str
    miou: float
    iou: dict[str, float | None]


class Reliability(msgspec.Struct, frozen=True, kw_only=True):
    """Pixels by confidence: how often the network is right at each.

    `calibration_error` is the mean over pixels of the distance between the two. Source: Guo et
    al. 2017 (expected calibration error). `plant_error` is that over the pixels that the network
    takes for plants: most others are soil that it is sure of. None: it takes none for a plant.
    """

    confidence: tuple[float | None, ...]
    accuracy: tuple[float | None, ...]
    pixels: tuple[int, ...]
    calibration_error: float
    plant_error: float | None


class Thumbnail(NamedTuple):
    name: str
    miou: float
    image_rgb: ByteArray
    truth: ByteArray
    guess: ByteArray


class NetworkScores:
    """Scores of pooled images: one confusion matrix over all their pixels."""

    def __init__(self, keep_worst: int = 6) -> None:
        size = len(PlantClass)
        self.confusion: Confusion = np.zeros((size, size), dtype=np.int64)
        self.images: list[ImageScore] = []
        self.worst: list[Thumbnail] = []
        self._keep_worst = keep_worst
        # Pixels by confidence, called wrong (0) or right (1); and of those those called plants.
        self._by_confidence: npt.NDArray[np.int64] = np.zeros((256, 2), dtype=np.int64)
        self._plants_by_confidence: npt.NDArray[np.int64] = np.zeros((256, 2), dtype=np.int64)
        # For each class: pixels by its probability, of another class (0) or of the class (1).
        self._by_share: npt.NDArray[np.int64] = np.zeros((size, 256, 2), dtype=np.int64)
        self._recall = {name: np.zeros(3, dtype=np.int64) for name in ("weed", "crop")}
        self._outlines: npt.NDArray[np.int64] = np.zeros((size, 4), dtype=np.int64)

    def add(
        self, name: str, image_rgb: ByteArray, truth: ByteArray, guess: PictureClasses
    ) -> ImageScore:
        """Add an image (H, W, 3) with its true classes (H, W)."""
        confusion = count_confusion(truth, guess.class_id)
        self.confusion += confusion
        self._outlines += boundary_counts(truth, guess.class_id)
        one = compute_scores(confusion, 1)
        score = ImageScore(name=name, miou=one.miou, iou=one.iou)
        self.images.append(score)
        counted = truth < len(PlantClass)
        right = (truth == guess.class_id)[counted]
        both = guess.confidence[counted].astype(np.int64) * 2 + right
        self._by_confidence += np.bincount(both, minlength=512).reshape(256, 2)
        plants = both[guess.class_id[counted] != PlantClass.SOIL]
        self._plants_by_confidence += np.bincount(plants, minlength=512).reshape(256, 2)
        self._note_shares(truth[counted], guess.class_id[counted], guess.confidence[counted])
        for plant, found in plant_recall(truth, guess.class_id, LEAST_PLANT_PX).items():
            self._recall[plant] += (found.right, found.confused, found.missed)
        self._keep(score, image_rgb, truth, guess.class_id)
        return score

    @property
    def scores(self) -> Scores:
        return compute_scores(self.confusion, len(self.images))

    @property
    def boundary_f1(self) -> ByClass:
        """Score of the outlines of all images together, by the name of the class."""
        return dict(zip(CLASS_NAMES, boundary_f1(self._outlines), strict=True))

    @property
    def plants(self) -> dict[str, PlantRecall]:
        return {
            name: PlantRecall(right=int(n[0]), confused=int(n[1]), missed=int(n[2]))
            for name, n in self._recall.items()
        }

    @property
    def reliability(self) -> Reliability:
        pixels, hits, sure = _count_bins(self._by_confidence)
        plants, plant_hits, plant_sure = _count_bins(self._plants_by_confidence)
        off, total = np.abs(plant_sure - plant_hits).sum(), plants.sum()
        return Reliability(
            confidence=_divide(sure, pixels),
            accuracy=_divide(hits, pixels),
            pixels=tuple(int(n) for n in pixels),
            calibration_error=float(np.abs(sure - hits).sum() / max(1.0, float(pixels.sum()))),
            plant_error=float(off / total) if total else None,
        )

    def _note_shares(self, truth: ByteArray, guessed: ByteArray, sure: ByteArray) -> None:
        rest = (255 - sure) // (len(PlantClass) - 1)  # the losers share it in equal parts
        for kind in PlantClass:
            share = np.where(guessed == kind, sure, rest).astype(np.int64)
            pairs = np.bincount(2 * share + (truth == kind), minlength=512)
            self._by_share[kind] += pairs.reshape(256, 2)

    def precision_recall(self, kind: PlantClass) -> tuple[Curve, Curve]:
        """Compute precision and recall as the least probability of a class falls from 1 to 0."""
        others, own = self._by_share[kind][::-1].T.cumsum(axis=1)
        guessed = others + own
        kept = guessed > 0
        return own[kept] / guessed[kept], own[kept] / max(1, int(own[-1]))

    def _keep(
        self, score: ImageScore, image_rgb: ByteArray, truth: ByteArray, guess: ByteArray
    ) -> None:
        height, width = truth.shape
        shape = (max(1, round(height * THUMB_WIDTH_PX / width)), THUMB_WIDTH_PX)
        small = [resize_nearest(image_rgb[..., k], shape) for k in range(3)]
        self.worst.append(
            Thumbnail(
                score.name,
                score.miou,
                np.stack(small, axis=-1),
                resize_nearest(truth, shape),
                resize_nearest(guess, shape),
            )
        )
        self.worst.sort(key=lambda thumbnail: thumbnail.miou)
        del self.worst[self._keep_worst :]


def _count_bins(by_confidence: npt.NDArray[np.int64]) -> tuple[Sums, Sums, Sums]:
    """Count, by bin of confidence, pixels and those called right, and sum up the confidence."""
    wrong, right = by_confidence.T
    share = np.arange(256) / 255.0
    bins = np.minimum((share * RELIABILITY_BINS).astype(int), RELIABILITY_BINS - 1)
    pixels = np.bincount(bins, wrong + right, RELIABILITY_BINS)
    hits = np.bincount(bins, right, RELIABILITY_BINS)
    return pixels, hits, np.bincount(bins, share * (wrong + right), RELIABILITY_BINS)


def _divide(
    above: npt.NDArray[np.number], below: npt.NDArray[np.number]
) -> tuple[float | None, ...]:
    pairs = zip(above.tolist(), below.tolist(), strict=True)
    return tuple(a / b if b else None for a, b in pairs)


def format_scores(result: Scores) -> str:
    """Format the scores as lines of text."""
    lines = [f"{'class':6} {'IoU':>7} {'precision':>10} {'recall':>7} {'F1':>7}"]
    for name in CLASS_NAMES:
        values = (result.iou, result.precision, result.recall, result.f1)
        cells = ["-" if v[name] is None else f"{v[name]:.3f}" for v in values]
        lines.append(f"{name:6} {cells[0]:>7} {cells[1]:>10} {cells[2]:>7} {cells[3]:>7}")
    return "\n".join([*lines, f"mIoU   {result.miou:7.3f}  over {result.images} images"])
