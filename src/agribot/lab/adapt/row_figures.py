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
from agribot.lab.adapt.place_names import PlaceNames, TaughtPicture
from agribot.lab.dataset.pictures import resize_nearest
from agribot.lab.rows.labelled import Regions
from agribot.lab.rows.scores import NameScores, Shares, share

LOWER_RATIO = 0.7  # lower share of a picture's height, in which plants are judged
SHEET_WIDTH_PX = 360  # width of each picture of a sheet
TINTS = {PlantClass.WEED: (255, 40, 40), PlantClass.CROP: (40, 220, 60)}
TINT_SHARE = 0.55


class TaughtFigures(msgspec.Struct, frozen=True, kw_only=True):
    """Shares of the plant pixels by the class that a network gives them.

    None where there are no such pixels. `balanced` is the mean of crop on rows and weed between
    them, 0.5 of a network that calls everything crop.
    """

    pictures: int
    on_rows: Shares | None
    between_rows: Shares | None
    balanced: float | None


class RowTally:
    """Counts what a network calls pixels that rows name: `add` pictures, then `make_figures`."""

    def __init__(self) -> None:
        self._names, self._pictures = NameScores(), 0

    def add(self, class_id: ByteArray, label: ByteArray) -> None:
        """Add what a network says of a picture (H, W), and what its rows say."""
        lower = label[round((1.0 - LOWER_RATIO) * label.shape[0]) :]
        regions = Regions(lower == PlantClass.CROP, lower == PlantClass.WEED)
        self._names.add(regions, class_id[-len(lower) :])
        self._pictures += 1

    def make_figures(self) -> TaughtFigures:
        names = self._names
        return TaughtFigures(
            pictures=self._pictures,
            on_rows=share(names.on_rows) if names.on_rows.any() else None,
            between_rows=share(names.between_rows) if names.between_rows.any() else None,
            balanced=names.balanced,
        )


def judge_rows(segmenter: Segmenter, pictures: Iterator[TaughtPicture]) -> TaughtFigures:
    """Judge how a robot with this network names plants, on pictures and what their rows say."""
    tally, names = RowTally(), PlaceNames()
    for picture in pictures:
        tally.add(*names.name(classify(segmenter, picture.image_rgb), picture))
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
