"""A drive beside the work: home, to a place on demand, or back to where the work stopped."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal, NamedTuple

from agribot.autonomy.plan.curves import Place
from agribot.autonomy.plan.job import Job
from agribot.autonomy.plan.route import Route
from agribot.autonomy.plan.saved_mission import SavedErrand
from agribot.core.config import MissionConfig
from agribot.core.errors import MissionError
from agribot.core.messages import Estimate, OperatorEvent, Path

STANDING_MPS = 0.02
BATTERY = "the battery"  # the source of an errand that nobody asked for
CHECKING = "checks the plan"  # the leg while a field plan is judged
STOPPING = "stops first"  # the leg until the robot stands and its errand is planned


class Errand(NamedTuple):
    """Where to, who asked for it, and how to plan it from where the robot stands."""

    to: Literal["home", "goal", "work"]
    source: str
    plan: Callable[[Estimate], Path]
    goal: tuple[float, ...] = ()
    id: str = ""  # of the request that asked for it

    @property
    def leg(self) -> str:
        return {"home": "way home", "goal": "to the goal", "work": "back to the work"}[self.to]

    @property
    def refusal(self) -> str:
        return {
            "home": "cannot return home", "goal": "goal refused", "work": "cannot go back to work",
        }[self.to]  # fmt: skip

    def route(self, estimate: Estimate, config: MissionConfig) -> Route:
        """Raises: MissionError: there is no way that may be driven."""
        return Route(self.plan(estimate), (), config, ())


class Errands:
    """The one errand there may be, and its route once it has begun."""

    def __init__(self) -> None:
        self.asked: Errand | None = None  # it is planned as soon as the robot stands
        self.current: Errand | None = None
        self.route: Route | None = None
        self.is_away = False  # the robot was driven elsewhere since the work stopped
        self.cut_off: Errand | None = None  # of an earlier run: goes on only when it is resumed

    def ask(self, errand: Errand) -> None:
        self.end()
        self.asked = errand

    def begin(self, errand: Errand, route: Route) -> None:
        self.end()
        self.current, self.route, self.is_away = errand, route, True

    def end(self) -> None:
        self.asked = self.current = self.route = self.cut_off = None

    def saved(self) -> SavedErrand | None:
        """Asked for or under way, or still waiting for the answer of an operator."""
        errand = self.asked or self.current or self.cut_off
        return SavedErrand(to=errand.to, source=errand.source, goal=errand.goal) if errand else None

    @property
    def leg(self) -> str:
        return STOPPING if self.asked else self.current.leg if self.current else ""


def home_errand(job: Job, source: str, id: str = "") -> Errand:
    """Raises: MissionError: nobody knows where home is."""
    route, plan_home = job.route, job.task.home
    if route is None or plan_home is None:
        raise MissionError("nothing was planned yet")
    ahead = route.row_ahead if job.task.has_crop else route.path.xy_map_m[:0]
    return Errand("home", source, lambda here: plan_home(here, job.planned_from, ahead), id=id)


def goal_errand(job: Job, event: OperatorEvent) -> Errand:
    """Raises: MissionError: no place, or a task that knows no ways."""
    numbers = event.numbers
    if len(numbers) not in (2, 3) or not all(math.isfinite(number) for number in numbers):
        raise MissionError("a goal is two or three finite numbers: x and y (m, map), yaw (rad)")
    goal: Place = (numbers[0], numbers[1], numbers[2] if len(numbers) == 3 else None)
    plan = job.task.go_to
    if plan is None:
        raise MissionError("this mission drives its own path only")
    return Errand("goal", event.source, lambda here: plan(here, goal), numbers, event.id)


def restored_errand(saved: SavedErrand, job: Job) -> Errand:
    """Raises: MissionError: as those that make it."""
    if saved.to == "home":
        return home_errand(job, saved.source)
    if saved.to == "work":
        return work_errand(job)
    return goal_errand(
        job, OperatorEvent(t_s=0.0, action="goto", source=saved.source, numbers=saved.goal)
    )


def work_errand(job: Job) -> Errand:
    """Raises: MissionError: a task that knows no ways."""
    plan, place = job.task.back, job.place_to_go_on
    if plan is None:
        raise MissionError("this mission drives its own path only")
    return Errand("work", "the mission", lambda here: plan(here, place))
