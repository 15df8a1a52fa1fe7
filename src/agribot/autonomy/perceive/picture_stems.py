"""Single plants in pictures of any size, by the stems that a plant network finds."""

from __future__ import annotations

from typing import NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt

from agribot.autonomy.perceive.pictures import SeenPicture
from agribot.autonomy.perceive.pieces import find_windows
from agribot.autonomy.perceive.plant_names import name_plants
from agribot.autonomy.perceive.stems import CELL_PX, share_kinds
from agribot.core.config import PerceptionConfig
from agribot.core.messages import FloatArray, PlantClass

# A stem that is less sure of its class is of neither, as on the robot.
LEAST_SHARE = PerceptionConfig().min_confidence


class PictureStem(msgspec.Struct, frozen=True, kw_only=True):
    """A plant with its stem at `u_px`, `v_px`, right and down from the top left pixel's middle.

    `plant` is None where it may be a weed or a crop: `weed` and `crop` are the probabilities.
    `area_px` counts the pixels of its leaves, within the box.
    """

    plant: PlantClass | None
    u_px: float
    v_px: float
    weed: float
    crop: float
    area_px: int
    left_px: int
    top_px: int
    width_px: int
    height_px: int


class OwnedPixels(NamedTuple):
    """Plant of each pixel of the picture.

    `number` (H, W) is the plant of each pixel, counted from 1, or 0. Of plant k, `stem_px[k - 1]`
    is the place of its stem and `shares[k - 1]` how likely it is a weed and a crop.
    """

    number: npt.NDArray[np.int32]
    stem_px: FloatArray
    shares: FloatArray


def own_pixels(seen: SeenPicture) -> OwnedPixels:
    """Assign the vegetation of a picture to its stems; the class map must have stems."""
    owned = seen.class_map.owned or name_plants(seen.class_map).owned
    assert owned is not None
    stems, cells = owned
    down, right = seen.scale_px
    height, width = seen.classes.class_id.shape
    rows = np.minimum((np.arange(height) + 0.5) / (down * CELL_PX), cells.shape[0] - 1)
    columns = np.minimum((np.arange(width) + 0.5) / (right * CELL_PX), cells.shape[1] - 1)
    number = cells[rows.astype(np.intp)[:, None], columns.astype(np.intp)[None]] + 1
    number[seen.classes.class_id == PlantClass.SOIL] = 0
    stem_px = (stems.uv_px + 0.5) * (right, down) - 0.5
    return OwnedPixels(number, stem_px, share_kinds(stems.kind_scores))


def list_stems(owned: OwnedPixels, least_px: int) -> list[PictureStem]:
    """List the plants of at least `least_px` whose stem the picture shows, the surest first."""
    number = owned.number
    height, width = number.shape
    sizes_px = np.bincount(number.ravel(), minlength=len(owned.stem_px) + 1)[1:]
    is_inside = (owned.stem_px >= -0.5) & (owned.stem_px < (width - 0.5, height - 0.5))
    found = []
    windows = find_windows(number, len(owned.stem_px))
    for index in np.flatnonzero((sizes_px >= max(1, least_px)) & is_inside.all(axis=1)).tolist():
        window = windows[index]
        assert window is not None  # a plant that is listed has pixels
        down, right = window
        u_px, v_px = owned.stem_px[index].tolist()
        weed, crop = owned.shares[index].tolist()
        found.append(
            PictureStem(
                plant=name_kind(weed, crop),
                u_px=u_px,
                v_px=v_px,
                weed=weed,
                crop=crop,
                area_px=int(sizes_px[index]),
                left_px=right.start,
                top_px=down.start,
                width_px=right.stop - right.start,
                height_px=down.stop - down.start,
            )
        )
    return found


def name_kind(weed: float, crop: float) -> PlantClass | None:
    """Name the class of a plant by its probabilities of weed and crop; None: undecided."""
    if max(weed, crop) < LEAST_SHARE:
        return None
    return PlantClass.CROP if crop > weed else PlantClass.WEED
