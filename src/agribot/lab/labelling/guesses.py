"""What a network says of a photograph before a person labels it: classes, plants and doubt."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import numpy.typing as npt

from agribot.autonomy.perceive.picture_stems import OwnedPixels, own_pixels
from agribot.autonomy.perceive.pictures import Classifier, SeenPicture, see_picture
from agribot.core.messages import ByteArray, PlantClass

Mask = npt.NDArray[np.bool_]
Numbers = npt.NDArray[np.uint16]


class Guess(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The classes of a picture (h, w), and the plant of each pixel, counted from 1.

    `plant` is 0 on soil, on vegetation whose stem was not found, and where the network finds no
    stems. `doubt` is how likely the name of a pixel of vegetation is wrong, 0 to 1 on average.
    """

    class_id: ByteArray
    plant: Numbers
    doubt: float


def guess_picture(classifier: Classifier, image_rgb: ByteArray) -> Guess:
    """Ask a network about a picture (h, w, 3)."""
    seen = see_picture(classifier, image_rgb)
    owned = own_pixels(seen) if seen.class_map.plants is not None else None
    class_id = seen.classes.class_id
    return Guess(
        class_id=class_id,
        plant=np.zeros(class_id.shape, np.uint16) if owned is None else _number(seen, owned),
        doubt=measure_doubt(class_id, seen.classes.confidence, owned),
    )


def measure_doubt(class_id: ByteArray, confidence: ByteArray, owned: OwnedPixels | None) -> float:
    """Average over the vegetation how likely its names are wrong, 0 to 1.

    The stem of its plant says how likely the name of a pixel is right, so that two names on one
    plant are a doubt; where it has none, the pixel's own confidence does. A picture without
    vegetation has 0.
    """
    is_plant = class_id != PlantClass.SOIL
    if not is_plant.any():
        return 0.0
    right = confidence[is_plant] / 255.0
    if owned is not None:
        number, named = owned.number[is_plant], class_id[is_plant]
        right[number > 0] = owned.shares[number[number > 0] - 1, named[number > 0]]
    return float(1.0 - right.mean())


def _number(seen: SeenPicture, owned: OwnedPixels) -> Numbers:
    """Give the plants of a picture numbers, out to the edges of their vegetation.

    The borders of classes are finer than the network's map, whose pixels the numbers have.
    """
    number = owned.number.astype(np.uint16)
    is_plant = seen.classes.class_id != PlantClass.SOIL
    for _ in range(math.ceil(max(seen.scale_px))):
        number = _grow(number, is_plant)
    return number


def _grow(number: Numbers, is_plant: Mask) -> Numbers:
    """Give vegetation without a number the highest one beside it."""
    padded = np.pad(number, 1)
    beside = np.maximum.reduce(
        [padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:]]
    )
    return np.where((number == 0) & is_plant, beside, number)
