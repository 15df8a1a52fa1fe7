"""A mission by itself: it waits for a position, plans, drives, arrives and ends."""

from __future__ import annotations

import math
from functools import partial

import msgspec

from agribot.autonomy.plan.account import FINAL, account, wish
from agribot.autonomy.plan.answers import Answers
from agribot.autonomy.plan.errand import (
    BATTERY,
    CHECKING,
    STANDING_MPS,
    Errand,
    Errands,
    restored_errand,
)
from agribot.autonomy.plan.job import Job, Planned
from agribot.autonomy.plan.planning import PlanningAtOnce, PlanningDesk, PlanningHost
from agribot.autonomy.plan.route import Route
from agribot.autonomy.plan.row_log import RowResult
from agribot.autonomy.plan.saved_mission import SavedMission
from agribot.autonomy.plan.task import NewTasks, Task
from agribot.autonomy.plan.watch import Watch
from agribot.core.config import MissionConfig
from agribot.core.errors import MissionError
from agribot.core.latch import Latch
from agribot.core.messages import Estimate, Goal, MissionState, Path

SETTLE_S = 1.0  # the estimate must hold this long before the robot moves
END_TOLERANCE_M = 0.01


class Driving:
    """State machine over one path, which it plans itself once the robot knows where it is.

    waiting -> running <-> paused -> done | cancelled | failed.
    """

    def __init__(
        self,
        task: Task,
        config: MissionConfig,
        saved: SavedMission | None = None,
        new_tasks: NewTasks | None = None,
        planning: PlanningHost | None = None,
        latch: Latch | None = None,
    ) -> None:
        """`saved` is a mission that was cut off: it goes on where it was.

        A mission that was stopped or paused when it was cut off waits for a person again. `latch`
        is shared with whatever else may stop the robot.

        `new_tasks` makes the tasks that an operator or a program sends under way. `planning`
        works out long ways beside the loop; without it, they are worked out at once.
        """
        self._desk = PlanningDesk(planning or PlanningAtOnce())
        if saved is not None and saved.visit_name and new_tasks is not None:
            visit = new_tasks.of_places(saved.visit, saved.visit_name)
            task = visit._replace(bounds=task.bounds)
        self._job = Job(task, config, saved)
        self._errands = Errands()
        self._saved = saved
        self._cut_off = saved if saved is not None and saved.asks_first else None
        self._config = config
        self._watch = Watch(config)
        self._new_tasks = new_tasks
        self._last: Estimate | None = None
        self._is_located = False
        self._state: MissionState = "waiting"
        self._reason = "waiting for the first estimate"
        self._refusal = ""
        self._answers = Answers()
        self._ended: tuple[MissionState, str] | None = None
        self._stays_open = config.waits_for_goals
        self._latch = Latch() if latch is None else latch
        self._is_stopped = self._is_checking = False
        self._warning = ""
        self._is_heeded = False  # the warning sent it home, or stopped it
        self._paused = ""  # why it stood still when it ended, if it did not drive
        self._held = ""  # why it paused by itself
        self._is_resumed = False  # somebody bade the work begin, and is there to hear a refusal
        self._ok_since_s: float | None = None
        self._take_up(saved)

    def _take_up(self, saved: SavedMission | None) -> None:
        """Stand as the mission that was cut off stood, or until there is a goal."""
        if saved is not None and saved.stopped:
            self._latch.hold(saved.stopped)
        if self._cut_off is not None and self._cut_off.planned_from is None:
            self._wait_for_an_answer(self._cut_off)
        elif saved is not None and self._cut_off is None and (saved.stopped or saved.paused):
            why = saved.stopped or saved.paused
            self._pause(f"was cut off: {why}; resume goes on with it")
            self._paused = why  # in its own words, however often the run is cut off
        elif self._config.waits_for_goals and self._cut_off is None:
            self._state, self._reason = "paused", "waits for a goal; resume begins its mission"

    @property
    def path(self) -> Path | None:
        """None until it is planned; that of the errand while there is one."""
        return self._way.path if self._way else None

    @property
    def task(self) -> Task:
        return self._job.task

    @property
    def speed_mps(self) -> float:
        """Along a path; changed under way, it is the new one."""
        return self._config.speed_mps

    @property
    def _way(self) -> Route | None:
        return self._errands.route or self._job.route

    @property
    def row_results(self) -> tuple[RowResult, ...]:
        return self._job.rows.results

    @property
    def waypoints_reached(self) -> tuple[bool, ...]:
        return self._job.waypoints_reached

    def saved(self) -> SavedMission | None:
        """All that is needed to go on later; None before there is anything to go on with."""
        errand, errands = self._errands.saved(), self._errands
        held = {"stopped": self._latch.reason, "paused": self._paused}
        if self._last is None or not (self._job.route or errand or errands.is_away):
            return msgspec.structs.replace(self._saved, **held) if self._saved else None
        saved = self._job.saved(self._state, self._last)
        return msgspec.structs.replace(
            saved,
            errand=errand,
            is_away=errands.is_away,
            **held,
        )

    def stay_open(self) -> None:
        """From now on a mission that has ended still takes places to drive to and new plans."""
        self._stays_open = True

    def _locate(self, estimate: Estimate) -> None:
        self._is_located = estimate.ok and math.isfinite(estimate.x_map_m + estimate.y_map_m)
        self._last = estimate if self._is_located else self._last

    def _go_on(self, estimate: Estimate) -> Goal:
        is_located = self._is_located
        self._desk.look(estimate.t_s)
        asked, stands = self._errands.asked, abs(estimate.v_mps) <= STANDING_MPS
        if asked and is_located and stands and not self._desk.is_busy:
            self._set_off(asked, estimate)
        if self._state == "waiting":
            self._wait(estimate, is_located)
        elif self._state == "running" and self._way:
            self._run(self._way, estimate, is_located)
        status = account(
            self._job, self._errands, self._state, self._reason, self._refusal,
            stopped=self._latch.reason, held=self._held, warning=self._warning,
            answers=self._answers.take(self._errands.asked),
        )  # fmt: skip
        if self._is_checking:
            status = msgspec.structs.replace(status, leg=CHECKING)
        is_driving = self._state == "running" and is_located
        goal = wish(self._way, self._job, status, self._watch.caution, is_driving=is_driving)
        may_work = self._watch.may_work
        return goal if may_work else msgspec.structs.replace(goal, tool_on=False)

    def _run(self, route: Route, estimate: Estimate, is_located: bool) -> None:
        if estimate.contradiction:
            self._hold(estimate.contradiction)
            return
        if is_located:
            self._reason = ""
            self._advance(route, estimate)
        else:
            self._reason = f"position lost: {estimate.reason or 'not finite'}"
        stalled = self._watch.stalled(route, estimate.t_s, self._reason)
        if stalled and self._state == "running":
            if self._watch.is_guarding:
                self._hold(stalled)
            else:
                self._end("failed", stalled)

    def _set_off(self, errand: Errand, estimate: Estimate) -> None:
        """Plan the way of an errand from here; the robot stands until it is there."""
        config = self._config

        def leave(route: Route) -> None:
            self._errands.begin(errand, route)
            self._answers.settle_errand(errand)
            self._run_on("running")

        def stay(error: MissionError) -> None:
            self._errands.end()
            why = f"{errand.refusal}: {error}"
            self._answers.settle_errand(errand, why)
            if errand.source == BATTERY:  # nobody asked for it, and may not be there to resume
                self._hold("; ".join(filter(None, (self._warning, why))))
            else:
                self._pause(why)
            self._refusal = why

        latency_s = self.task.errand_planning_s
        work = partial(errand.route, estimate, config)
        self._desk.ask(estimate.t_s, work, latency_s, leave, stay)

    def _drop(self) -> None:
        """What is being worked out is not wanted any more."""
        self._answers.drop_task()
        if self._desk.drop() and self._is_checking:
            self._refusal = "plan refused: something else was asked of the robot meanwhile"
        self._is_checking = False

    def _run_on(self, state: MissionState) -> None:
        self._drop()
        self._state, self._reason, self._refusal = state, "", ""
        self._paused = self._held = ""
        self._watch.restart()

    def _hold(self, reason: str) -> None:
        """Pause without having been asked: a person has to look, and to resume it."""
        self._pause(reason)
        self._held = self._paused

    def _pause(self, reason: str) -> None:
        """An errand that has not begun is given up; what has ended before one is ended again."""
        self._drop()
        self._held = ""
        self._errands.asked = None
        self._ok_since_s = None
        if self._state in FINAL:
            return
        if self._ended is not None and self._errands.route is None:
            self._end(*self._ended)
        else:
            self._state, self._reason, self._paused = "paused", reason, reason

    def _heed_stop(self) -> None:
        """Stand still while the latch holds, whoever closed it."""
        if self._latch.reason and not self._is_stopped:
            self._pause(f"{self._latch.reason}; clear the stop, then resume")
        elif self._is_stopped and not self._latch.reason:
            self._pause("stop cleared; waiting for resume")
        self._is_stopped = bool(self._latch.reason)

    def _wait(self, estimate: Estimate, is_located: bool) -> None:
        if not is_located:
            self._ok_since_s = None
            self._reason = f"waiting for position: {estimate.reason or 'no estimate'}"
            if lost := self._watch.still_lost(estimate.t_s, estimate.reason):
                self._end("failed", lost)
            return
        if self._ok_since_s is None:
            self._ok_since_s = estimate.t_s
        if self._desk.is_busy:
            self._reason = "planning the way"
        elif estimate.t_s - self._ok_since_s >= SETTLE_S:
            self._start(estimate)
        else:
            self._reason = "waiting for the estimate to settle"

    def _start(self, estimate: Estimate) -> None:
        """Plan from here. A refused plan ends a mission that begins by itself, and a visit.

        Whoever resumes a mission can drive the robot to a better place and resume it again.
        """
        job = self._job

        def begin(planned: Planned) -> None:
            job.begin(planned)
            self._errands.is_away = False
            if self._cut_off is None:
                self._run_on("running")
            else:
                self._wait_for_an_answer(self._cut_off)

        def fail(error: MissionError) -> None:
            if self._is_resumed and not job.task.name:
                self._pause(f"not resumed: {error}")
                self._refusal = f"not resumed: {error}"
            else:
                self._end("failed", str(error))

        work = partial(job.plan, estimate)
        self._desk.ask(estimate.t_s, work, self.task.planning_s, begin, fail)

    def _wait_for_an_answer(self, saved: SavedMission) -> None:
        """What an operator sent the robot to goes on only when an operator says so."""
        errands, what = self._errands, f"its visit '{saved.visit_name}'"
        errands.is_away, self._cut_off = saved.is_away, None
        if saved.is_away:
            what = "away from its work"
        if saved.errand is not None:
            errands.cut_off = restored_errand(saved.errand, self._job)
            what = f"{errands.cut_off.leg}, as {saved.errand.source} asked"
        self._state, self._reason = "paused", f"was cut off: {what}; resume goes on with it"

    def _advance(self, route: Route, estimate: Estimate) -> None:
        self._watch.caution = 1.0
        route.progress.advance(estimate.x_map_m, estimate.y_map_m)
        if strayed := self._watch.strayed(route, estimate, self._config.off_path_limit_m):
            self._end("failed", strayed)
            return
        is_errand = self._errands.route is not None
        if not is_errand:
            self._job.work(estimate)
        if route.progress.s_m >= route.progress.length_m - END_TOLERANCE_M:
            self._arrive(estimate)
            return
        if not is_errand and route.is_beside_row and self.task.has_crop:
            self._reason = self._watch.lost_row(route, estimate, self._config)
        rows = self.task.rows if self.task.has_crop else ()
        astray = self._watch.astray(route, estimate, rows, self.task.clearance_m)
        self._reason = self._reason or astray

    def _arrive(self, estimate: Estimate) -> None:
        errand = self._errands.current
        if errand is None:
            self._end(*self._job.finish(estimate.t_s))
            return
        if errand.to == "home":
            called = f"returned home, called by {errand.source}"
            self._end(*(self._ended or ("cancelled", called)))
            return
        self._errands.end()
        if errand.to == "work":
            self._job.go_on()
            self._errands.is_away = False
        else:
            self._pause(f"at the goal of {errand.source}; resume goes on with the mission")

    def _end(self, state: MissionState, reason: str) -> None:
        self._drop()
        self._state, self._reason = state, reason
        self._paused = self._held = ""
