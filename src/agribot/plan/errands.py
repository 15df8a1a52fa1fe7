"""What the robot is told to do while it runs: places to visit take the place of its mission."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import msgspec

from agribot.messages import Estimate, Goal, OperatorEvent, Path
from agribot.plan.mission import Mission
from agribot.plan.row_log import RowResult
from agribot.plan.saved_mission import SavedMission

Point = tuple[float, float]
NewMission = Callable[[Sequence[Point]], Mission]


class Errands:
    """The mission of the settings, until a "visit" brings another one, which begins at once.

    Each takes the place of the one before, whatever came of that; it plans from where the robot
    stands, and fails with the planner's words where it cannot. Its status carries the event's
    text as `task`. A latched stop is not overridden: the visit then waits for `resume`.
    """

    def __init__(self, mission: Mission, visiting: NewMission, *, waits: bool = False) -> None:
        """With `waits` the mission of the settings begins only when somebody resumes it."""
        self._mission, self._visiting = mission, visiting
        self._waits = waits
        self._task = ""
        self._is_stopped = False
        self.goals_map_m: tuple[Point, ...] = ()  # of the visit, none of the mission

    @property
    def path(self) -> Path | None:
        return self._mission.path

    @property
    def row_results(self) -> tuple[RowResult, ...]:
        return self._mission.row_results

    @property
    def waypoints_reached(self) -> tuple[bool, ...]:
        return self._mission.waypoints_reached

    def saved(self) -> SavedMission | None:
        return self._mission.saved()

    def step(self, estimate: Estimate, events: Iterable[OperatorEvent] = ()) -> Goal:
        passed_on: list[OperatorEvent] = []
        if self._waits:
            self._waits = False
            source = "its settings, to wait for a goal"
            passed_on.append(OperatorEvent(t_s=estimate.t_s, action="pause", source=source))
        for event in events:
            if event.action == "visit":
                passed_on = self._visit(event) if event.numbers else passed_on
            else:
                self._is_stopped = event.action == "stop" or (
                    self._is_stopped and event.action != "clear_stop"
                )
                passed_on.append(event)
        goal = self._mission.step(estimate, passed_on)
        if self._task:
            status = msgspec.structs.replace(goal.status, task=self._task)
            goal = msgspec.structs.replace(goal, status=status)
        return goal

    def _visit(self, event: OperatorEvent) -> list[OperatorEvent]:
        xs_m, ys_m = event.numbers[::2], event.numbers[1::2]
        points = tuple(zip(xs_m, ys_m, strict=True)) if len(xs_m) == len(ys_m) else ()
        self._mission = self._visiting(points)
        self._task, self.goals_map_m = event.text or "visit", points
        if not self._is_stopped:
            return []
        return [OperatorEvent(t_s=event.t_s, action="stop", source="who stopped the robot before")]
