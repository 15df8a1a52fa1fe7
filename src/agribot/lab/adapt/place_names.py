"""Names of plants in photographs as a robot gives them: by look, and by place beside its rows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from agribot.autonomy.perceive.pictures import PictureClasses
from agribot.core.messages import ByteArray
from agribot.lab.dataset.pictures import resize_nearest
from agribot.lab.rows.labelled import SIDE_PX, fit_classes, fit_picture
from agribot.lab.rows.lines import LineFinder, PhotoCamera
from agribot.lab.train.data import LabelledImage
from agribot.lab.train.photographs import Pair, read_pair


class TaughtPicture(NamedTuple):
    """A picture (H, W, 3), what its rows say (H, W), and its camera; None: it is not known."""

    image_rgb: ByteArray
    label: ByteArray
    camera: PhotoCamera | None

    @property
    def labelled(self) -> LabelledImage:
        return self.image_rgb, self.label


def read_row_pictures(
    pairs: Sequence[Pair], cameras: Mapping[str, PhotoCamera]
) -> Iterator[TaughtPicture]:
    """Read pictures with their cameras, which go by the names of the files.

    Raises: PictureError: a file has changed since it was checked.
    """
    for pair in pairs:
        yield TaughtPicture(*read_pair(pair), cameras.get(pair.image.name))


class PlaceNames:
    """Names plants by the line that the robot would find, not by the rows that taught."""

    def __init__(self) -> None:
        self._finder = LineFinder()

    def name(self, classes: PictureClasses, picture: TaughtPicture) -> tuple[ByteArray, ByteArray]:
        """Name the classes (H, W) of a picture; return the names and what its rows say.

        Both are of one size. Without a camera names are those by look.
        """
        if picture.camera is None:
            return classes.class_id, picture.label
        image_rgb = fit_picture(picture.image_rgb)
        named = self._finder.find(fit_classes(classes), picture.camera, image_rgb)
        return named.classes.class_id, resize_nearest(picture.label, (SIDE_PX, SIDE_PX))
