"""What one line of the table drives."""

from __future__ import annotations

import msgspec

from agribot.core.robot import RobotSpec
from agribot.lab.bench.nav.scenario import Scenario


class Job(msgspec.Struct, frozen=True, kw_only=True):
    """Missions of one scenario, one for each seed."""

    scenario: Scenario
    seeds: tuple[int, ...]
    robot: RobotSpec
    is_original: bool = False

    @property
    def name(self) -> str:
        if self.is_original:
            return f"original robot, {self.scenario.sensors}, {self.scenario.variant}"
        return self.scenario.name
