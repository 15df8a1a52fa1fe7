"""Tools that work in a simulated drive beside the robot's own, each by a map of its own."""

from __future__ import annotations

from collections.abc import Mapping

from agribot.app.simulated_run import SimulatedRun
from agribot.autonomy.implements.treatment import Treatment
from agribot.autonomy.weeds.map import WeedMap
from agribot.core.config import TreatmentConfig
from agribot.core.errors import DescriptionError
from agribot.core.implement.kind import ImplementEffect
from agribot.core.implement.plants import PlantMap
from agribot.core.messages import Estimate, ImplementCommand, Scene, TickRecord
from agribot.lab.bench.true_names import TrueNames
from agribot.sim.implements.kinds import fit_effect

SHIPPED, TRUE = "shipped", "true"  # names of plants: by the run's network, or by the renderer
Variant = tuple[str, str]  # names, rule


class SideTool:
    """Controller of a tool, its map, and its effect on a field of its own."""

    def __init__(self, treatment: Treatment, weed_map: WeedMap, effect: ImplementEffect) -> None:
        self.effect = effect
        self._treatment, self._map = treatment, weed_map

    def step(self, estimate: Estimate, scenes: tuple[Scene, ...], tool_on: bool) -> None:
        """Take in what a tick has shown, and command the sections."""
        self._map.track_pose(estimate)
        for scene in scenes:
            self._map.add(scene)
        command = self._treatment.step(estimate, self._map, tool_on)
        self.effect.command(estimate.t_s, command)


class SideTools:
    """A tap of a simulated run: each tool meets the plants as if it were the robot's own."""

    def __init__(self, session: SimulatedRun, variants: Mapping[Variant, TreatmentConfig]) -> None:
        """Fit the tools, before the first tick.

        Raises: DescriptionError: the robot has no implement.
        """
        config, robot = session.config, session.robot
        if robot.implement is None:
            raise DescriptionError(f"robot '{robot.name}' has no implement; give one that has")
        self._simulator = session.simulator
        self._own = session.stack.treatment = _WatchedTreatment(config.treatment, robot.implement)
        self._true = TrueNames(session.world, robot, config.perception)
        self._last_s: float | None = None
        self.tools = {
            variant: SideTool(
                Treatment(settings, robot.implement),
                WeedMap(config.weeds),
                fit_effect(robot.implement, session.world, robot.base_height_m),
            )
            for variant, settings in variants.items()
        }
        session.simulator.add_view_tap(self._true)
        session.add_tap(self)

    def __call__(self, record: TickRecord) -> None:
        t_s, last_s = record.batch.t_s, self._last_s
        self._last_s = t_s
        before, after = self._simulator.motion
        seen = {SHIPPED: record.scenes, TRUE: tuple(map(self._true.observe, record.scenes))}
        for (names, _), tool in self.tools.items():
            if last_s is not None:
                tool.effect.update(t_s, before, after, t_s - last_s)
            tool.step(record.estimate, seen[names], self._own.tool_on)


class _WatchedTreatment(Treatment):
    """The robot's own, which remembers whether the mission wants the tool."""

    tool_on = False

    def step(self, estimate: Estimate, plants: PlantMap, tool_on: bool) -> ImplementCommand:
        self.tool_on = tool_on
        return super().step(estimate, plants, tool_on)
