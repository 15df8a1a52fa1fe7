"""Tasks whose planners are whatever a test gives."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from agribot.autonomy.plan.coverage.drive import FieldWork
from agribot.autonomy.plan.explore.explorer import Explorer
from agribot.autonomy.plan.mission.route import AT_ORIGIN, Tool
from agribot.autonomy.plan.mission.saved_mission import PoseTuple
from agribot.autonomy.plan.mission.task import Task
from agribot.autonomy.plan.ways.curves import Place
from agribot.core.errors import MissionError
from agribot.core.facts import Said
from agribot.core.field_bounds import FieldBounds
from agribot.core.messages import Estimate, FloatArray, MapPoint, Path, Row


@dataclass
class PaperTask:
    """What is not given is not known: such a way is refused, the rest is planned as the whole."""

    whole: Callable[[Estimate], Path]
    rows: Sequence[Row] = ()
    waypoints: Sequence[MapPoint] = ()
    tool: Tool = AT_ORIGIN
    has_crop: bool = True
    home: Callable[[Estimate, PoseTuple, FloatArray], Path] | None = None
    go_to: Callable[[Estimate, Place], Path] | None = None
    around: Callable[[Path, int, int], Path] | None = None
    rest: Callable[[Estimate, Sequence[int]], Path] | None = None
    work: FieldWork | None = None
    explorer: Explorer | None = None
    bounds: FieldBounds | None = None
    text: str = ""
    name: str = ""
    planning_s: float = 0.0
    errand_planning_s: float = 0.0
    clearance_m: float = math.inf

    @property
    def has_ways(self) -> bool:
        return self.home is not None or self.go_to is not None

    def plan(self, here: Estimate) -> Path:
        return self.whole(here)

    def plan_rest(self, here: Estimate, indices: Sequence[int]) -> Path:
        return self.rest(here, indices) if self.rest else self.whole(here)

    def plan_around(self, path: Path, index: int, skipped: int) -> Path:
        if self.around is None:
            raise MissionError(Said("no way around is known"))
        return self.around(path, index, skipped)

    def plan_home(self, here: Estimate, home: PoseTuple, row_ahead: FloatArray) -> Path:
        if self.home is None:
            raise MissionError(Said("no way home is known"))
        return self.home(here, home, row_ahead)

    def plan_to(self, here: Estimate, goal: Place) -> Path:
        if self.go_to is None:
            raise MissionError(Said("no way to places is known"))
        return self.go_to(here, goal)

    def plan_back(self, here: Estimate, place: Place) -> Path:
        return self.plan_to(here, place)


@dataclass
class PaperTasks:
    """Tasks that come in under way, made by whatever a test gives."""

    plans: Callable[[str], Task]
    visits: Callable[[Sequence[MapPoint], str, FieldBounds | None], Task]
    checking_s: float = 0.0

    def read_plan(self, text: str) -> Task:
        return self.plans(text)

    def visit(self, places: Sequence[MapPoint], name: str, bounds: FieldBounds | None) -> Task:
        return self.visits(places, name, bounds)
