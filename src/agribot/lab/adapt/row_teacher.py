"""Rows seen in perspective as teacher: what stands on them is crop, what stands between is weed.

The labels are for learning: a weed in a row is taught as crop, and a long leaf of a crop between
two rows as weed, which the many others outweigh.
Source: Lottes and Stachniss 2017 (IROS); Bah et al. 2018 (Remote Sensing 10).
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image
from scipy import ndimage

from agribot.autonomy.perceive.picture_rows import (
    PictureRows,
    find_rows,
    measure_contrast,
)
from agribot.autonomy.perceive.pictures import Classifier, classify
from agribot.autonomy.perceive.plant_cover import excess_green, measure_cover
from agribot.core.errors import ConfigError
from agribot.core.messages import ByteArray, FloatArray, PlantClass
from agribot.lab.dataset.classes import UNLABELLED
from agribot.lab.dataset.pictures import PictureError, read_picture
from agribot.lab.dataset.taught_set import TaughtSet
from agribot.lab.rows.labelled import SIDE_PX
from agribot.lab.rows.lines import (
    HIGHEST_HORIZON_PX,
    JUDGED_AT_PX,
    LOWEST_HORIZON_PX,
    PhotoCamera,
)
from agribot.record.picture_files import reduce_width

Progress = Callable[[int], None]

MOST_WIDTH_PX = 1024  # width of a picture to learn from; a larger one is reduced
SMOOTH_PX = 1.0  # standard deviation of the blur before greenness is measured
SOIL_GREEN, PLANT_GREEN = 0.06, 0.1  # excess of green below and above which pixels are named
ON_ROW, BETWEEN_ROWS = 0.2, 0.36  # distances from a row's line in spacings
# Quantile of the evidence of pictures without rows, above which a picture shows rows by itself; the
# share of a set that has to; its size; how sure the place of rows in a picture has to be.
SURE_QUANTILE, LEAST_SHARE, LEAST_PICTURES, LEAST_SURE = 0.9, 0.5, 8, 0.5
PASSES = 2


class SeenRows(NamedTuple):
    """The rows of each picture that shows them, by its file, and what could not be read."""

    rows: dict[Path, PictureRows]
    problems: tuple[str, ...]


def read_small(path: Path) -> ByteArray:
    """Read a picture (H, W, 3), reduced to at most MOST_WIDTH_PX.

    Raises: PictureError: it cannot be read.
    """
    return reduce_width(read_picture(path), MOST_WIDTH_PX)


def measure_green(image_rgb: ByteArray) -> FloatArray:
    """Measure the excess of green of pixels (H, W) after a slight blur."""
    smooth = ndimage.gaussian_filter(image_rgb.astype(np.float64), (SMOOTH_PX, SMOOTH_PX, 0.0))
    return excess_green(smooth)


def label_by_rows(green: FloatArray, rows: PictureRows) -> ByteArray:
    """Label pixels (H, W) by their greenness and row: a PlantClass, or UNLABELLED."""
    off = rows.measure_off(*green.shape)
    is_plant = green > PLANT_GREEN
    label = np.full(green.shape, UNLABELLED, dtype=np.uint8)
    label[green < SOIL_GREEN] = PlantClass.SOIL
    label[is_plant & (off < ON_ROW)] = PlantClass.CROP
    label[is_plant & (off > BETWEEN_ROWS)] = PlantClass.WEED
    return label


def see_rows(paths: list[Path], network: Classifier, progress: Progress) -> SeenRows:
    """See the rows in the pictures of one camera.

    Raises: ConfigError: they show no rows.
    """
    contrasts: dict[Path, FloatArray] = {}
    problems: list[str] = []
    for path, image_rgb in _read(paths, problems, progress):
        classes = classify(network, image_rgb)
        cover = measure_cover(measure_green(image_rgb), classes.class_id, classes.confidence)
        contrasts[path] = measure_contrast(cover)
    if len(contrasts) < LEAST_PICTURES:
        raise ConfigError(
            f"{len(contrasts)} pictures can be read, rows are found in {LEAST_PICTURES} or more; "
            "give more pictures of the same camera in the same field"
        )
    rows, without = find_rows(list(contrasts.values()), np.random.default_rng(0))
    count = sum(one.evidence > np.quantile(without, SURE_QUANTILE) for one in rows)
    if count < LEAST_SHARE * len(rows):
        raise ConfigError(
            f"no rows to be seen: in {count} of {len(rows)} pictures plants stand along lines more "
            f"than by chance, {LEAST_SHARE:.0%} are needed; give pictures of one camera that looks "
            "along several rows, or label some by hand (agribot label)"
        )
    pairs = zip(contrasts, rows, strict=True)
    return SeenRows({path: one for path, one in pairs if one.sure >= LEAST_SURE}, tuple(problems))


def teach(seen: SeenRows, out: Path, progress: Progress) -> TaughtSet:
    """Write the pictures with rows to `out`/images and their classes to `out`/masks."""
    taught = TaughtSet(out)
    for number, (path, image_rgb) in enumerate(_read(list(seen.rows), [], progress)):
        label = label_by_rows(measure_green(image_rgb), seen.rows[path])
        taught.add(_name_taught(number, path), _encode(image_rgb), label)
    return taught


def find_cameras(seen: SeenRows) -> dict[str, PhotoCamera]:
    """Find the camera of each picture that `teach` writes, by its name: one horizon for all."""
    if not seen.rows:
        return {}
    horizon_px = SIDE_PX * float(np.median([rows.down_ratio for rows in seen.rows.values()]))
    horizon_px = min(max(horizon_px, HIGHEST_HORIZON_PX), LOWEST_HORIZON_PX)
    return {
        _name_taught(number, path): PhotoCamera(horizon_px, _measure_spacing_px(rows))
        for number, (path, rows) in enumerate(seen.rows.items())
    }


def _measure_spacing_px(rows: PictureRows) -> float:
    """Measure how far apart rows are in the picture row JUDGED_AT_PX."""
    nearer = (JUDGED_AT_PX / SIDE_PX - rows.down_ratio) / (1.0 - rows.down_ratio)
    return SIDE_PX * rows.spacing_ratio * nearer


def _name_taught(number: int, path: Path) -> str:
    return f"{number:05d}-{path.stem}.png"


def _read(
    paths: list[Path], problems: list[str], progress: Progress
) -> Iterator[tuple[Path, ByteArray]]:
    for done, path in enumerate(paths, 1):
        try:
            yield path, read_small(path)
        except PictureError as error:
            problems.append(str(error))
        progress(done)


def _encode(image_rgb: ByteArray) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(image_rgb).save(buffer, format="PNG", compress_level=1)
    return buffer.getvalue()
