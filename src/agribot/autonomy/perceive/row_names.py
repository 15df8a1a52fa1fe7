"""Names by where plants stand between rows, for a camera that sees rows run away from it.

A network names a plant by its look. Where rows are seen, its place is a second witness: crop stands
along rows, weeds stand anywhere. Leaves are named by the look of their plant and by their own
place, since those between rows are seldom of the plant that they are counted to; how far leaves of
crop reach from their row, each picture shows. Looks of one picture err together, so that they count
less than independent witnesses. Leaves that the network calls soil are named by their place alone.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt

from agribot.autonomy.perceive.class_map import ClassMap
from agribot.autonomy.perceive.far_row_line import FarLine
from agribot.autonomy.perceive.far_view import FOLIAGE_M, LEAST_SINK_RATIO
from agribot.autonomy.perceive.green_leaves import find_green_leaves
from agribot.autonomy.perceive.ground import GroundLookup
from agribot.autonomy.perceive.plant_names import LEAST_SHARE, MOST_SHARE, rename
from agribot.autonomy.perceive.stems import CELL_PX, Stems, share_kinds
from agribot.core.messages import ByteArray, FloatArray, PlantClass

# Spread of leaves of crop about their row, in spacings: what is tried on a picture, the likeliest
# before anything is seen, and 1 sigma of its logarithm. Share of crop that stands anywhere.
SPREADS, USUAL_SPREAD, SPREAD_STD_RATIO = np.geomspace(0.06, 0.4, 9), 0.1, 0.7
ANYWHERE_RATIO = 0.03
# Share of a look's log-odds that counts, and the log-odds of crop of what looks like both.
LOOK_SHARE, CROP_ODDS = 0.5, 0.25
# Independent plants as which a picture counts, and the most and fewest cells that are looked at.
PLANTS, MOST_CELLS, FEWEST_CELLS = 100.0, 500, 20
TURNS = np.arange(-2.0, 3.0)  # neighbouring rows whose crop counts, too
MIDDLES = slice(CELL_PX // 2, None, CELL_PX)  # middles of cells

Mask = npt.NDArray[np.bool_]


class RowPlaces(NamedTuple):
    """How far places are from the nearest row, and 1 sigma of that, in spacings; NaN: unknown."""

    off: FloatArray
    std: FloatArray

    def choose(self, wanted: npt.NDArray[np.bool_ | np.int64]) -> RowPlaces:
        return RowPlaces(self.off[wanted], self.std[wanted])

    def find_odds(self, spread: float) -> FloatArray:
        """Find the log-odds of crop, whose leaves spread about their row; 0 where unknown."""
        std = np.hypot(self.std, spread)
        near = sum(np.exp(-0.5 * ((self.off + turn) / std) ** 2) for turn in TURNS)
        density = near / (math.sqrt(2.0 * math.pi) * std)
        odds = np.log((1.0 - ANYWHERE_RATIO) * density + ANYWHERE_RATIO)
        return np.nan_to_num(odds, nan=0.0)


def name_by_rows(
    class_map: ClassMap, ground: GroundLookup, far: FarLine, image_rgb: ByteArray | None = None
) -> ClassMap:
    """Name the plants of a map by their look and by their place beside the rows of `far`.

    The picture (H, W, 3) of the map, if given, shows leaves that the network calls soil.
    """
    is_plant = class_map.class_id != PlantClass.SOIL
    look = np.where(is_plant, _find_look(class_map), CROP_ODDS)
    places = locate_cells(ground, far)
    spread = find_spread(look[MIDDLES, MIDDLES], places, is_plant[MIDDLES, MIDDLES])
    place = places.find_odds(spread)
    if image_rgb is not None:
        is_plant |= find_green_leaves(class_map, image_rgb)
    named = _paint(class_map, look + _enlarge(place, look.shape), is_plant)
    if class_map.owned is None:
        return named
    stems = _rename_stems(class_map.owned.stems, place)
    return msgspec.structs.replace(named, owned=class_map.owned._replace(stems=stems))


def _find_look(class_map: ClassMap) -> FloatArray:
    """Find the log-odds of crop that the looks of plants (h, w) give."""
    sure = class_map.confidence / 255.0
    return _weigh_look(np.where(class_map.class_id == PlantClass.CROP, sure, 1.0 - sure))


def _weigh_look(shares: FloatArray) -> FloatArray:
    return LOOK_SHARE * find_log_odds(shares) + CROP_ODDS


def locate_cells(ground: GroundLookup, far: FarLine) -> RowPlaces:
    """Locate the middles of cells of CELL_PX beside rows, as far as these can be separated."""
    x_camera_m, y_camera_m, height_m = ground.camera_xyz_body_m.tolist()
    ahead_m = ground.x_body_m[MIDDLES, MIDDLES].astype(np.float64) - x_camera_m
    left_m = ground.y_body_m[MIDDLES, MIDDLES].astype(np.float64) - y_camera_m
    cos, sin = math.cos(far.tilt_rad), math.sin(far.tilt_rad)
    level_m, sink_m = cos * ahead_m - sin * height_m, sin * ahead_m + cos * height_m
    is_seen = sink_m > LEAST_SINK_RATIO * np.hypot(level_m, left_m)
    reach = (height_m - FOLIAGE_M) / np.where(is_seen, sink_m, np.nan)
    x_m, y_m = x_camera_m + reach * level_m - far.x_m, y_camera_m + reach * left_m - far.y_m
    cos, sin = math.cos(far.yaw_rad), math.sin(far.yaw_rad)
    along_m, turns = cos * x_m + sin * y_m, (cos * y_m - sin * x_m) / far.spacing_m
    std_m = np.hypot(far.across_std_m, along_m * far.yaw_std_rad)
    return RowPlaces(turns - np.round(turns), std_m / far.spacing_m)


def find_log_odds(shares: FloatArray) -> FloatArray:
    """Find the log-odds of shares, within LEAST_SHARE and MOST_SHARE."""
    limited = shares.clip(LEAST_SHARE, MOST_SHARE)
    odds: FloatArray = np.log(limited / (1.0 - limited))
    return odds


def find_spread(look: FloatArray, places: RowPlaces, is_plant: Mask) -> float:
    """Find the spread of crop with which the places of plants that look so are likeliest.

    Where leaves close the space between rows, it is so wide that places say nothing.
    """
    counts = is_plant & np.isfinite(places.off)
    look, places = look[counts], places.choose(counts)
    if len(look) < FEWEST_CELLS:
        return USUAL_SPREAD
    # At random: every few cells might be those of one row.
    some = np.random.default_rng(0).permutation(len(look))[:MOST_CELLS]
    crop, places = _find_shares(look[some]), places.choose(some)
    likely = [
        PLANTS * np.log(crop * np.exp(places.find_odds(spread)) + 1.0 - crop).mean()
        - 0.5 * (math.log(spread / USUAL_SPREAD) / SPREAD_STD_RATIO) ** 2
        for spread in SPREADS.tolist()
    ]
    return float(SPREADS[int(np.argmax(likely))])


def _find_shares(odds: FloatArray) -> FloatArray:
    shares: FloatArray = 1.0 / (1.0 + np.exp(-odds))
    return shares


def _enlarge(cells: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """Enlarge values of cells to pixels (H, W); the last cells reach to the edge."""
    rows, columns = (
        np.minimum(np.arange(size) // CELL_PX, count - 1)
        for size, count in zip(shape, cells.shape, strict=True)
    )
    enlarged: FloatArray = cells[rows[:, None], columns]
    return enlarged


def _paint(class_map: ClassMap, odds: FloatArray, is_plant: Mask) -> ClassMap:
    """Name the plants' pixels by their log-odds of crop."""
    class_id, confidence = class_map.class_id.copy(), class_map.confidence.copy()
    crop = _find_shares(odds[is_plant])
    class_id[is_plant] = np.where(crop > 0.5, PlantClass.CROP, PlantClass.WEED)
    confidence[is_plant] = np.round(255.0 * np.maximum(crop, 1.0 - crop))
    return msgspec.structs.replace(class_map, class_id=class_id, confidence=confidence)


def _rename_stems(stems: Stems, place: FloatArray) -> Stems:
    """Name stems by their look and by the log-odds (h/4, w/4) of their place."""
    column, row = (
        np.clip(at_px // CELL_PX, 0, count - 1).astype(np.intp)
        for at_px, count in zip(stems.uv_px.T, place.shape[::-1], strict=True)
    )
    look = _weigh_look(share_kinds(stems.kind_scores)[:, PlantClass.CROP])
    crop = _find_shares(look + place[row, column])
    return rename(stems, np.column_stack([1.0 - crop, crop]))
