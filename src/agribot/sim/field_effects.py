"""Effects of the robot on the field: crops crushed, plants sprayed, ground wetted."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from agribot.core.errors import PlatformError
from agribot.core.messages import FloatArray, PlantClass
from agribot.core.robot import RobotSpec
from agribot.core.world import WorldSpec
from agribot.sim.footprints import Footprints, build_plant_grid, mark_swept

# A flat-fan nozzle wets a thin line across the direction of travel.
SPRAY_FAN_LENGTH_M = 0.04


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
        if self._index.size:
            mark_swept(before, after, self._feet, self._active, self._grid, self._hit_s, t_s)

    @property
    def crushed(self) -> set[int]:
        """The crushed crops, as indices into the world's plants."""
        return set(self._index[~np.isnan(self._hit_s)].tolist())


class Sprayer:
    """Valves that open and close a latency after the command."""

    def __init__(self, robot: RobotSpec, world: WorldSpec) -> None:
        self.area_m2 = 0.0
        self._spec = robot.sprayer
        count = 0 if self._spec is None else self._spec.nozzle_count
        self._closed = (False,) * count
        self._wanted = self._closed
        self._open = np.zeros(count, dtype=bool)
        self._any_open = False
        self._pending: deque[tuple[float, tuple[bool, ...]]] = deque()
        self._grid = build_plant_grid(world.plants, np.zeros(len(world.plants)))
        self._hit_s = np.full(len(world.plants), np.nan)
        if self._spec is not None:
            places = [(self._spec.x_body_m, y_m) for y_m in self._spec.nozzle_y_body_m()]
            self._feet = Footprints(
                np.array(places),
                SPRAY_FAN_LENGTH_M / 2.0,
                self._spec.nozzle_width_m / 2.0,
                robot.base_height_m,
            )

    def command(self, t_s: float, nozzles_open: tuple[bool, ...]) -> None:
        """Open and close the nozzles after the valves' latency; an empty tuple closes all.

        Raises: PlatformError: the number of nozzles is not that of the robot.
        """
        wanted = nozzles_open or self._closed
        if len(wanted) != len(self._closed):
            raise PlatformError(
                f"command for {len(wanted)} nozzles; the robot has {len(self._closed)}, "
                "as its description says"
            )
        if wanted != self._wanted:
            self._wanted = wanted
            latency_s = 0.0 if self._spec is None else self._spec.latency_s
            self._pending.append((t_s + latency_s, wanted))

    def update(self, t_s: float, before: FloatArray, after: FloatArray, dt_s: float) -> None:
        """Spray over the tick that ends at `t_s`; valves move at its start."""
        while self._pending and self._pending[0][0] <= t_s - dt_s + 1e-9:
            self._open[:] = self._pending.popleft()[1]
            self._any_open = bool(self._open.any())
        if self._any_open:
            self.area_m2 += mark_swept(
                before, after, self._feet, self._open, self._grid, self._hit_s, t_s
            )

    @property
    def sprayed(self) -> dict[int, float]:
        """The sprayed plants: index into the world's plants -> time of the first drop, s."""
        hit = np.flatnonzero(~np.isnan(self._hit_s))
        return {int(i): float(self._hit_s[i]) for i in hit}
