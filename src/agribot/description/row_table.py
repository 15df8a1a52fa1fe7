"""The crop rows of a world: as its file states them, or as its crop stands."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence

import msgspec
import numpy as np
import numpy.typing as npt

from agribot.core.messages import FloatArray, PlantClass
from agribot.core.world import Plant, RowTable, WorldSpec
from agribot.description.elements import SourceFile
from agribot.description.poses import extract_yaw
from agribot.description.sdf_models import qualify_tag

TAG = "rows"
WHERE = "<agribot:rows>"
# Number of the attribute, its least and its most; those with a default may be left out.
LIMITS = {
    "x": (-1e4, 1e4), "y": (-1e4, 1e4), "yaw_deg": (-360.0, 360.0), "length_m": (0.1, 1e4),
    "pitch_m": (0.05, 1e3), "count": (1.0, 1e4), "spacing_m": (0.01, 1e3),
    "curvature_radpm": (-0.2, 0.2),
}  # fmt: skip
DEFAULTS = {"pitch_m": 1.0, "curvature_radpm": 0.0}
OPTIONAL = "spacing_m"

LEAST_PLANTS = 4
MOST_SAMPLES = 500  # plants whose neighbours show the directions
GAP_M = 0.15  # across, from the crop of one row to that of the next
TURN_DEG = np.arange(-3.0, 3.05, 0.1)  # about a direction of neighbours, in search of the rows'
LEAST_PITCH_M = 0.3  # plants that stand nearer are of one row
SAME_PITCH_RATIO = 0.1  # difference of two row distances as a share of the pitch
LEAST_LENGTH_M = 1.0
ALIGNMENTS = 3


def read_row_table(
    world: ET.Element, map_from_world: FloatArray, source: SourceFile
) -> RowTable | None:
    """Read <agribot:rows> of a world; None without one. `map_from_world` is (4, 4).

    Raises: DescriptionError: an attribute is unknown, missing or out of range.
    """
    element = world.find(qualify_tag(TAG))
    if element is None:
        return None
    for name in element.attrib:
        if name not in LIMITS:
            raise source.fail(f"{WHERE} {name}", f"unknown; use {', '.join(LIMITS)}")
    spacing_m = _read(element, OPTIONAL, source) if OPTIONAL in element.attrib else None
    value = {name: _read(element, name, source) for name in LIMITS if name != OPTIONAL}
    start = map_from_world @ np.array([value["x"], value["y"], 0.0, 1.0])
    return RowTable(
        first_row_start_map_m=(round(float(start[0]), 6), round(float(start[1]), 6)),
        row_yaw_deg=_wrap_deg(value["yaw_deg"] + math.degrees(extract_yaw(map_from_world))),
        row_length_m=value["length_m"],
        row_curvature_radpm=value["curvature_radpm"],
        row_pitch_m=value["pitch_m"],
        row_count=int(value["count"]),
        plant_spacing_m=spacing_m,
    )


def _read(element: ET.Element, name: str, source: SourceFile) -> float:
    where, (least, most) = f"{WHERE} {name}", LIMITS[name]
    if name in DEFAULTS and name not in element.attrib:
        return DEFAULTS[name]
    number = source.parse_number(source.require_attribute(element, name, WHERE), where)
    source.check_within(where, number, least, most)
    return number


def find_row_table(world: WorldSpec) -> RowTable | None:
    """Return the rows that a world states, or those in which its crop stands; None without any."""
    crop_xy_m = list_crop_m(world.plants)
    if world.rows is not None:
        return msgspec.structs.replace(world.rows, has_crop=len(crop_xy_m) > 0)
    return fit_row_table(crop_xy_m, world.spawn_xy_map_m)


def list_crop_m(plants: Sequence[Plant]) -> FloatArray:
    """List where crop stands in the map, (n, 2)."""
    crop = [(p.x_map_m, p.y_map_m) for p in plants if p.plant is PlantClass.CROP]
    return np.array(crop, dtype=np.float64).reshape(-1, 2)


def fit_row_table(crop_xy_m: FloatArray, start_xy_m: tuple[float, float]) -> RowTable | None:
    """Find the straight parallel rows, equally far apart, in which crop (n, 2) stands.

    Of two such tables, as a square of plants has, the one with the longer rows is taken. The
    first row is at the left of the way, at the end that is nearer to `start_xy_m`. None where
    crop does not stand so.
    """
    places_m = np.unique(crop_xy_m.round(6), axis=0)
    if len(places_m) < LEAST_PLANTS:
        return None
    tables = [_fit(places_m, yaw_rad, start_xy_m) for yaw_rad in _list_directions(places_m)]
    return max((t for t in tables if t), key=lambda table: table.row_length_m, default=None)


def _list_directions(places_m: FloatArray) -> Iterator[float]:
    """List directions in which neighbours stand, the most frequent ones, and those across them."""
    sample = places_m[:: max(1, len(places_m) // MOST_SAMPLES)]
    apart = places_m[None] - sample[:, None]
    distance_m = np.hypot(apart[..., 0], apart[..., 1])
    distance_m[distance_m == 0.0] = np.inf
    nearest = np.take_along_axis(apart, distance_m.argmin(1)[:, None, None], axis=1)[:, 0]
    yaw_deg = np.degrees(np.arctan2(nearest[:, 1], nearest[:, 0])) % 180.0
    counts = np.bincount((yaw_deg / 3.0).round().astype(int) % 60, minlength=60)
    for index in np.argsort(-counts, kind="stable")[:3]:
        if counts[index]:
            yield from (math.radians(3.0 * index), math.radians(3.0 * index + 90.0))


def _fit(
    places_m: FloatArray, about_rad: float, start_xy_m: tuple[float, float]
) -> RowTable | None:
    yaw_rad = _sharpen(places_m, about_rad)
    for _ in range(ALIGNMENTS):
        yaw_rad = _align(places_m, yaw_rad)
    middle, start = _turn(places_m.mean(axis=0), yaw_rad), _turn(np.array(start_xy_m), yaw_rad)
    yaw_rad += 0.0 if middle[0] >= start[0] else math.pi  # away from the start
    ahead_m, right_m = _turn(places_m, yaw_rad)
    rows = _split(right_m)
    middles_m = np.array([float(right_m[row].mean()) for row in rows])
    pitch_m = float(np.diff(middles_m).mean()) if len(rows) > 1 else DEFAULTS["pitch_m"]
    off_m = np.abs(np.diff(middles_m) - pitch_m).max(initial=0.0)
    widest_m, length_m = max(np.ptp(right_m[row]) for row in rows), float(np.ptp(ahead_m))
    are_rows = min(map(len, rows)) >= 2 and length_m >= LEAST_LENGTH_M and widest_m < pitch_m / 2.0
    if not are_rows or pitch_m < LEAST_PITCH_M or off_m > SAME_PITCH_RATIO * pitch_m:
        return None
    first_m = float((middles_m - pitch_m * np.arange(len(rows))).mean())
    x_m, y_m = ahead_m.min() * _heading(yaw_rad) + first_m * _heading(yaw_rad - math.pi / 2.0)
    return RowTable(
        first_row_start_map_m=(round(float(x_m), 3), round(float(y_m), 3)),
        row_yaw_deg=_wrap_deg(round(math.degrees(yaw_rad), 3)),
        row_length_m=round(length_m, 3),
        row_pitch_m=round(pitch_m, 4),
        row_count=len(rows),
    )


def _sharpen(places_m: FloatArray, about_rad: float) -> float:
    """Turn a direction so that the crop lies in the narrowest rows."""
    candidates = about_rad + np.radians(TURN_DEG)
    widths_m = []
    for yaw_rad in candidates.tolist():
        gaps_m = np.diff(np.sort(_turn(places_m, yaw_rad)[1]))
        widths_m.append(float(gaps_m[gaps_m <= GAP_M].sum()))
    return float(candidates[int(np.argmin(widths_m))])


def _align(places_m: FloatArray, yaw_rad: float) -> float:
    """Turn a direction along the crop of its rows, by least squares."""
    ahead_m, right_m = _turn(places_m, yaw_rad)
    along_m, off_m = ahead_m.copy(), right_m.copy()
    for row in _split(right_m):
        along_m[row] -= along_m[row].mean()
        off_m[row] -= off_m[row].mean()
    return yaw_rad - math.atan2(float(along_m @ off_m), float(along_m @ along_m))


def _split(right_m: FloatArray) -> list[npt.NDArray[np.int64]]:
    """Split crop (n,) into rows, from left to right: the indices of each."""
    order = np.argsort(right_m, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(right_m[order]) > GAP_M) + 1)


def _turn(places_m: FloatArray, yaw_rad: float) -> tuple[FloatArray, FloatArray]:
    """Return how far places (..., 2) lie ahead and to the right of a direction, (...,) each."""
    return places_m @ _heading(yaw_rad), places_m @ _heading(yaw_rad - math.pi / 2.0)


def _heading(yaw_rad: float) -> FloatArray:
    return np.array([math.cos(yaw_rad), math.sin(yaw_rad)])


def _wrap_deg(angle_deg: float) -> float:
    return round((angle_deg + 180.0) % 360.0 - 180.0, 6) + 0.0
