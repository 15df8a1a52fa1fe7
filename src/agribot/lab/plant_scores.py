"""Scores of single plants: those that a robot finds in pictures against those that stand there.

Panoptic quality after Kirillov et al. 2019, Panoptic segmentation.
"""

from __future__ import annotations

from typing import NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt

from agribot.core.messages import ByteArray, FloatArray, PlantClass
from agribot.sim.plant_judge import find_pairs, find_percentile

MATCH_RADIUS_M = 0.05  # distance on the ground; a plant farther from every true one was not there
MATCH_IOU = 0.5  # overlap above which no segment has two partners

Mask = npt.NDArray[np.bool_]


class PlacedPlants(NamedTuple):
    """Plants on the ground of one picture: stems (N, 2) in one frame, and PlantClass (N,)."""

    places_m: FloatArray
    kind: ByteArray

    def choose(self, wanted: Mask) -> PlacedPlants:
        """Choose the plants for which `wanted` (N,) is true."""
        return PlacedPlants(self.places_m[wanted], self.kind[wanted])


class PlantSegments(NamedTuple):
    """Plants as pixels of one picture.

    `number` (H, W) is the plant of each pixel, counted from 1, or 0; `kind` (N,) its PlantClass.
    """

    number: npt.NDArray[np.integer]
    kind: ByteArray


class KindTally(msgspec.Struct, kw_only=True):
    """Counts of one class, and the sum of the overlaps of its matched segments."""

    truth: int = 0
    answers: int = 0
    matched: int = 0
    segments_truth: int = 0
    segments_answers: int = 0
    segments_matched: int = 0
    iou_sum: float = 0.0

    def add(self, other: KindTally) -> None:
        for name in self.__struct_fields__:
            setattr(self, name, getattr(self, name) + getattr(other, name))

    @property
    def recall(self) -> float | None:
        return self.matched / self.truth if self.truth else None

    @property
    def precision(self) -> float | None:
        return self.matched / self.answers if self.answers else None

    @property
    def panoptic_quality(self) -> float | None:
        """Matched overlap over matched segments and half of those without a partner."""
        both = self.segments_truth + self.segments_answers
        return 2.0 * self.iou_sum / both if both else None


class PlantScores(msgspec.Struct, frozen=True, kw_only=True):
    """Figures of single plants; None where there was nothing to judge.

    `crops_hit` counts true crops in whose place only a weed was found. `pq` is the mean of both
    classes.
    """

    crops_truth: int
    weeds_truth: int
    crop_recall: float | None
    crop_precision: float | None
    stem_error_median_m: float | None
    stem_error_p95_m: float | None
    weed_recall: float | None
    weed_precision: float | None
    crops_hit: int
    pq: float | None


