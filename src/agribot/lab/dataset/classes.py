"""What the values of a mask mean, and signs that they mean something else."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
from PIL import Image

from agribot.autonomy.perceive.plant_cover import excess_green
from agribot.core.errors import ConfigError
from agribot.core.messages import ByteArray, PlantClass
from agribot.lab.dataset.pictures import DEEP_MODES

# Stored value, or COLOUR and 0xRRGGBB, to class; 255 is a pixel that counts for nothing.
MaskIds = Mapping[int, int]

UNLABELLED = 255
UNKNOWN = 254
COLOUR_MODES = {"RGB", "RGBA", "P", "PA"}
VALUE_MODES = {"L", "LA", "1", *DEEP_MODES}
COLOUR = 1 << 24  # marks a key of ids as a colour
MOST_NAMED = 8  # values or colours
MOST_VALUE = 0xFFFF
MANY_COLOURS = 64  # number of colours that no tool has classes for
# Colour as one number 0xRRGGBB. Soil is blue here and black in CWFID and in the Bonn data.
COLOURS = {0xFF0000: 0, 0x00FF00: 1, 0x0000FF: 2, 0x000000: 2}
NAMES = {**{kind.name.lower(): int(kind) for kind in PlantClass}, "ignore": UNLABELLED}
USUAL_IDS = "0=weed,1=crop,2=soil"
EXAMPLE_IDS = "0=soil,1=crop,2=weed"
EXAMPLE_COLOURS = "000000=soil,800000=crop"
COLOUR_DIGITS = 6
ALL_IGNORED = "every pixel is ignored; label some of the picture, or move the mask away"
USUAL_COLOURS = "red weed, green crop, black or blue soil"

MOST_WEED_RATIO = 0.5
# Least surplus of the plants' greenness over the soil's. In every photograph of CWFID (red and near
# infrared) and Carrot-Weed (ordinary light) and every simulated picture plants are greener than
# soil by 0.27 to 0.74; a set below this is doubted.
GREENER = 0.05
LEAST_SAMPLES = 50
SAMPLE_STRIDE_PX = 4


def read_ids(text: str | None) -> dict[int, int] | None:
    """Read "0=soil,1=crop" or, of colours, "000000=soil,800000=crop"; None for nothing.

    Raises: ConfigError: no such class, no such value or colour, one twice, or both kinds.
    """
    if text is None:
        return None
    ids: dict[int, int] = {}
    for word in text.split(","):
        value, _, name = (part.strip() for part in word.partition("="))
        key = _read_key(value)
        if key is None or name not in NAMES:
            raise ConfigError(
                f"--ids {text}: '{word.strip()}' is not VALUE=CLASS with a value from 0 to "
                f"{MOST_VALUE}, or a colour RRGGBB, and a class of {', '.join(NAMES)}; write for "
                f"instance --ids {EXAMPLE_IDS} or --ids {EXAMPLE_COLOURS}"
            )
        if key in ids:
            raise ConfigError(f"--ids {text}: value {value} is given twice; give it once")
        ids[key] = NAMES[name]
    if len({key < COLOUR for key in ids}) > 1:
        raise ConfigError(f"--ids {text}: names values and colours; name either")
    return ids if names_colours(ids) else {UNLABELLED: UNLABELLED, **ids}


def _read_key(text: str) -> int | None:
    """Read a value of up to five digits, or a colour of six hexadecimal ones, also behind a #."""
    text = text.removeprefix("#") if len(text) == 1 + COLOUR_DIGITS else text
    if len(text) == COLOUR_DIGITS and set(text.lower()) <= set("0123456789abcdef"):
        return COLOUR | int(text, 16)
    is_value = text.isascii() and text.isdigit() and len(text) <= 5 and int(text) <= MOST_VALUE
    return int(text) if is_value else None


def format_key(key: int) -> str:
    """Write a value or a colour as --ids takes it."""
    return f"{key & 0xFFFFFF:06x}" if key >= COLOUR else str(key)


def names_colours(ids: MaskIds) -> bool:
    """Return whether ids are of colours, not of values."""
    return any(key >= COLOUR for key in ids)


def read_classes(mask: Image.Image, ids: MaskIds) -> ByteArray | None:
    """Read the classes (height, width) of a mask of values or of colours; UNKNOWN where none.

    With `ids` of values such a mask is wanted. Without them grey holds values, those of
    `PlantClass` and 255 where nothing counts, and every other mask is one of colours. None for a
    picture that is not of the kind wanted.
    """
    if not names_colours(ids) and (ids or mask.mode in VALUE_MODES):
        values = read_values(mask)
        if values is not None and mask.mode == "1" and ids.get(255, UNLABELLED) != UNLABELLED:
            values = values * 255  # as programs show white
        return None if values is None else _look_up(values, ids)
    if mask.mode not in COLOUR_MODES | VALUE_MODES:
        return None
    code = _colour_codes(mask)
    classes = np.full(code.shape, UNKNOWN, np.uint8)
    for colour, kind in (ids or COLOURS).items():
        classes[code == colour & 0xFFFFFF] = kind
    return classes


