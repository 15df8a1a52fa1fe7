"""What only the simulator knows, as events: crops crushed or sprayed, what was touched, levels."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from agribot.core.messages import Estimate, PlantClass, TickRecord
from agribot.core.world import Plant, WorldSpec, is_person
from agribot.record.events import Event

if TYPE_CHECKING:
    from agribot.sim.platform import SimPlatform

LET_GO_S = 2.0  # time without contact, before the same thing counts as touched anew
KEPT_S = 2.0  # time within a protection level, before leaving it counts anew


class TruthLog:
    """A tap that says once of each crop what hurt it, and of each thing that it was touched."""

    def __init__(
        self, simulator: SimPlatform, world: WorldSpec, add: Callable[[Event], None]
    ) -> None:
        self._simulator, self._world, self._add = simulator, world, add
        self._kinds = {thing.name: thing.kind for thing in world.obstacles}
        self._kinds |= {walker.name: walker.kind for walker in world.walkers}
        self._fallen_reported = self._sprayed_reported = 0
        self._touched_s: dict[str, float] = {}
        self._over_level_s = -KEPT_S

    def __call__(self, record: TickRecord) -> None:
        self._report_crushed(record.batch.t_s)
        self._report_sprayed(record.batch.t_s)
        self._report_level(record.batch.t_s, record.estimate)
        if record.batch.bumper:
            self._report_touched(record.batch.t_s)

    def _report_crushed(self, t_s: float) -> None:
        from agribot.sim.underside import PART_WORDS

        states = self._simulator.plants
        fallen = states.fallen[self._fallen_reported :]
        self._fallen_reported += len(fallen)
        for index in fallen:
            plant, what = self._world.plants[index], PART_WORDS.get(int(states.crushed_by[index]))
            is_news = states.crushed_s[index] > 0.0  # not of an earlier run of the job
            if what and is_news and plant.plant == PlantClass.CROP:
                self._report(t_s, f"crop plant crushed by {what}: {_name_place(plant)}")

    def _report_sprayed(self, t_s: float) -> None:
        states = self._simulator.plants
        sprayed = states.sprayed[self._sprayed_reported :]
        self._sprayed_reported += len(sprayed)
        for index in sprayed:
            plant = self._world.plants[index]
            is_news = states.sprayed_s[index] > 0.0  # not of an earlier run of the job
            if is_news and plant.plant == PlantClass.CROP:
                self._report(t_s, f"crop plant sprayed on its heart: {_name_place(plant)}")

    def _report_touched(self, t_s: float) -> None:
        name = self._simulator.find_touched()
        if not name:
            return
        if t_s - self._touched_s.get(name, -LET_GO_S) >= LET_GO_S:
            what = "person" if is_person(self._kinds.get(name, "")) else "obstacle"
            self._report(t_s, f"touched the {what} '{name}'")
        self._touched_s[name] = t_s

    def _report_level(self, t_s: float, estimate: Estimate) -> None:
        from agribot.sim.safety_judge import is_over_level

        truth = self._simulator.truth()
        if not is_over_level(estimate, truth):
            return
        if t_s - self._over_level_s >= KEPT_S:
            place_m, true_m = (estimate.x_map_m, estimate.y_map_m), (truth.x_map_m, truth.y_map_m)
            off_m, level_m = math.dist(place_m, true_m), estimate.protection_m
            self._report(t_s, f"position {off_m:.2f} m off, above its protection level of "
                         f"{level_m:.2f} m")  # fmt: skip
        self._over_level_s = t_s

    def _report(self, t_s: float, reason: str) -> None:
        self._add(Event(t_s=t_s, kind="truth", reason=reason))


def _name_place(plant: Plant) -> str:
    return f"{plant.x_map_m:.2f} m east, {plant.y_map_m:.2f} m north"
