"""What a mission works at, and how it finds its ways: all of it can be exchanged at once."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from agribot.autonomy.plan.coverage.drive import FieldWork
from agribot.autonomy.plan.curves import Place
from agribot.autonomy.plan.route import AT_ORIGIN, Tool
from agribot.autonomy.plan.saved_mission import PoseTuple
from agribot.core.errors import MissionError
from agribot.core.field_bounds import FieldBounds
from agribot.core.messages import Estimate, FloatArray, OperatorEvent, Path, Row

Planner = Callable[[Estimate], Path]
# The way from where the robot is to its home pose, first along the rest of the row under it (N, 2).
HomePlanner = Callable[[Estimate, PoseTuple, FloatArray], Path]
# The path up to one of its points, and from there over the rows that it still works but one.
Detour = Callable[[Path, int, int], Path]
# From where the robot stands over these rows only, by number.
RestPlanner = Callable[[Estimate, Sequence[int]], Path]
PlacePlanner = Callable[[Estimate, Place], Path]


class Task(NamedTuple):
    """`plan` is asked once, from where the robot stands when its estimate has settled.

    `waypoints` are places in the map that the planned path visits, in its order. Where there
    is crop, the robot slows down as it knows less well where the rows are. `home`, `go_to` and
    `back` plan the ways home, to any place, and back to a place of the path; `around` leaves a
    skipped row out of the path, without it the row is passed with the tool off; `rest` plans over
    the rows that an interrupted mission has not worked yet. All planners
    raise a MissionError that says why they find no way. `work` is the field plan that the task
    was made of, `bounds` the field that must not be left, `text` what the plan was read from under
    way, `name` that of a visit. `planning_s` is given to the planner of its path,
    `errand_planning_s` to those of other ways, off the control loop; none where they take less
    than a tick.
    """

    plan: Planner
    rows: Sequence[Row] = ()
    waypoints: Sequence[tuple[float, float]] = ()
    tool: Tool = AT_ORIGIN
    has_crop: bool = True
    home: HomePlanner | None = None
    go_to: PlacePlanner | None = None
    back: PlacePlanner | None = None
    around: Detour | None = None
    rest: RestPlanner | None = None
    work: FieldWork | None = None
    bounds: FieldBounds | None = None
    text: str = ""
    name: str = ""
    planning_s: float = 0.0
    errand_planning_s: float = 0.0
    clearance_m: float = math.inf


class NewTasks(NamedTuple):
    """Tasks that come in under way: of the text of a field plan, of places and their name.

    `checking_s` is given to the check of a field plan, off the control loop.

    Raises: MissionError: it is no plan, or one that must not be driven.
    """

    of_plan: Callable[[str], Task]
    of_places: Callable[[Sequence[tuple[float, float]], str], Task]

    checking_s: float = 0.0

    def of(self, event: OperatorEvent) -> Task:
        """A plan, or a visit of places."""
        if event.action == "plan":
            return self.of_plan(event.text)
        xs_m, ys_m = event.numbers[::2], event.numbers[1::2]
        if not xs_m or len(xs_m) != len(ys_m):
            raise MissionError("it names no places: x and y (m, map) of each")
        return self.of_places(tuple(zip(xs_m, ys_m, strict=True)), event.text or "visit")
