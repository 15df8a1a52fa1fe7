"""What the values of a mask mean, and signs that they mean something else."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
from PIL import Image

from agribot.dataset.pictures import DEEP_MODES
from agribot.errors import ConfigError
from agribot.messages import ByteArray, PlantClass

MaskIds = Mapping[int, int]  # stored value to class; 255 is a pixel that counts for nothing

UNLABELLED = 255
UNKNOWN = 254
# Colour as one number 0xRRGGBB. Soil is blue here and black in CWFID and in the Bonn data.
COLOURS = {0xFF0000: 0, 0x00FF00: 1, 0x0000FF: 2, 0x000000: 2}
NAMES = {**{kind.name.lower(): int(kind) for kind in PlantClass}, "ignore": UNLABELLED}
USUAL_IDS = "0=weed,1=crop,2=soil"
EXAMPLE_IDS = "0=soil,1=crop,2=weed"

MOST_WEED_RATIO = 0.5
# In every photograph of CWFID (red and near infrared) and Carrot-Weed (ordinary light) and every
# simulated picture plants are greener than soil by 0.27 to 0.74. A set is doubted where its soil is
# greener than its plants by this much.
GREENER = 0.05
LEAST_SAMPLES = 50
SAMPLE_STRIDE_PX = 4


def read_ids(text: str | None) -> dict[int, int] | None:
    """Read "0=soil,1=crop,2=weed"; None where nothing was given.

    Raises: ConfigError: no such class, no such value, or a value twice.
    """
    if text is None:
        return None
    ids: dict[int, int] = {}
    for word in text.split(","):
        value, _, name = (part.strip() for part in word.partition("="))
        is_value = value.isascii() and value.isdigit() and len(value) <= 3 and int(value) <= 255
        if not is_value or name not in NAMES:
            raise ConfigError(
                f"--ids {text}: '{word.strip()}' is not VALUE=CLASS with a value from 0 to 255 and "
                f"a class of {', '.join(NAMES)}; write for instance --ids {EXAMPLE_IDS}"
            )
        if int(value) in ids:
            raise ConfigError(f"--ids {text}: value {value} is given twice")
        ids[int(value)] = NAMES[name]
    return {UNLABELLED: UNLABELLED, **ids}


def classes_of(mask: Image.Image, ids: MaskIds) -> ByteArray | None:
    """Classes (height, width) of a mask of values or of colours; UNKNOWN where there is none.

    Without `ids` values are those of `PlantClass`, and 255 where nothing counts. None for a kind of
    picture that holds no classes.
    """
    if mask.mode == "L" or (ids and mask.mode in {"P", *DEEP_MODES}):
        table = np.full(256, UNKNOWN, np.uint8)
        meaning = ids or {**{kind: kind for kind in PlantClass}, UNLABELLED: UNLABELLED}
        for value, kind in meaning.items():
            table[value] = kind
        values = np.asarray(mask).astype(np.int64)
        classes: ByteArray = np.where(
            (values >= 0) & (values < 256), table[values.clip(0, 255)], np.uint8(UNKNOWN)
        )
        return classes
    if mask.mode not in ("RGB", "RGBA", "P"):
        return None
    channels = np.asarray(mask.convert("RGB")).astype(np.uint32)
    code = channels[..., 0] << 16 | channels[..., 1] << 8 | channels[..., 2]
    classes = np.full(code.shape, UNKNOWN, np.uint8)
    for colour, kind in COLOURS.items():
        classes[code == colour] = kind
    return classes


class ClassTally:
    """Adds up how much of each class there is, and how green it is in the pictures."""

    def __init__(self) -> None:
        self._pixels: npt.NDArray[np.int64] = np.zeros(256, np.int64)
        self._samples: npt.NDArray[np.int64] = np.zeros(256, np.int64)
        self._greenness: npt.NDArray[np.float64] = np.zeros(256)

    def add(self, image_rgb: ByteArray, label: ByteArray) -> None:
        """Count a picture (height, width, 3) and its classes (height, width)."""
        self._pixels += np.bincount(label.ravel(), minlength=256)
        stride = (slice(None, None, SAMPLE_STRIDE_PX), slice(None, None, SAMPLE_STRIDE_PX))
        classes = label[stride].ravel()
        greenness = excess_green(image_rgb[stride]).ravel()
        self._samples += np.bincount(classes, minlength=256)
        self._greenness += np.bincount(classes, greenness, minlength=256)

    def ratios(self) -> dict[str, float | None]:
        """Return each class's share of all pixels of known class."""
        known = int(self._pixels[: len(PlantClass)].sum())
        return {
            kind.name.lower(): int(self._pixels[kind]) / known if known else None
            for kind in PlantClass
        }

    def doubt(self) -> str:
        """Say why the classes look swapped, and what to do; "" where they do not."""
        reason = self._doubt_amount() or self._doubt_colour()
        if not reason:
            return ""
        return (
            f"{reason}; the values of the masks were read as {USUAL_IDS}. Say what yours mean, "
            f"such as --ids {EXAMPLE_IDS}, or --ids {USUAL_IDS} if that is right"
        )

    def _doubt_amount(self) -> str:
        weed_ratio = self.ratios()["weed"]
        if weed_ratio is None or weed_ratio <= MOST_WEED_RATIO:
            return ""
        return f"weed covers {weed_ratio:.1%} of the pixels, more than {MOST_WEED_RATIO:.0%}"

    def _doubt_colour(self) -> str:
        plants = [PlantClass.WEED, PlantClass.CROP]
        plant_samples, soil_samples = self._samples[plants].sum(), self._samples[PlantClass.SOIL]
        if min(plant_samples, soil_samples) < LEAST_SAMPLES:
            return ""
        plant = float(self._greenness[plants].sum() / plant_samples)
        soil = float(self._greenness[PlantClass.SOIL] / soil_samples)
        if soil - plant <= GREENER:
            return ""
        return (
            f"what is called soil is greener ({soil:.2f}) than what is called plant ({plant:.2f})"
        )


def excess_green(image_rgb: ByteArray) -> npt.NDArray[np.float64]:
    """Return (2 G - R - B) / (R + G + B) of every pixel, from -1 to 2 (Woebbecke et al. 1995)."""
    red, green, blue = np.moveaxis(image_rgb.astype(np.float64), -1, 0)
    greenness: npt.NDArray[np.float64] = (2.0 * green - red - blue) / (red + green + blue + 1.0)
    return greenness
