"""The single plants in the pictures of a labelled set, beside the masks of classes."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt
from PIL import Image

from agribot.core.messages import ByteArray, FloatArray, PlantClass
from agribot.lab.dataset.pictures import PictureError
from agribot.lab.dataset.records import ImageRecord
from agribot.lab.plant_scores import PlantSegments

# Beside the folder of masks: of `agribot dataset generate`, and of PhenoBench.
INSTANCE_FOLDERS = ("instances", "plant_instances")
RECORDS = "records"


class LabelledPlants(NamedTuple):
    """The plants of a picture, and where their stems are, (N, 2); NaN where unknown."""

    segments: PlantSegments
    stem_px: FloatArray


def find_instances(mask: Path) -> Path | None:
    """Find the mask of instances that belongs to a mask of classes, if any."""
    for name in INSTANCE_FOLDERS:
        path = mask.parent.parent / name / mask.name
        if path.is_file():
            return path
    return None


def read_plants(mask: Path, label: ByteArray) -> LabelledPlants | None:
    """Read the plants of a picture with these classes (H, W); None where only classes are known.

    The class of a plant is the commonest of its pixels.

    Raises: PictureError: the mask of instances cannot be read, or has another size.
    """
    path = find_instances(mask)
    if path is None:
        return None
    values = _read_values(path)
    if values.shape != label.shape:
        raise PictureError(
            f"{path}: is {values.shape[1]} x {values.shape[0]} pixels, the mask of classes "
            f"{label.shape[1]} x {label.shape[0]}; draw the set anew"
        )
    counted = np.where(label < len(PlantClass), values, 0)
    own, number = np.unique(counted, return_inverse=True)
    number = number.reshape(label.shape)
    if own[0] != 0:
        own, number = np.insert(own, 0, 0), number + 1
    votes = np.zeros((len(own), len(PlantClass)), dtype=np.int64)
    for kind in PlantClass:
        votes[:, kind] = np.bincount(number[label == kind], minlength=len(own))
    kinds = votes[:, : PlantClass.SOIL].argmax(axis=1).astype(np.uint8)
    stem_px = _find_stems(mask, own[1:])
    return LabelledPlants(PlantSegments(number, kinds[1:]), stem_px)


def _read_values(path: Path) -> npt.NDArray[np.integer]:
    try:
        with Image.open(path) as image:
            return np.asarray(image).astype(np.int64)
    except (OSError, ValueError) as error:
        raise PictureError(f"{path}: cannot be read ({error}); draw the set anew") from error


def _find_stems(mask: Path, numbers: npt.NDArray[np.integer]) -> FloatArray:
    """Find the stems (N, 2), u and v, of plants with these numbers, by the record of a picture."""
    stem_px = np.full((len(numbers), 2), np.nan)
    path = mask.parent.parent / RECORDS / f"{mask.stem}.json"
    if not path.is_file():
        return stem_px
    try:
        record = msgspec.json.decode(path.read_bytes(), type=ImageRecord)
    except (OSError, msgspec.DecodeError) as error:
        raise PictureError(
            f"{path}: is no record of a drawn picture ({error}); draw the set anew"
        ) from error
    map_from_camera = np.array(record.map_from_camera)
    rows = {int(number): row for row, number in enumerate(numbers)}
    for plant in record.plants:
        row = rows.get(plant.instance)
        place_m = np.array([plant.x_map_m, plant.y_map_m, 0.0]) - map_from_camera[:3, 3]
        right_m, down_m, ahead_m = place_m @ map_from_camera[:3, :3]
        if row is not None and ahead_m > 0.0:
            stem_px[row] = (
                record.cx_px + record.focal_px * right_m / ahead_m,
                record.cy_px + record.focal_px * down_m / ahead_m,
            )
    return stem_px
