"""What stands around the robot, as few points in its body frame, from the scans of a lidar."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import numpy.typing as npt

from agribot.core.keep_out import BodyBox
from agribot.core.messages import FloatArray, LaserScan, ObstacleSample, SensorBatch
from agribot.core.robot import RobotSpec

# Width of a direction, rad; its nearest return stands for all. A leg of 16 cm is 2.3 deg at 4 m.
SECTOR_RAD = math.radians(2.0)
FAR_M = 8.0  # distance from the lidar beyond which nothing counts
OWN_M = 0.03  # distance around the robot's body within which a return is its own
# Least 1 sigma of a range, m: data sheets of small planar lidars say 2 to 3 cm.
LEAST_STD_M = 0.03


class ScanObstacles:
    """Adds to each batch what its scans show; a batch of a recording has that already."""

    def __init__(self, robot: RobotSpec, body: BodyBox) -> None:
        """`body` is the rectangle of the robot, whose own returns do not count."""
        self._lidar, self._body = robot.lidar, body
        if robot.lidar is not None:
            self._body_from_lidar = robot.body_from_link(robot.lidar.link)
            self._std_m = max(robot.lidar.noise_std_m, LEAST_STD_M)

    def add(self, batch: SensorBatch) -> SensorBatch:
        if self._lidar is None or not batch.scans:
            return batch
        found = tuple(self._read(scan) for scan in batch.scans)
        return msgspec.structs.replace(batch, obstacles=(*batch.obstacles, *found))

    def _read(self, scan: LaserScan) -> ObstacleSample:
        """Reduce a scan; too near to be measured is as near as can be measured."""
        ranges_m = np.array(scan.ranges_m, dtype=np.float64)
        ranges_m[np.isneginf(ranges_m)] = scan.range_min_m
        angles_rad: FloatArray = scan.min_angle_rad + scan.step_rad * np.arange(
            float(len(ranges_m))
        )
        is_near = ranges_m <= FAR_M  # false for NaN
        points_m = self._place(ranges_m[is_near], angles_rad[is_near])
        nearest = _choose_nearest(ranges_m[is_near], angles_rad[is_near])
        points_m = points_m[nearest]
        points_m = points_m[~self._is_own(points_m)]
        return ObstacleSample(
            t_s=scan.t_s, sensor="lidar", std_m=self._std_m,
            points_body_m=tuple((round(x, 3), round(y, 3)) for x, y in points_m.tolist()),
        )  # fmt: skip

    def _place(self, ranges_m: FloatArray, angles_rad: FloatArray) -> FloatArray:
        """Return the places of returns in the body frame, (n, 2)."""
        x_m, y_m = ranges_m * np.cos(angles_rad), ranges_m * np.sin(angles_rad)
        turn, place_m = self._body_from_lidar[:2, :2], self._body_from_lidar[:2, 3]
        placed: FloatArray = np.stack([x_m, y_m], axis=1) @ turn.T + place_m
        return placed

    def _is_own(self, points_m: FloatArray) -> npt.NDArray[np.bool_]:
        body, x_m, y_m = self._body, points_m[:, 0], points_m[:, 1]
        is_along = (x_m < body.front_m + OWN_M) & (x_m > -body.rear_m - OWN_M)
        is_own: npt.NDArray[np.bool_] = is_along & (np.abs(y_m) < body.half_width_m + OWN_M)
        return is_own


def _choose_nearest(ranges_m: FloatArray, angles_rad: FloatArray) -> npt.NDArray[np.intp]:
    """Return the index of the nearest return in each direction."""
    order = np.lexsort((ranges_m, np.floor(angles_rad / SECTOR_RAD)))
    _, first = np.unique(np.floor(angles_rad[order] / SECTOR_RAD), return_index=True)
    chosen: npt.NDArray[np.intp] = order[first]
    return chosen
