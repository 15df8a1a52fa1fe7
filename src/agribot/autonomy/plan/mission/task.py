"""What a mission works at, and how it finds its ways: all of it can be exchanged at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from agribot.autonomy.plan.coverage.drive import FieldWork
from agribot.autonomy.plan.explore.explorer import Explorer
from agribot.autonomy.plan.mission.route import Tool
from agribot.autonomy.plan.mission.saved_mission import PoseTuple
from agribot.autonomy.plan.ways.curves import Place
from agribot.core.field_bounds import FieldBounds
from agribot.core.messages import Estimate, FloatArray, MapPoint, Path, Row


class Task(Protocol):
    """Rows or waypoints, and the planners of every way that a mission over them drives.

    All planners raise a MissionError that says why they find no way. Where a planner begins at
    `here`, it is called once the robot stands there and its estimate has settled.
    """

    @property
    def rows(self) -> Sequence[Row]:
        """Work by the index that the path names; none where places are visited."""
        ...

    @property
    def waypoints(self) -> Sequence[MapPoint]:
        """Places that the planned path visits, in its order."""
        ...

    @property
    def tool(self) -> Tool: ...

    @property
    def has_crop(self) -> bool:
        """Whether the robot slows down as it knows less well where the rows are."""
        ...

    @property
    def clearance_m(self) -> float:
        """Distance from a row at which a wheel reaches crop."""
        ...

    @property
    def bounds(self) -> FieldBounds | None:
        """The field that must not be left."""
        ...

    @property
    def work(self) -> FieldWork | None:
        """The field plan that the task was made of."""
        ...

    @property
    def explorer(self) -> Explorer | None:
        """Explorer that finds rows under way and leads the robot over them; None: known rows."""
        ...

    @property
    def text(self) -> str:
        """Source text of a field plan that came under way."""
        ...

    @property
    def name(self) -> str:
        """Name of a visit; empty for all other tasks."""
        ...

    @property
    def planning_s(self) -> float:
        """Time given to `plan`, off the control loop; 0 where it takes less than a tick."""
        ...

    @property
    def errand_planning_s(self) -> float:
        """Time given to the planners of ways beside the work."""
        ...

    @property
    def has_ways(self) -> bool:
        """Whether it plans ways beside its own path: home, to places and back."""
        ...

    def plan(self, here: Estimate) -> Path:
        """Plan the whole task."""
        ...

    def plan_rest(self, here: Estimate, indices: Sequence[int]) -> Path:
        """Plan over the rows that an interrupted mission has left, or over all, where it cannot."""
        ...

    def plan_around(self, path: Path, index: int, skipped: int) -> Path:
        """Keep a path up to one of its points, and leave a row out of the rest of it."""
        ...

    def plan_home(self, here: Estimate, home: PoseTuple, row_ahead: FloatArray) -> Path:
        """Plan the way home, first along what is left of the row under the robot, (N, 2)."""
        ...

    def plan_to(self, here: Estimate, goal: Place) -> Path:
        """Plan a way to a place that somebody points at."""
        ...

    def plan_back(self, here: Estimate, place: Place) -> Path:
        """Plan a way to a place of the task's own path."""
        ...


class NewTasks(Protocol):
    """Makes the tasks that come in under way."""

    @property
    def checking_s(self) -> float:
        """Time given to the check of a field plan, off the control loop."""
        ...

    def read_plan(self, text: str) -> Task:
        """Read a field plan. Raises: MissionError: it is not a plan, or must not be driven."""
        ...

    def visit(self, places: Sequence[MapPoint], name: str, bounds: FieldBounds | None) -> Task:
        """Visit places, inside the field of the task before."""
        ...
