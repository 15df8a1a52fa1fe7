"""The spot sprayer in the simulator: what is below an open nozzle gets wet."""

from __future__ import annotations

import numpy as np

from agribot.core.implement.kind import Pull
from agribot.core.implement.sprayer import SprayerSpec
from agribot.core.messages import FloatArray, ImplementCommand
from agribot.core.world import WorldSpec
from agribot.sim.implements.sections import DelayedSections, SectionSwath

# A flat-fan nozzle wets a thin line across the direction of travel.
SPRAY_FAN_LENGTH_M = 0.04


class SprayEffect:
    """Valves that open and close a latency after the command."""

    def __init__(self, spec: SprayerSpec, world: WorldSpec, base_height_m: float) -> None:
        self.worked_m2 = 0.0
        self._valves = DelayedSections(spec)
        stems_m = np.zeros(len(world.plants))
        self._swath = SectionSwath(spec, world.plants, stems_m, SPRAY_FAN_LENGTH_M, base_height_m)

    def command(self, t_s: float, command: ImplementCommand) -> None:
        self._valves.command(t_s, command.sections_on)

    def update(self, t_s: float, before: FloatArray, after: FloatArray, dt_s: float) -> None:
        """Spray over the tick that ends at `t_s`; valves move at its start."""
        self._valves.advance(t_s - dt_s)
        if self._valves.is_on.any():
            self.worked_m2 += self._swath.sweep(t_s, before, after, self._valves.is_on)

    def pull(self) -> Pull | None:
        return None

    @property
    def treated(self) -> dict[int, float]:
        return self._swath.touched
