"""Judges single plants on labelled pictures: their pixels, their class and their stems."""

from __future__ import annotations

import msgspec
import numpy as np

from agribot.autonomy.perceive.picture_stems import name_kind, own_pixels
from agribot.autonomy.perceive.pictures import PictureClasses, SeenPicture
from agribot.autonomy.perceive.pieces import label_pieces
from agribot.core.messages import FloatArray, PlantClass
from agribot.lab.labelled_plants import LabelledPlants
from agribot.lab.plant_scores import PlantSegments, PlantTally
from agribot.sim.plant_judge import find_percentile

LEAST_PX = 30  # pixels of a visible plant; fewer show none: neither in truth nor in an answer


class PicturePlantScores(msgspec.Struct, frozen=True, kw_only=True):
    """Figures of single plants over pictures; None where there was nothing to judge.

    A plant is found where more than half of the pixels of it and of an answer of its class are
    common to both. `unknown` counts stems that may be of a weed or of a crop. Stems are those of
    plants that were found, in pixels of the pictures.
    """

    pictures: int
    crops_truth: int
    weeds_truth: int
    crop_recall: float | None
    crop_precision: float | None
    weed_recall: float | None
    weed_precision: float | None
    pq: float | None
    unknown: int
    stem_error_median_px: float | None
    stem_error_p95_px: float | None


class PicturePlantJudge:
    """Add picture after picture, then ask for the scores."""

    def __init__(self) -> None:
        self._tally = PlantTally()
        self._gaps_px: list[float] = []
        self._pictures, self._unknown = 0, 0

    def add(self, truth: LabelledPlants, seen: SeenPicture | PictureClasses) -> None:
        """Judge what a network says of a picture.

        With the stems of a network that finds them; else a plant is a connected piece of a class.
        """
        number = truth.segments.number
        sizes_px = np.bincount(number.ravel(), minlength=len(truth.segments.kind) + 1)
        sizes_px[0] = 0
        unjudged = (number > 0) & (sizes_px < LEAST_PX)[number]
        answer, stem_px = self._answer(seen)
        pairs = self._tally.add_segments(
            PlantSegments(np.where(unjudged, 0, number), truth.segments.kind), answer, unjudged
        )
        if stem_px is not None:
            gaps_px = truth.stem_px[pairs[:, 0]] - stem_px[pairs[:, 1]]
            gaps_px = gaps_px[np.isfinite(gaps_px).all(axis=1)]
            self._gaps_px += np.hypot(*gaps_px.T).tolist()
        self._pictures += 1

    def _answer(
        self, seen: SeenPicture | PictureClasses
    ) -> tuple[PlantSegments, FloatArray | None]:
        """Return the plants of an answer with at least LEAST_PX pixels, and their stems."""
        if isinstance(seen, PictureClasses):
            return _choose_big(_cut_pieces(seen))[0], None
        owned = own_pixels(seen)
        kinds = [name_kind(weed, crop) for weed, crop in owned.shares.tolist()]
        self._unknown += kinds.count(None)
        soil = PlantClass.SOIL  # soil is neither class
        named = np.array([soil if kind is None else kind for kind in kinds], dtype=np.uint8)
        segments, kept = _choose_big(PlantSegments(owned.number, named))
        return segments, owned.stem_px[kept]

    def compute_scores(self) -> PicturePlantScores | None:
        """Compute the scores; None before the first picture."""
        if not self._pictures:
            return None
        weed, crop, pooled = self._tally.weed, self._tally.crop, self._tally.compute_scores()
        return PicturePlantScores(
            pictures=self._pictures,
            crops_truth=crop.segments_truth,
            weeds_truth=weed.segments_truth,
            crop_recall=_divide(crop.segments_matched, crop.segments_truth),
            crop_precision=_divide(crop.segments_matched, crop.segments_answers),
            weed_recall=_divide(weed.segments_matched, weed.segments_truth),
            weed_precision=_divide(weed.segments_matched, weed.segments_answers),
            pq=pooled.pq,
            unknown=self._unknown,
            stem_error_median_px=find_percentile(self._gaps_px, 50.0),
            stem_error_p95_px=find_percentile(self._gaps_px, 95.0),
        )


def _cut_pieces(classes: PictureClasses) -> PlantSegments:
    weeds, weed_count = label_pieces(classes.class_id == PlantClass.WEED)
    crops, crop_count = label_pieces(classes.class_id == PlantClass.CROP)
    kinds = [PlantClass.WEED] * weed_count + [PlantClass.CROP] * crop_count
    number = np.where(crops > 0, crops + weed_count, weeds)
    return PlantSegments(number, np.array(kinds, dtype=np.uint8))


def _choose_big(found: PlantSegments) -> tuple[PlantSegments, np.ndarray]:
    """Leave out plants below LEAST_PX; which of them stay."""
    sizes_px = np.bincount(found.number.ravel(), minlength=len(found.kind) + 1)[1:]
    kept = np.flatnonzero(sizes_px >= LEAST_PX)
    renumbered = np.zeros(len(found.kind) + 1, dtype=np.int64)
    renumbered[kept + 1] = np.arange(1, len(kept) + 1)
    return PlantSegments(renumbered[found.number], found.kind[kept]), kept


def _divide(part: int, whole: int) -> float | None:
    return part / whole if whole else None


def format_plants(scores: PicturePlantScores) -> str:
    """Format the scores as lines of text."""

    def show(value: float | None, form: str = ".3f") -> str:
        return "-" if value is None else f"{value:{form}}"

    lines = [
        f"single plants of {scores.pictures} images: PQ {show(scores.pq)}, {scores.unknown} unknown"
    ]
    for name, truth, recall, precision in (
        ("weed", scores.weeds_truth, scores.weed_recall, scores.weed_precision),
        ("crop", scores.crops_truth, scores.crop_recall, scores.crop_precision),
    ):
        lines.append(f"{name} of {truth}: recall {show(recall)}, precision {show(precision)}")
    if scores.stem_error_median_px is not None:
        median, most = scores.stem_error_median_px, scores.stem_error_p95_px
        lines.append(f"stems: {median:.1f} px off, 95 % within {show(most, '.1f')} px")
    return "\n".join(lines)
