"""A planar lidar: rays into the world from where it is mounted, with noise and limits."""

from __future__ import annotations

import numpy as np

from agribot.core.geo import transform
from agribot.core.messages import FloatArray, LaserScan
from agribot.core.robot import RobotSpec
from agribot.sim.attitude import read_rotation
from agribot.sim.ray_scene import RayScene
from agribot.sim.state import POSITION


class Lidar:
    """All rays of a scan leave at once, at its time; the robot itself is not in their way."""

    def __init__(self, robot: RobotSpec, scene: RayScene, rng: np.random.Generator) -> None:
        assert robot.lidar is not None
        self._spec, self._scene, self._rng = robot.lidar, scene, rng
        self._base_from_lidar = robot.base_from_link(self._spec.link)
        angles_rad = self._spec.min_angle_rad + self._spec.step_rad * np.arange(self._spec.samples)
        self._rays = np.stack(
            [np.cos(angles_rad), np.sin(angles_rad), np.zeros_like(angles_rad)], axis=1
        )

    def sample(self, t_s: float, row: FloatArray) -> LaserScan:
        """Return the scan for one row of the physics history."""
        spec = self._spec
        map_from_base = transform(tuple(row[POSITION].tolist()))
        map_from_base[:3, :3] = read_rotation(row)
        map_from_lidar = map_from_base @ self._base_from_lidar
        directions = self._rays @ map_from_lidar[:3, :3].T
        ranges_m = self._scene.cast(
            np.ascontiguousarray(map_from_lidar[:3, 3]), directions, spec.range_max_m, t_s
        )
        ranges_m += spec.noise_std_m * self._rng.standard_normal(len(ranges_m))
        ranges_m[ranges_m > spec.range_max_m] = np.inf
        ranges_m[ranges_m < spec.range_min_m] = -np.inf
        return LaserScan(
            t_s=t_s,
            min_angle_rad=spec.min_angle_rad,
            step_rad=spec.step_rad,
            range_min_m=spec.range_min_m,
            range_max_m=spec.range_max_m,
            period_s=1.0 / spec.rate_hz,
            ranges_m=ranges_m,
        )
