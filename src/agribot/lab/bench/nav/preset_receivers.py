"""The simulator's receivers on the rovers of the benchmark."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from agribot.core.errors import ConfigError
from agribot.core.messages import FloatArray, GnssFix
from agribot.core.robot import RobotSpec
from agribot.lab.bench.nav.plant import RoverFleet
from agribot.lab.bench.nav.scenario import DT_S, Scenario
from agribot.sim.sensors.gnss import Antenna, Receiver
from agribot.sim.sensors.presets import PhysicalGnss, load_preset
from agribot.sim.state import ANGULAR, HISTORY_COLUMNS, POSITION, QUATERNION, VELOCITY


class PresetReceivers:
    """One receiver of a preset for each seed, which sees the truth of its rover."""

    def __init__(self, seeds: Sequence[int], scenario: Scenario, robot: RobotSpec) -> None:
        errors = load_preset(scenario.receiver).gnss
        if not isinstance(errors, PhysicalGnss):
            raise ConfigError(f"{scenario.receiver}: its receiver has no physical model")
        x_m, y_m, z_m = robot.body_from_link(robot.gnss.link)[:3, 3].tolist()
        antenna = Antenna(scenario.field().datum, (x_m, y_m, z_m))
        self._receivers = [Receiver(errors, antenna, seed) for seed in seeds]
        self._period_steps = round(1.0 / (DT_S * (errors.rate_hz or robot.gnss.rate_hz)))
        self._latency_s = errors.latency_s
        self._late: list[tuple[float, list[GnssFix]]] = []

    def step(self, k: int, plant: RoverFleet) -> None:
        """Sample where a fix is due."""
        if k % self._period_steps:
            return
        t_s, rows = k * DT_S, _list_states(plant)
        fixes = [each.sample(t_s, row) for each, row in zip(self._receivers, rows, strict=True)]
        self._late.append((t_s + self._latency_s, fixes))

    def take(self, t_s: float) -> list[list[GnssFix]]:
        """Take the fixes that have arrived, in the order of the robots."""
        arrived = [fixes for at_s, fixes in self._late if at_s <= t_s + 1e-9]
        del self._late[: len(arrived)]
        return [list(each) for each in zip(*arrived, strict=True)] or [[] for _ in self._receivers]


def _list_states(plant: RoverFleet) -> FloatArray:
    """Write the truth of each rover, on level ground, as a row of the simulator's history."""
    cos, sin = np.cos(plant.yaw_rad), np.sin(plant.yaw_rad)
    rows = np.zeros((len(plant.x_m), HISTORY_COLUMNS))
    rows[:, POSITION][:, :2] = np.stack([plant.x_m, plant.y_m], axis=1)
    half_rad = plant.yaw_rad / 2.0
    rows[:, QUATERNION][:, [0, 3]] = np.stack([np.cos(half_rad), np.sin(half_rad)], axis=1)
    east_mps = cos * plant.v_mps - sin * plant.lateral_mps
    north_mps = sin * plant.v_mps + cos * plant.lateral_mps
    rows[:, VELOCITY][:, :2] = np.stack([east_mps, north_mps], axis=1)
    rows[:, ANGULAR.stop - 1] = plant.yaw_rate_radps
    return rows