class PlantTally(msgspec.Struct, kw_only=True):
    """Add the plants and the segments of picture after picture, then ask for the scores."""

    weed: KindTally = msgspec.field(default_factory=KindTally)
    crop: KindTally = msgspec.field(default_factory=KindTally)
    crops_hit: int = 0
    distances_m: list[float] = []

    def add_plants(
        self, truth: PlacedPlants, answer: PlacedPlants, unjudged: PlacedPlants | None = None
    ) -> None:
        """Match the plants of a picture, one to one and class by class, within MATCH_RADIUS_M.

        `unjudged` are true plants that need not be found: an answer that fits none but them is
        neither right nor wrong.
        """
        if unjudged is None:
            unjudged = truth.choose(np.zeros(len(truth.kind), dtype=bool))
        is_found = np.zeros(len(truth.kind), dtype=bool)
        is_spare = np.ones(len(answer.kind), dtype=bool)
        for kind, tally in self._by_kind():
            pairs = _pair(truth, answer, truth.kind == kind, answer.kind == kind)
            is_found[pairs[:, 0]] = True
            is_spare[pairs[:, 1]] = False
            gaps_m = truth.places_m[pairs[:, 0]] - answer.places_m[pairs[:, 1]]
            self.distances_m += np.hypot(*gaps_m.T).tolist()
            fits = _pair(unjudged, answer, unjudged.kind == kind, is_spare & (answer.kind == kind))
            is_spare[fits[:, 1]] = False
            tally.truth += int((truth.kind == kind).sum())
            tally.answers += int((answer.kind == kind).sum()) - len(fits)
            tally.matched += len(pairs)
        hit = _pair(
            truth,
            answer,
            ~is_found & (truth.kind == PlantClass.CROP),
            is_spare & (answer.kind == PlantClass.WEED),
        )
        self.crops_hit += len(hit)

    def add_segments(
        self, truth: PlantSegments, answer: PlantSegments, unjudged: Mask
    ) -> npt.NDArray[np.intp]:
        """Match the segments of a picture (H, W), class by class, by overlaps above MATCH_IOU.

        The pixels `unjudged` (H, W) count in no overlap. An answer that lies more in them than
        beside them, and has no partner, is neither right nor wrong. Returns the partners, indices
        (K, 2) of true plants and of answers.
        """
        true_count, count = len(truth.kind), len(answer.kind)
        own_px = np.bincount(answer.number.ravel(), minlength=count + 1)[1:]
        pixels = truth.number[~unjudged].astype(np.int64) * (count + 1) + answer.number[~unjudged]
        shared_px = np.bincount(pixels, minlength=(true_count + 1) * (count + 1))
        shared_px = shared_px.reshape(true_count + 1, count + 1)
        true_px, judged_px = shared_px.sum(axis=1)[1:], shared_px.sum(axis=0)[1:]
        both_px = true_px[:, None] + judged_px[None] - shared_px[1:, 1:]
        iou = shared_px[1:, 1:] / np.maximum(both_px, 1)
        fits = (iou > MATCH_IOU) & (truth.kind[:, None] == answer.kind[None])
        is_judged = fits.any(axis=0) | (judged_px * 2 >= np.maximum(own_px, 1))
        for kind, tally in self._by_kind():
            of_kind = fits[truth.kind == kind]
            tally.segments_truth += int(((truth.kind == kind) & (true_px > 0)).sum())
            tally.segments_answers += int(((answer.kind == kind) & is_judged).sum())
            tally.segments_matched += int(of_kind.sum())
            tally.iou_sum += float(iou[truth.kind == kind][of_kind].sum())
        return np.argwhere(fits)

    def add(self, other: PlantTally) -> None:
        """Add all that another tally has counted."""
        self.weed.add(other.weed)
        self.crop.add(other.crop)
        self.crops_hit += other.crops_hit
        self.distances_m += other.distances_m

    def compute_scores(self) -> PlantScores:
        qualities = [tally.panoptic_quality for _, tally in self._by_kind()]
        known = [quality for quality in qualities if quality is not None]
        return PlantScores(
            crops_truth=self.crop.truth,
            weeds_truth=self.weed.truth,
            crop_recall=self.crop.recall,
            crop_precision=self.crop.precision,
            stem_error_median_m=find_percentile(self.distances_m, 50.0),
            stem_error_p95_m=find_percentile(self.distances_m, 95.0),
            weed_recall=self.weed.recall,
            weed_precision=self.weed.precision,
            crops_hit=self.crops_hit,
            pq=sum(known) / len(known) if known else None,
        )

    def _by_kind(self) -> tuple[tuple[PlantClass, KindTally], ...]:
        return (PlantClass.WEED, self.weed), (PlantClass.CROP, self.crop)


def _pair(
    truth: PlacedPlants, answer: PlacedPlants, of_truth: Mask, of_answer: Mask
) -> npt.NDArray[np.intp]:
    """Pair some of the true with some of the found plants: indices (K, 2) among all of each."""
    pairs = find_pairs(truth.places_m[of_truth], answer.places_m[of_answer], MATCH_RADIUS_M)
    return np.column_stack(
        [np.flatnonzero(of_truth)[pairs[:, 0]], np.flatnonzero(of_answer)[pairs[:, 1]]]
    )
