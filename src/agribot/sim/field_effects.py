"""Effects of the robot's wheels on the field: crops crushed."""

from __future__ import annotations

import math

import numpy as np

from agribot.core.messages import FloatArray, PlantClass
from agribot.core.robot import RobotSpec
from agribot.core.world import WorldSpec
from agribot.sim.footprints import Footprints, build_plant_grid, mark_swept


class CropDamage:
    """Crops whose stem got under a wheel."""

    def __init__(self, robot: RobotSpec, world: WorldSpec) -> None:
        crops = [i for i, plant in enumerate(world.plants) if plant.plant == PlantClass.CROP]
        self._index = np.array(crops, dtype=np.int64)
        plants = [world.plants[i] for i in crops]
        self._grid = build_plant_grid(
            plants, np.array([p.stem_radius_m for p in plants], dtype=float)
        )
        self._hit_s = np.full(len(crops), np.nan)
        self._active = np.ones(4, dtype=bool)
        drive = robot.drive
        sunk_m = robot.mass_kg * world.gravity_mps2 / 4.0 / robot.tyre.normal_stiffness_npm
        self._feet = Footprints(
            robot.wheel_xy_body_m(),
            math.sqrt(2.0 * drive.wheel_radius_m * sunk_m),
            drive.wheel_width_m / 2.0,
            robot.base_height_m,
        )

    def update(self, t_s: float, before: FloatArray, after: FloatArray) -> None:
        """Mark the crops under the wheels between two rows of the physics history."""
        if self._index.size:
            mark_swept(before, after, self._feet, self._active, self._grid, self._hit_s, t_s)

    @property
    def crushed(self) -> set[int]:
        """The crushed crops, as indices into the world's plants."""
        return set(self._index[~np.isnan(self._hit_s)].tolist())
