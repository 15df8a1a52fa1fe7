"""A sheet of the worst pictures: the photograph, what its rows say, what the network says."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from agribot.core.messages import ByteArray, PlantClass
from agribot.lab.rows.judge import JudgedPicture
from agribot.lab.train.figures import tint

KEPT = 8
LINE_RGB = (255, 255, 0)


class WorstPictures:
    """The pictures with the most pixels of a wrong name: `add` each."""

    def __init__(self, keep: int = KEPT) -> None:
        self._keep = keep
        self.pictures: list[JudgedPicture] = []

    def add(self, judged: JudgedPicture) -> None:
        self.pictures.append(judged)
        self.pictures.sort(key=lambda one: one.scores.wrong_px, reverse=True)
        del self.pictures[self._keep :]


def draw_sheet(pictures: Sequence[JudgedPicture], path: Path) -> None:
    """Draw one line of three pictures for each."""
    from matplotlib.figure import Figure

    rows = max(1, len(pictures))
    figure = Figure(figsize=(9.0, 3.1 * rows), dpi=110, layout="constrained")
    axes = figure.subplots(rows, 3, squeeze=False)
    for row, one in zip(axes, pictures, strict=False):
        for axis, shown, title in zip(row, _show(one), _describe(one), strict=True):
            axis.imshow(shown)
            axis.set_title(title, fontsize=8)
    for axis in axes.flat:
        axis.set_axis_off()
    figure.savefig(path)


def _show(one: JudgedPicture) -> tuple[ByteArray, ByteArray, ByteArray]:
    image_rgb = one.picture.image_rgb
    drawn = image_rgb.copy()
    drawn[one.picture.lines] = LINE_RGB
    by_rows = np.full(one.class_id.shape, PlantClass.SOIL, dtype=np.uint8)
    by_rows[one.regions.on_rows] = PlantClass.CROP
    by_rows[one.regions.between_rows] = PlantClass.WEED
    return drawn, tint(image_rgb, by_rows), tint(image_rgb, one.class_id)


def _describe(one: JudgedPicture) -> tuple[str, str, str]:
    right = one.scores.right_ratio
    share = "-" if right is None else f"{right:.0%}"
    return one.name, "by the rows: crop green, weed red", f"network: {share} right"
