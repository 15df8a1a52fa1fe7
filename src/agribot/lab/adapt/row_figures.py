"""What a network calls plants on rows and between them, as figures and as a sheet of pictures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec
import numpy as np
from PIL import Image

from agribot.autonomy.perceive.pictures import classify
from agribot.autonomy.perceive.segmenter import Segmenter
from agribot.core.messages import ByteArray, PlantClass
from agribot.core.whole_file import make_at_once
from agribot.lab.dataset.pictures import resize_nearest
from agribot.lab.train.data import LabelledImage

LOWER_RATIO = 0.7  # of the height of a picture, in which plants are judged
SHEET_WIDTH_PX = 360  # of each picture of a sheet
TINTS = {PlantClass.WEED: (255, 40, 40), PlantClass.CROP: (40, 220, 60)}
TINT_SHARE = 0.55
NAMES = ("crop", "weed", "soil")

Shares = dict[str, float] | None  # of pixels by the class that a network gives them


class TaughtFigures(msgspec.Struct, frozen=True, kw_only=True):
    """Shares of the plant pixels by the class that a network gives them.

    None where there are no such pixels. `balanced` is the mean of crop on rows and weed between
    them, 0.5 of a network that calls everything crop.
    """

    pictures: int
    on_rows: Shares
    between_rows: Shares
    balanced: float | None


class RowTally:
    """Counts what a network calls pixels that rows name: `add` pictures, then `make_figures`."""

    def __init__(self) -> None:
        self._counts = {kind: np.zeros(len(PlantClass), np.int64) for kind in TINTS}
        self._pictures = 0

    def add(self, class_id: ByteArray, label: ByteArray) -> None:
        """Add what a network says of a picture (H, W), and what its rows say."""
        top = round((1.0 - LOWER_RATIO) * label.shape[0])
        for kind in self._counts:
            named = class_id[top:][label[top:] == kind]
            self._counts[kind] += np.bincount(named, minlength=len(PlantClass))
        self._pictures += 1

    def make_figures(self) -> TaughtFigures:
        on_rows, between = (self._share(kind) for kind in (PlantClass.CROP, PlantClass.WEED))
        is_whole = on_rows is not None and between is not None
        return TaughtFigures(
            pictures=self._pictures,
            on_rows=on_rows,
            between_rows=between,
            balanced=(on_rows["crop"] + between["weed"]) / 2.0 if is_whole else None,  # type: ignore[index]
        )

    def _share(self, kind: PlantClass) -> Shares:
        counts = self._counts[kind]
        if not counts.any():
            return None
        return {name: float(counts[PlantClass[name.upper()]] / counts.sum()) for name in NAMES}


def judge_rows(segmenter: Segmenter, pairs: Iterator[LabelledImage]) -> TaughtFigures:
    """Judge a network on pictures and what their rows say."""
    tally = RowTally()
    for image_rgb, label in pairs:
        tally.add(classify(segmenter, image_rgb).class_id, label)
    return tally.make_figures()


def draw_sheet(
    path: Path, images_rgb: Sequence[ByteArray], before: Segmenter, after: Segmenter
) -> None:
    """Draw each picture alone, with the classes of one network, and with those of another."""
    lines = [
        np.hstack([_shrink(image_rgb), *(_tint(net, image_rgb) for net in (before, after))])
        for image_rgb in images_rgb
    ]
    width = max(line.shape[1] for line in lines)
    sheet = np.vstack([line for line in lines if line.shape[1] == width])
    make_at_once(path, lambda beside: Image.fromarray(sheet).save(beside, "JPEG", quality=88))


def _shrink(image_rgb: ByteArray) -> ByteArray:
    height, width = image_rgb.shape[:2]
    size = (SHEET_WIDTH_PX, max(1, round(height * SHEET_WIDTH_PX / width)))
    return np.asarray(Image.fromarray(image_rgb).resize(size, Image.Resampling.BOX))


def _tint(segmenter: Segmenter, image_rgb: ByteArray) -> ByteArray:
    """Tint the plants of a picture by the class that a network gives them."""
    small = _shrink(image_rgb)
    class_id = resize_nearest(classify(segmenter, image_rgb).class_id, small.shape[:2])
    tinted = small.astype(np.float64)
    for kind, colour in TINTS.items():
        is_kind = class_id == kind
        tinted[is_kind] += TINT_SHARE * (np.array(colour) - tinted[is_kind])
    return tinted.astype(np.uint8)