def read_values(mask: Image.Image) -> npt.NDArray[np.int64] | None:
    """Read the values (height, width) of a mask; None where it shows colours or no classes.

    Grey is a value, in three equal channels too. A palette mask is what it shows, grey or the
    colours of classes; where it shows any other colour, its values are the indexes.
    """
    if mask.mode in VALUE_MODES:
        grey = np.asarray(mask.convert("L") if mask.mode == "LA" else mask)
        return grey.astype(np.int64)
    if mask.mode not in COLOUR_MODES:
        return None
    code = _colour_codes(mask)
    grey = code & 0xFF
    if (grey * 0x010101 == code).all():
        return grey
    if mask.mode == "P" and not np.isin(code, list(COLOURS)).all():
        return np.asarray(mask).astype(np.int64)
    return None


def explain_no_classes(mask: Image.Image, *, is_named: bool) -> str:
    """Say why `read_classes` found none; `is_named`: the ids are those of the option --ids."""
    if mask.mode not in COLOUR_MODES:
        return (
            f"a mask of mode {mask.mode} holds no classes; save class ids 0, 1, 2 as 8-bit grey, "
            "or red, green and black as RGB"
        )
    if is_named:
        return (
            "shows colours, and --ids names values; leave --ids out, or name the colours: "
            f"{advise_colours(mask)}"
        )
    return "shows colours, and masks of this --data hold values; save the values as 8-bit grey"


def advise_ids(mask: Image.Image) -> str:
    """Say how the unknown classes of a mask may be read."""
    values = read_values(mask)
    if values is None:
        return f"; say which colour is what: {advise_colours(mask)}"
    return f"; say which value is what: {_advise_keys(values)}"


def advise_colours(mask: Image.Image) -> str:
    """Write --ids for the colours of a mask, the most frequent first, with their shares."""
    codes = _colour_codes(mask)
    if len(np.unique(codes)) > MANY_COLOURS:
        return (
            f"{_advise_keys(codes | COLOUR)}; this many come from JPEG or from soft edges: export "
            "the masks as PNG"
        )
    return _advise_keys(codes | COLOUR)


def _advise_keys(found: npt.NDArray[np.int64]) -> str:
    keys, counts = np.unique(found, return_counts=True)
    most = np.argsort(-counts, kind="stable")[:MOST_NAMED]
    named = [(format_key(int(keys[at])), counts[at] / counts.sum()) for at in most]
    shares = ", ".join(f"{key} {share:.1%}" for key, share in named)
    more = f" and {len(keys) - len(most)} more" if len(keys) > len(most) else ""
    ids = ",".join(f"{key}=CLASS" for key, _ in named)
    return f"--ids {ids} (found: {shares}{more})"


def advise_swapped(*, holds_values: bool) -> str:
    """Say how masks read without ids were understood, and what to do where that is doubted."""
    if holds_values:
        return (
            f"the values of the masks were read as {USUAL_IDS}. Say what yours mean, such as "
            f"--ids {EXAMPLE_IDS}, or --ids {USUAL_IDS} if that is right"
        )
    return (
        f"the colours of the masks were read as {USUAL_COLOURS}. Paint yours so; if they are "
        f"right, save them as 8-bit grey values and confirm these with --ids {USUAL_IDS}"
    )


def _look_up(values: npt.NDArray[np.int64], ids: MaskIds) -> ByteArray:
    table = np.full(MOST_VALUE + 1, UNKNOWN, np.uint8)
    meaning = ids or {**{kind: kind for kind in PlantClass}, UNLABELLED: UNLABELLED}
    for value, kind in meaning.items():
        table[value] = kind
    has_class = (values >= 0) & (values <= MOST_VALUE)
    classes: ByteArray = np.where(has_class, table[values.clip(0, MOST_VALUE)], np.uint8(UNKNOWN))
    return classes


def _colour_codes(mask: Image.Image) -> npt.NDArray[np.int64]:
    red, green, blue = np.moveaxis(np.asarray(mask.convert("RGB")).astype(np.int64), -1, 0)
    codes: npt.NDArray[np.int64] = red << 16 | green << 8 | blue
    return codes


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

    def explain_doubt(self) -> str:
        """Say why the classes look swapped; "" where they do not."""
        return self._doubt_ratio() or self._doubt_colour()

    def _doubt_ratio(self) -> str:
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
