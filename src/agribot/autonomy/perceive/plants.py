"""Plants on the ground, from a class map.

A network that finds plants gives their stems. With one that only gives classes, plants are
connected pieces, with their borders and their foot.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from agribot.autonomy.perceive.class_map import ClassMap
from agribot.autonomy.perceive.crop_cover import middles_of_squares
from agribot.autonomy.perceive.foliage import find_nearer_ratio
from agribot.autonomy.perceive.ground import GroundLookup
from agribot.autonomy.perceive.pieces import find_windows, label_pieces
from agribot.autonomy.perceive.row_line import SeenRowLine, see_row_line
from agribot.autonomy.perceive.row_names import name_by_rows
from agribot.autonomy.perceive.stem_plants import (
    SeenStems,
    find_leaves,
    find_stem_plants,
    see_stems,
)
from agribot.autonomy.perceive.unfit import find_unfit
from agribot.core.config import PerceptionConfig
from agribot.core.fact_text import render
from agribot.core.messages import ByteArray, CameraFrame, FloatArray, GroundPlant, PlantClass, Scene

LabelArray = npt.NDArray[np.signedinteger]
Counts = npt.NDArray[np.int64]
NamesTap = Callable[[ClassMap], None]

# A piece that shares this much of its outline with a bigger plant of the other class, and is
# smaller than that plant by the area ratio, is a mislabelled part of it and no plant of its own.
FRINGE_CONTACT_RATIO = 0.4
FRINGE_AREA_RATIO = 0.5
# Thin stalks vanish at the network's resolution: leaves up to twice this apart belong together.
GAP_PX = 3
# 1 sigma of the height of foliage over the diameter of the plant.
HEIGHT_STD_RATIO = {PlantClass.WEED: 0.2, PlantClass.CROP: 0.12}
# Error of a plant's centre: plants do not spread evenly about their foot.
CENTRE_STD_RATIO = 0.06


class Pieces(NamedTuple):
    """Connected vegetation: `labels` 1 to `weeds` are weeds, those above it up to `total` crops."""

    labels: LabelArray
    weeds: int
    total: int


def look(
    frame: CameraFrame,
    class_map: ClassMap,
    ground: GroundLookup,
    config: PerceptionConfig,
    ready_s: float,
    on_names: NamesTap | None = None,
) -> Scene:
    """Make the scene of a frame, an empty one with the reason where the picture is unfit.

    `on_names` gets the class map with the names of the scene.
    """
    unfit = find_unfit(frame.image_rgb, class_map)
    if unfit is None:
        return observe(frame, class_map, ground, config, ready_s, on_names)
    if on_names is not None:
        on_names(class_map)
    return Scene(
        t_s=frame.t_s,
        ready_s=ready_s,
        frame_index=frame.index,
        plants=(),
        view_body_m=ground.view_body_m,
        picture_crc32=_sum_up(frame),
        doubt=class_map.doubt,
        unfit=render(unfit),
        unfit_fact=unfit,
    )


def observe(
    frame: CameraFrame,
    class_map: ClassMap,
    ground: GroundLookup,
    config: PerceptionConfig,
    ready_s: float,
    on_names: NamesTap | None = None,
) -> Scene:
    """Make the scene of a frame that is fit, from the class map of its image."""
    seen = see_row_line(class_map, ground, frame.t_s, frame.image_rgb)
    if seen is not None and seen.far is not None:
        class_map = name_by_rows(class_map, ground, seen.far, frame.image_rgb)
    if on_names is not None:
        on_names(class_map)
    return _describe(frame, class_map, ground, config, ready_s, seen)


def _describe(
    frame: CameraFrame,
    class_map: ClassMap,
    ground: GroundLookup,
    config: PerceptionConfig,
    ready_s: float,
    seen: SeenRowLine | None,
) -> Scene:
    counts = np.bincount(class_map.class_id.ravel(), minlength=len(PlantClass))
    ratio = counts / class_map.class_id.size
    pieces = find_pieces(class_map, ground)
    stems = None if class_map.plants is None else see_stems(class_map, ground)
    leaves = None if stems is None else find_leaves(stems, ground)
    return Scene(
        t_s=frame.t_s,
        ready_s=ready_s,
        frame_index=frame.index,
        plants=tuple(ground_plants(class_map, ground, config, pieces, stems)),
        view_body_m=ground.view_body_m,
        class_ratio=(float(ratio[0]), float(ratio[1]), float(ratio[2])),
        row_line=None if seen is None else seen.line,
        crop_cover=ground.cover_grid.cover(
            pieces.labels > pieces.weeds,
            leaves,
            (pieces.labels > 0) & (pieces.labels <= pieces.weeds),
        ),
        weed_scores=None if stems is None else ground.score_grid.score(stems.maps),
        picture_crc32=_sum_up(frame),
        doubt=class_map.doubt,
    )


def _sum_up(frame: CameraFrame) -> int:
    return zlib.crc32(np.ascontiguousarray(frame.image_rgb).data)


def ground_plants(
    class_map: ClassMap,
    ground: GroundLookup,
    config: PerceptionConfig,
    pieces: Pieces | None = None,
    stems: SeenStems | None = None,
) -> list[GroundPlant]:
    """Plants within range that the image shows whole, nearest first.

    With a network that finds plants: those whose stem the image shows. With one that only gives
    classes: the `pieces` of its map. What is not given is found here.
    """
    if class_map.plants is not None:
        plants = find_stem_plants(class_map, ground, config, stems)
    else:
        pieces = pieces or find_pieces(class_map, ground)
        plants = _measure(pieces, class_map.confidence, ground, config)
    return sorted(plants, key=lambda plant: (plant.x_body_m, plant.y_body_m))


def find_pieces(class_map: ClassMap, ground: GroundLookup) -> Pieces:
    """All vegetation on the ground, mislabelled fringes with the plant that they belong to."""
    class_map.check_shape(ground.map_shape)
    class_id = np.where(ground.area_m2 > 0.0, class_map.class_id, np.uint8(PlantClass.SOIL))
    weeds, weed_count = _pieces(class_id == PlantClass.WEED)
    crops, crop_count = _pieces(class_id == PlantClass.CROP)
    labels = np.where(crops > 0, crops + weed_count, weeds)
    pieces = Pieces(labels, weed_count, weed_count + crop_count)
    return _without_fringes(pieces, ground) if weed_count and crop_count else pieces


def _pieces(mask: npt.NDArray[np.bool_]) -> tuple[LabelArray, int]:
    """Label the plants of one class; leaves with a narrow gap between them are one plant."""
    taller = mask.copy()
    for shift in range(1, GAP_PX + 1):
        taller[shift:] |= mask[:-shift]
        taller[:-shift] |= mask[shift:]
    grown = taller.copy()
    for shift in range(1, GAP_PX + 1):
        grown[:, shift:] |= taller[:, :-shift]
        grown[:, :-shift] |= taller[:, shift:]
    labels, count = label_pieces(grown)
    return labels * mask, count


def _without_fringes(pieces: Pieces, ground: GroundLookup) -> Pieces:
    """Join mislabelled parts of a plant to the plant around them."""
    labels, weed_count, count = pieces
    pixels = np.flatnonzero(labels)
    area_m2 = np.bincount(labels.ravel()[pixels], ground.area_m2.ravel()[pixels], count + 1).astype(
        np.float64
    )
    edge_px, contact_px, neighbour = _contacts(pieces, area_m2)
    is_fringe = (
        (neighbour > 0)
        & (contact_px >= FRINGE_CONTACT_RATIO * edge_px)
        & (area_m2 < FRINGE_AREA_RATIO * area_m2[neighbour])
    )
    if not is_fringe.any():
        return pieces
    joined = np.where(is_fringe, neighbour, np.arange(count + 1))
    return Pieces(joined[joined][labels], weed_count, count)


def _contacts(pieces: Pieces, area_m2: FloatArray) -> tuple[Counts, Counts, Counts]:
    """Outline length of each piece, the part of it on the other class, biggest neighbour there."""
    labels, weed_count, count = pieces
    pairs = []
    for one, other in ((labels[:, :-1], labels[:, 1:]), (labels[:-1], labels[1:])):
        differ = one != other
        pairs += [np.stack([one[differ], other[differ]]), np.stack([other[differ], one[differ]])]
    own, across = np.concatenate(pairs, axis=1)
    own, across = own[own > 0], across[own > 0]
    mixed = (across > 0) & ((own > weed_count) != (across > weed_count))
    edge_px = np.bincount(own, minlength=count + 1)
    own, across = own[mixed], across[mixed]
    contact_px = np.bincount(own, minlength=count + 1)
    neighbour = np.zeros(count + 1, dtype=np.int64)
    by_area = np.argsort(area_m2[across], kind="stable")
    neighbour[own[by_area]] = across[by_area]  # the last write, the biggest, stays
    return edge_px, contact_px, neighbour


def _measure(
    pieces: Pieces, confidence: ByteArray, ground: GroundLookup, config: PerceptionConfig
) -> list[GroundPlant]:
    """Choose the pieces that are whole, sure, big and near enough."""
    labels, weed_count, count = pieces
    pixels = np.flatnonzero(labels)
    label_of = labels.ravel()[pixels]
    size_px = np.bincount(label_of, minlength=count + 1)
    area_m2 = np.bincount(label_of, ground.area_m2.ravel()[pixels], count + 1)
    summed = np.bincount(label_of, confidence.ravel()[pixels], count + 1)
    sure = np.minimum(summed / (255.0 * np.maximum(size_px, 1)), 1.0)
    keep = (area_m2 >= config.min_plant_area_m2) & (sure >= config.min_confidence)
    for edge in (labels[0], labels[-1], labels[:, 0], labels[:, -1]):
        keep[edge] = False  # cut by the image edge: its centre would be wrong
    keep[weed_count + 1 :] &= _is_broad(labels, count)[weed_count + 1 :]
    keep[0] = False
    windows = find_windows(labels, count)
    found = []
    for label in np.flatnonzero(keep):
        window = windows[label - 1]
        assert window is not None  # a piece that is kept has pixels
        plant = PlantClass.WEED if label <= weed_count else PlantClass.CROP
        piece = labels[window] == label
        found.append(_standing(piece, window, plant, float(sure[label]), ground))
    x_m, y_m = ground.camera_xyz_body_m[:2]
    return [
        plant
        for plant in found
        if math.hypot(plant.x_body_m - x_m, plant.y_body_m - y_m) <= ground.max_range_m
    ]


def _is_broad(labels: LabelArray, count: int) -> npt.NDArray[np.bool_]:
    """Whether a piece is somewhere three pixels thick both ways.

    Seams between two kinds of ground are lines of crop to the network; a leaf of a crop plant
    within range is broader.
    """
    thick = middles_of_squares(labels > 0)
    broad: npt.NDArray[np.bool_] = np.bincount(labels[thick], minlength=count + 1) > 0
    return broad


def _standing(
    piece: npt.NDArray[np.bool_],
    window: tuple[slice, ...],
    plant: PlantClass,
    confidence: float,
    ground: GroundLookup,
) -> GroundPlant:
    """Make the plant of a piece, at the place where it leaves the ground."""
    x_camera_m, y_camera_m, camera_height_m = ground.camera_xyz_body_m.tolist()
    areas_m2 = ground.area_m2[window][piece].astype(np.float64)
    area_m2 = float(areas_m2.sum())
    diameter_m = 2.0 * math.sqrt(area_m2 / math.pi)
    nearer = find_nearer_ratio(plant, area_m2, camera_height_m)
    x_m = nearer * (
        float(np.average(ground.x_body_m[window][piece], weights=areas_m2)) - x_camera_m
    )
    y_m = nearer * (
        float(np.average(ground.y_body_m[window][piece], weights=areas_m2)) - y_camera_m
    )
    parallax_std_m = HEIGHT_STD_RATIO[plant] * diameter_m / camera_height_m * math.hypot(x_m, y_m)
    footprint_m = float(ground.footprint_m[window][piece].mean())
    return GroundPlant(
        x_body_m=float(x_camera_m) + x_m,
        y_body_m=float(y_camera_m) + y_m,
        plant=plant,
        area_m2=area_m2 * nearer**2,
        confidence=confidence,
        std_m=math.hypot(parallax_std_m, footprint_m, CENTRE_STD_RATIO * diameter_m),
    )
