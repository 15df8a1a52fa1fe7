"""Independent check of a path: nothing here knows how the path was planned."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from agribot.autonomy.plan.ways.curves import MIN_RADIUS_M
from agribot.core.errors import MissionError
from agribot.core.facts import OverCrop, PathBroken, PathNotFinite, PathRule, PathShort, PathTight
from agribot.core.messages import FloatArray, Path, Row
from agribot.core.robot import RobotSpec
from agribot.core.row_shape import row_points_map_m

MAX_SPACING_M = 0.05
STEP_TOLERANCE_M = 2e-3  # tolerance of a step's length and direction
REACH_M = 2.0  # crop farther from a wheel than this cannot matter
_CHUNK = 256


class Closest(NamedTuple):
    """Closest wheel to the crop; `crop` counts rows, or plants if these were given.

    `clearance_m` is measured from the edge of the wheel and is infinite beyond REACH_M.
    """

    clearance_m: float
    wheel: str
    point: int
    crop: int


def certify(
    path: Path,
    rows: Sequence[Row],
    robot: RobotSpec,
    clearance_m: float,
    plants_xy: FloatArray | None = None,
) -> None:
    """Accept a path that can be driven and keeps every wheel off the crop.

    The crop is the strip from the first to the last plant of each row, or the given plants
    (M, 2) in the map where their places are known.
    Raises: MissionError: names the first broken rule and the place.
    """
    _check_finite(path)
    _check_steps(path)
    _check_curvature(path)
    closest = find_closest_to_crop(path, robot, rows, plants_xy)
    if closest.clearance_m >= clearance_m:
        return
    is_row = plants_xy is None
    raise MissionError(
        OverCrop(
            closest.wheel,
            "row" if is_row else "plant",
            rows[closest.crop].index if is_row else closest.crop,
            *_find_place(path, closest.point),
            closest.clearance_m,
            clearance_m,
        )
    )


def find_closest_to_crop(
    path: Path, robot: RobotSpec, rows: Sequence[Row], plants_xy: FloatArray | None = None
) -> Closest:
    """Find where a wheel comes closest to the rows, or to plants (M, 2) in the map."""
    if plants_xy is None:
        lines = [row_points_map_m(row) for row in rows]
        starts = np.concatenate([np.empty((0, 2)), *(line[:-1] for line in lines)])
        ends = np.concatenate([np.empty((0, 2)), *(line[1:] for line in lines)])
        owner = np.repeat(np.arange(len(rows)), [len(line) - 1 for line in lines])
    else:
        starts = ends = np.asarray(plants_xy, dtype=np.float64).reshape(-1, 2)
        owner = np.arange(len(starts))
    low_m, high_m = np.minimum(starts, ends) - REACH_M, np.maximum(starts, ends) + REACH_M
    wheels = trace_wheels_map_m(path, robot)
    best = Closest(np.inf, "", -1, -1)
    for first in range(0, len(wheels), _CHUNK):
        chunk = wheels[first : first + _CHUNK].reshape(-1, 2)
        near = np.all((high_m >= chunk.min(axis=0)) & (low_m <= chunk.max(axis=0)), axis=1)
        crops = np.flatnonzero(near)
        if not len(crops):
            continue
        distance_m = _measure_distances_m(chunk, starts[crops], ends[crops])
        at, crop = np.unravel_index(np.argmin(distance_m), distance_m.shape)
        clearance_m = float(distance_m[at, crop]) - robot.drive.wheel_width_m / 2.0
        if clearance_m < min(best.clearance_m, REACH_M):
            point, wheel = divmod(int(at), len(robot.wheel_names))
            name = robot.wheel_names[wheel]
            best = Closest(clearance_m, name, first + point, int(owner[crops[crop]]))
    return best


def trace_wheels_map_m(path: Path, robot: RobotSpec) -> FloatArray:
    """Trace the ground contacts of the wheels along the path, (N, wheels, 2) in the map."""
    cos, sin = np.cos(path.yaw_map_rad)[:, None], np.sin(path.yaw_map_rad)[:, None]
    x_body_m, y_body_m = robot.wheel_xy_body_m().T
    offsets = np.stack([cos * x_body_m - sin * y_body_m, sin * x_body_m + cos * y_body_m], axis=-1)
    return np.asarray(path.xy_map_m[:, None, :] + offsets)


def _measure_distances_m(points: FloatArray, starts: FloatArray, ends: FloatArray) -> FloatArray:
    """Measure distances from each point (N, 2) to each segment (M), (N, M)."""
    along = ends - starts
    square = np.maximum(np.sum(along * along, axis=1), 1e-12)
    offset = points[:, None, :] - starts[None, :, :]
    ratio = np.clip(np.sum(offset * along, axis=2) / square, 0.0, 1.0)
    gap = offset - ratio[:, :, None] * along
    return np.asarray(np.hypot(gap[:, :, 0], gap[:, :, 1]))


def _find_place(path: Path, point: int) -> tuple[float, float, float]:
    """Find a point in the map, and how far along the path it is."""
    east_m, north_m = path.xy_map_m[point].tolist()
    return east_m, north_m, float(path.s_m[point])


def _check_finite(path: Path) -> None:
    columns = (*path.xy_map_m.T, path.yaw_map_rad, path.curvature_radpm, path.s_m)
    bad = ~np.all(np.isfinite(np.stack(columns)), axis=0)
    if len(bad) < 2:
        raise MissionError(PathShort(len(bad)))
    if bad.any():
        raise MissionError(PathNotFinite(int(np.argmax(bad))))


def _check_steps(path: Path) -> None:
    """Points follow each other closely, in the direction they claim, and `s_m` counts them."""
    step = np.diff(path.xy_map_m, axis=0)
    step_m = np.hypot(step[:, 0], step[:, 1])
    counted_m = np.diff(path.s_m)
    middle_rad = path.yaw_map_rad[:-1] + np.diff(np.unwrap(path.yaw_map_rad)) / 2.0
    sideways_m = step[:, 1] * np.cos(middle_rad) - step[:, 0] * np.sin(middle_rad)
    forward_m = step[:, 0] * np.cos(middle_rad) + step[:, 1] * np.sin(middle_rad)
    is_miscounted = (counted_m <= 0.0) | (np.abs(counted_m - step_m) > STEP_TOLERANCE_M)
    is_turned = (np.abs(sideways_m) > STEP_TOLERANCE_M) | (forward_m < 0.0)
    _refuse_at(path, step_m > MAX_SPACING_M, "spacing", MAX_SPACING_M)
    _refuse_at(path, is_miscounted, "distance", STEP_TOLERANCE_M)
    _refuse_at(path, is_turned, "heading", STEP_TOLERANCE_M)


def _refuse_at(path: Path, broken: npt.NDArray[np.bool_], rule: PathRule, limit_m: float) -> None:
    if broken.any():
        place = _find_place(path, int(np.argmax(broken)))
        raise MissionError(PathBroken(rule, limit_m, *place))


def _check_curvature(path: Path) -> None:
    """Neither the stated curvature nor the turn between points may be tighter than drivable."""
    turned_rad = np.abs(np.diff(np.unwrap(path.yaw_map_rad)))
    limit_radpm = (1.0 + 1e-6) / MIN_RADIUS_M
    tight = np.abs(path.curvature_radpm) > limit_radpm
    tight[:-1] |= turned_rad > limit_radpm * np.diff(path.s_m) + 1e-6
    if tight.any():
        raise MissionError(PathTight(MIN_RADIUS_M, *_find_place(path, int(np.argmax(tight)))))
