"""The mission: what to do next, and an honest account of what was done."""

from __future__ import annotations

import math
from collections.abc import Iterable

import msgspec

from agribot.config import MissionConfig
from agribot.errors import MissionError
from agribot.messages import Estimate, Goal, MissionState, OperatorEvent, Path
from agribot.plan.account import FINAL, account, wish
from agribot.plan.errand import STANDING_MPS, Errand, Errands, goal_errand, home_errand, work_errand
from agribot.plan.job import Job
from agribot.plan.route import Route
from agribot.plan.row_log import RowResult
from agribot.plan.saved_mission import SavedMission, check_not_carried_away
from agribot.plan.task import NewTasks, Task
from agribot.plan.watch import Watch

SETTLE_S = 1.0  # the estimate must hold this long before the robot moves
END_TOLERANCE_M = 0.01
# Heard after the end by a mission that stays open.
AFTER_THE_END = ("goto", "visit", "plan", "stop", "clear_stop")


class Mission:
    """State machine over one path, which it plans itself once the robot knows where it is.

    waiting -> running <-> paused -> done | cancelled | failed. A stop pauses and latches: first
    `clear_stop`, then `resume`, and the work goes on at the same place. Beside its job it drives
    errands: home, or to a place on demand, after which `resume` leads back to the work.
    """

    def __init__(
        self,
        task: Task,
        config: MissionConfig,
        saved: SavedMission | None = None,
        new_tasks: NewTasks | None = None,
    ) -> None:
        """`saved` is a mission that was cut off: it goes on where it was.

        `new_tasks` makes the tasks that an operator or a program sends under way.
        """
        self._job = Job(task, config, saved)
        self._errands = Errands()
        self._config = config
        self._watch = Watch(config)
        self._new_tasks = new_tasks
        self._last: Estimate | None = None
        self._state: MissionState = "waiting"
        self._reason = "waiting for the first estimate"
        self._refusal = ""
        self._ended: tuple[MissionState, str] | None = None
        self._stays_open = config.waits_for_goals
        self._is_stopped = False
        self._ok_since_s: float | None = None
        if config.waits_for_goals:
            self._state, self._reason = "paused", "waits for a goal; resume begins its mission"

    @property
    def path(self) -> Path | None:
        """None until it is planned; that of the errand while there is one."""
        return self._way.path if self._way else None

    @property
    def task(self) -> Task:
        return self._job.task

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
        """All that is needed to go on later; None before a path is planned."""
        return self._job.saved(self._state, self._last) if self._last else None

    def stay_open(self) -> None:
        """From now on a mission that has ended still takes places to drive to and new plans."""
        self._stays_open = True

    def step(self, estimate: Estimate, events: Iterable[OperatorEvent] = ()) -> Goal:
        is_located = estimate.ok and math.isfinite(estimate.x_map_m + estimate.y_map_m)
        self._last = estimate if is_located else self._last
        for event in events:
            self._handle(event)
        if self._errands.asked and is_located and abs(estimate.v_mps) <= STANDING_MPS:
            self._set_off(self._errands.asked, estimate)
        if self._state == "waiting":
            self._wait(estimate, is_located)
        elif self._state == "running" and self._way:
            self._run(self._way, estimate, is_located)
        status = account(self._job, self._errands, self._state, self._reason, self._refusal)
        is_driving = self._state == "running" and is_located
        return wish(self._way, self._job, status, self._watch.caution, is_driving=is_driving)

    def _run(self, route: Route, estimate: Estimate, is_located: bool) -> None:
        if is_located:
            self._reason = ""
            self._advance(route, estimate)
        else:
            self._reason = f"position lost: {estimate.reason or 'not finite'}"
        stalled = self._watch.stalled(route, estimate.t_s, self._reason)
        if stalled and self._state == "running":
            self._end("failed", stalled)

    def _handle(self, event: OperatorEvent) -> None:
        if self._state in FINAL and not (self._stays_open and event.action in AFTER_THE_END):
            return
        if event.action == "cancel":
            self._end("cancelled", f"cancelled by {event.source}")
        elif event.action == "stop":
            self._is_stopped = True
            self._pause(f"stopped by {event.source}; clear the stop, then resume")
        elif event.action == "clear_stop" and self._is_stopped:
            self._is_stopped = False
            self._pause("stop cleared; waiting for resume")
        elif event.action == "set":
            self._set(event)
        elif event.action == "skip_row" and self._errands.route is None:
            self._job.skip_row()
        elif event.action in ("plan", "visit"):
            self._take(event)
        else:
            self._handle_moving(event)

    def _handle_moving(self, event: OperatorEvent) -> None:
        if self._is_stopped:
            if event.action == "goto":
                self._refusal = "goal refused: the robot is stopped; clear the stop first"
        elif event.action == "pause":
            self._pause(f"paused by {event.source}")
        elif event.action == "resume" and self._state == "paused":
            self._resume()
        elif event.action == "return_home":
            self._turn_home(event.source)
        elif event.action == "goto":
            self._turn_to_goal(event)

    def _resume(self) -> None:
        errands, way = self._errands, self._way
        try:
            if errands.is_away and errands.route is None and way is not None:
                errands.ask(work_errand(self._job))
                return
            if way is not None and self._last is not None:
                check_not_carried_away(self._last, way.place, self._config.resume_limit_m)
        except MissionError as error:
            self._reason = f"not resumed: {error}"
            return
        self._run_on("running" if way else "waiting")

    def _turn_home(self, source: str) -> None:
        current = self._errands.current
        if self._last is None or (current is not None and current.to == "home"):
            return
        try:
            errand = home_errand(self._job, source)
            self._errands.begin(errand, self._last, self._config)
        except MissionError as error:
            self._refusal = f"cannot return home: {error}"
        else:
            self._run_on("running")

    def _turn_to_goal(self, event: OperatorEvent) -> None:
        """Stop first: the way there is planned from where the robot comes to rest."""
        try:
            errand = goal_errand(self._job, event)
        except MissionError as error:
            self._refusal = f"goal refused: {error}"
            return
        if self._state in FINAL:
            self._ended = (self._state, self._reason)
        self._state, self._reason = "paused", f"stops for a goal of {event.source}"
        self._refusal = ""
        self._errands.ask(errand)

    def _set_off(self, errand: Errand, estimate: Estimate) -> None:
        try:
            self._errands.begin(errand, estimate, self._config)
        except MissionError as error:
            self._errands.end()
            self._refusal = f"{errand.refusal}: {error}"
            self._pause(self._refusal)
        else:
            self._run_on("running")

    def _run_on(self, state: MissionState) -> None:
        self._state, self._reason, self._refusal = state, "", ""
        self._watch.restart()

    def _take(self, event: OperatorEvent) -> None:
        """Another task from now on, from where the robot stands: a visit at once, a plan later."""
        is_visit = event.action == "visit"
        is_moving = self._last is not None and abs(self._last.v_mps) > STANDING_MPS
        try:
            if self._new_tasks is None:
                raise MissionError("this mission takes no other task")
            if is_moving and not is_visit:
                raise MissionError("the robot drives; pause its mission first")
            task = self._new_tasks.of(event)
        except MissionError as error:
            self._refusal = f"{event.action} refused: {error}"
            return
        self._job, self._errands = Job(task, self._config), Errands()
        self._ended, self._refusal, self._state = None, "", "paused"
        self._pause(f"new {event.action} from {event.source}; resume begins it")
        if is_visit and not self._is_stopped:
            self._run_on("waiting")

    def _set(self, event: OperatorEvent) -> None:
        if event.text != "mission.speed_mps":
            return
        self._config = msgspec.structs.replace(self._config, speed_mps=event.value)
        self._job.change_speed(self._config)
        if self._errands.route is not None:
            self._errands.route.change_speed(self._config)

    def _pause(self, reason: str) -> None:
        """An errand that has not begun is given up; what has ended before one is ended again."""
        self._errands.asked = None
        self._ok_since_s = None
        if self._state in FINAL:
            return
        if self._ended is not None and self._errands.route is None:
            self._end(*self._ended)
        else:
            self._state, self._reason = "paused", reason

    def _wait(self, estimate: Estimate, is_located: bool) -> None:
        if not is_located:
            self._ok_since_s = None
            self._reason = f"waiting for position: {estimate.reason or 'no estimate'}"
            if lost := self._watch.still_lost(estimate.t_s, estimate.reason):
                self._end("failed", lost)
            return
        if self._ok_since_s is None:
            self._ok_since_s = estimate.t_s
        if estimate.t_s - self._ok_since_s >= SETTLE_S:
            self._start(estimate)
        else:
            self._reason = "waiting for the estimate to settle"

    def _start(self, estimate: Estimate) -> None:
        """Plan from here; a refused plan ends it all."""
        try:
            self._job.begin(estimate)
        except MissionError as error:
            self._end("failed", str(error))
        else:
            self._errands.is_away = False
            self._run_on("running")

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
        elif not is_errand and route.is_beside_row and self.task.has_crop:
            self._reason = self._watch.lost_row(route, estimate, self._config)

    def _arrive(self, estimate: Estimate) -> None:
        errand = self._errands.current
        if errand is None:
            self._end(*self._job.finish(estimate.t_s))
            return
        if errand.to == "home":
            self._end("cancelled", f"returned home, called by {errand.source}")
            return
        self._errands.end()
        if errand.to == "work":
            self._job.go_on()
            self._errands.is_away = False
        else:
            self._pause(f"at the goal of {errand.source}; resume goes on with the mission")

    def _end(self, state: MissionState, reason: str) -> None:
        self._state, self._reason = state, reason
