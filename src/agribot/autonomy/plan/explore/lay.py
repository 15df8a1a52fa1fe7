"""A path that goes over from where it leads to another line, without a bend at the joint."""

from __future__ import annotations

import math

import numpy as np

from agribot.autonomy.plan.ways.curves import SPACING_M, Segment, advance, make_path, sample
from agribot.core.geo import wrap_rad
from agribot.core.messages import FloatArray, Path
from agribot.core.pose import Pose2

# Length of the driven path that is kept, m; see PathProgress.
KEPT_M = 3.5
# Way on which the robot changes to a line that the camera shows at a new place, m.
BLEND_M = 1.2


def take_pose_at(path: Path, s_m: float) -> Pose2:
    """Find the pose of a path beside a distance."""
    at = min(int(np.searchsorted(path.s_m, s_m)), len(path.s_m) - 1)
    x_m, y_m = path.xy_map_m[at].tolist()
    return Pose2(x_m, y_m, float(path.yaw_map_rad[at]))


def lay_on(path: Path, s_m: float, line: Pose2, length_m: float, row: int) -> Path:
    """Keep a path up to `s_m`, and go over to a line, along which the whole piece is that long.

    The lateral offset is a cubic Hermite polynomial of the way: offset and direction are those of
    the path at its beginning and those of the line at its end.
    """
    start = take_pose_at(path, s_m)
    along_m, left_m = line.locate(start.x_m, start.y_m)
    slope = math.tan(max(-1.0, min(1.0, wrap_rad(start.yaw_rad - line.yaw_rad))))
    count = max(2, math.ceil(length_m / SPACING_M))
    way_m = np.arange(count + 1) * length_m / count
    part = np.minimum(way_m / BLEND_M, 1.0)
    arm_m = slope * BLEND_M
    off_m = left_m * (1 - 3 * part**2 + 2 * part**3) + arm_m * (part - 2 * part**2 + part**3)
    turn = (left_m * (6 * part**2 - 6 * part) + arm_m * (1 - 4 * part + 3 * part**2)) / BLEND_M
    bend = (left_m * (12 * part - 6) + arm_m * (6 * part - 4)) / BLEND_M**2
    bend[part >= 1.0] = 0.0
    x_m, y_m = line.transform(along_m + way_m, off_m)
    table = np.empty((count + 1, 6))
    table[:, 0], table[:, 1] = x_m, y_m
    table[:, 2] = line.yaw_rad + np.arctan(turn)
    table[:, 3] = bend / (1.0 + turn**2) ** 1.5
    table[:, 4] = row
    table[:, 5] = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x_m), np.diff(y_m)))])
    return join(path, s_m, make_path(table))


def join(path: Path, s_m: float, rest: Path) -> Path:
    """Keep a path up to `s_m`, and go on along another one that begins there."""
    last = min(int(np.searchsorted(path.s_m, s_m)), len(path.s_m) - 1)
    first = int(np.searchsorted(path.s_m, s_m - KEPT_M))
    kept = make_table(path)[first:last]
    following = make_table(rest)
    following[:, 5] += path.s_m[last] - following[0, 5]
    return make_path(np.concatenate([kept, following]))


def back_out(here: Pose2, stop_m: float, back_m: float) -> Path:
    """Come to rest straight ahead, then drive straight back behind `here`, where it came from."""
    ahead = sample(here, [Segment(stop_m, 0.0)])
    back = make_table(sample(advance(here, -back_m), [Segment(stop_m + back_m, 0.0)]))
    length_m = float(back[-1, 5])
    back = back[::-1].copy()
    back[:, 5] = length_m - back[:, 5]
    return chain(ahead, make_path(back))


def chain(path: Path, rest: Path) -> Path:
    """Go on along a path that begins where another one ends, the other way: the robot stands."""
    following = make_table(rest)
    following[:, 5] += path.s_m[-1]
    return make_path(np.concatenate([make_table(path), following]))


def make_table(path: Path) -> FloatArray:
    """Make a table of a path, as `make_path` takes one."""
    return np.column_stack(
        [path.xy_map_m, path.yaw_map_rad, path.curvature_radpm, path.row, path.s_m]
    )
