"""The mission: it waits for a position, plans, drives, arrives and ends, and takes requests."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, Literal

import msgspec

from agribot.autonomy.plan.mission.answers import Answers
from agribot.autonomy.plan.mission.errand import (
    BATTERY,
    CHECKING,
    STANDING_MPS,
    Errand,
    make_back_errand,
    make_free_errand,
    make_goal_errand,
    make_home_errand,
    make_work_errand,
    restore_errand,
    save_errand,
)
from agribot.autonomy.plan.mission.errand_kind import ErrandKind
from agribot.autonomy.plan.mission.job import Ending, MissionJob
from agribot.autonomy.plan.mission.job_start import list_rows, plan_job, save_unbegun
from agribot.autonomy.plan.mission.planning import PlanningAtOnce, PlanningDesk, PlanningHost
from agribot.autonomy.plan.mission.requests import Do, Refuse, react
from agribot.autonomy.plan.mission.route import Route
from agribot.autonomy.plan.mission.row_log import RowResult
from agribot.autonomy.plan.mission.row_recovery import RowRecovery
from agribot.autonomy.plan.mission.saved_mission import SavedMission, check_not_carried_away
from agribot.autonomy.plan.mission.states import (
    Driving,
    Ended,
    OnErrand,
    Paused,
    State,
    Stopping,
    Waiting,
    find_away,
    find_errand,
    find_stood,
    name_state,
)
from agribot.autonomy.plan.mission.status import describe, find_way, make_goal
from agribot.autonomy.plan.mission.task import NewTasks, Task
from agribot.autonomy.plan.mission.watch import Watch
from agribot.autonomy.plan.ways.freeing import Freeing
from agribot.autonomy.plan.ways.speed import limit_speeds
from agribot.core.config import MissionConfig
from agribot.core.errors import MissionError
from agribot.core.fact_text import render
from agribot.core.facts import (
    AnyFact,
    AskedElse,
    AtGoal,
    AwayFromRows,
    AwayFromWork,
    Both,
    CameToBeCharged,
    CancelledBy,
    CutOff,
    ErrandRefused,
    EstimateNotReady,
    Fact,
    FirstEstimateAwaited,
    FoundRowAside,
    GoalAwaited,
    InNoRow,
    NewTask,
    NoHeadway,
    NoOtherTask,
    NoPlaces,
    NothingPlanned,
    NotResumed,
    ObstacleStays,
    OnErrandOf,
    OnVisit,
    PausedBy,
    PlanningWay,
    PositionAwaited,
    PositionLost,
    ResumeAwaited,
    ReturnedHome,
    RobotDrives,
    RowNotMoved,
    RowNotSkipped,
    Settling,
    SpeedRefused,
    StopsForGoal,
    StopsToBackOut,
    StopsToReturn,
    StopToResume,
    TaskRefused,
)
from agribot.core.latch import Latch
from agribot.core.messages import (
    ChangeSetting,
    ControlMission,
    Estimate,
    Goal,
    GoTo,
    MapPoint,
    Path,
    PauseFor,
    RequestEvent,
    TakePlan,
    Visit,
)
from agribot.core.refusal import find_fact

SETTLE_S = 1.0  # time for which the estimate must hold before the robot moves
END_TOLERANCE_M = 0.01
# Pause before it backs out: wheels that spun stand, and a tool is out of the soil.
BACK_OUT_PAUSE_S = 1.0
NUDGE_M = 0.01  # step of a row's line
Handler = Callable[[Any, RequestEvent], AnyFact | None]  # gives why a request is refused


class Mission:
    """Works at a task along a route that it plans itself once the robot knows where it is.

    `requests.TABLE` says what it does with a request in each of its states. A stop pauses it and
    latches: first `clear_stop`, then `resume`, and the work goes on at the same place. Beside its
    job it drives errands: home, or to a place on demand, after which `resume` leads back.
    """

    def __init__(
        self,
        task: Task,
        config: MissionConfig,
        saved: SavedMission | None = None,
        new_tasks: NewTasks | None = None,
        planning: PlanningHost | None = None,
        latch: Latch | None = None,
        most_mps: float = math.inf,
    ) -> None:
        """Begin anew, or go on where `saved`, a mission that was cut off, was.

        A mission that was stopped or paused when it was cut off waits for a person again. `latch`
        is shared with whatever else may stop the robot.

        `new_tasks` makes the tasks that an operator or a program sends under way. `planning`
        works out long ways beside the loop; without it, they are worked out at once. No way is
        planned faster than `most_mps`.
        """
        if saved is not None and saved.visit_name and new_tasks is not None:
            task = new_tasks.visit(saved.visit, saved.visit_name, task.bounds)
        self._task, self._config, self._most_mps = task, limit_speeds(config, most_mps), most_mps
        self._job: MissionJob | None = None  # None until its route is planned
        self._begun = saved if saved is not None and saved.planned_from is not None else None
        self._saved = saved
        self._desk = PlanningDesk(planning or PlanningAtOnce())
        self._watch, self._recovery = Watch(config), RowRecovery()
        self._freeing = Freeing()
        self._stuck: Fact | None = None
        self._in_way: Fact | None = None
        self._new_tasks = new_tasks
        self._last: Estimate | None = None
        self._is_located = False
        self._refusal: AnyFact | None = None
        self._answers = Answers()
        self._ended: Ended | None = None  # as which it had, before it was sent on an errand
        self._stays_open = config.waits_for_goals
        self._latch = Latch() if latch is None else latch
        self._has_stood_for_stop = False  # the latch holds, and the mission has paused for it
        self._warning: Fact | None = None
        self._is_warning_obeyed = False  # the warning sent it home, or stopped it
        self._is_resumed = False  # somebody bade the work begin, and is there to read a refusal
        self._is_away = False  # the robot was driven elsewhere since the work stopped
        self._state: State = Waiting(FirstEstimateAwaited())
        self._handlers = self._list_handlers()
        self._take_up(saved)

    @property
    def state(self) -> State:
        return self._state

    @property
    def path(self) -> Path | None:
        """Path of the mission, or of the errand while there is one; None until it is planned."""
        way = self._way
        return way.path if way else None

    @property
    def task(self) -> Task:
        return self._task

    @property
    def speed_mps(self) -> float:
        """Along a path; changed under way, it is the new one."""
        return self._config.speed_mps

    @property
    def row_results(self) -> tuple[RowResult, ...]:
        return self._job.rows.results if self._job else list_rows(self._task)

    @property
    def waypoints_reached(self) -> tuple[bool, ...]:
        return self._job.waypoints_reached if self._job else (False,) * len(self._task.waypoints)

    @property
    def _way(self) -> Route | None:
        return find_way(self._state, self._job)

    def snapshot(self) -> SavedMission | None:
        """Take down all that is needed to go on later; None before there is anything."""
        errand, last = find_errand(self._state), self._last
        stopped, paused = self._latch.cause, find_stood(self._state)
        kept = {
            "stopped": render(stopped), "paused": render(paused),
            "stopped_fact": stopped, "paused_fact": paused,
        }  # fmt: skip
        if last is None or not (self._job or errand or self._is_away):
            return msgspec.structs.replace(self._saved, **kept) if self._saved else None
        name = name_state(self._state)
        saved = self._job.save(name, last) if self._job else save_unbegun(self._task, name, last)
        return msgspec.structs.replace(
            saved, errand=save_errand(errand), is_away=self._is_away, **kept
        )

    def stay_open(self) -> None:
        """Take the requests of the column "open" from now on, also after the end."""
        self._stays_open = True

    def obey_warning(self, warning: Fact | None) -> None:
        """Go home for a warning once the robot drives; without a known way home, stand still.

        A warning counts once: the operator who then resumes the mission decides.
        """
        self._warning = warning
        self._is_warning_obeyed = self._is_warning_obeyed and warning is not None
        drives = isinstance(self._state, Driving | OnErrand | Waiting) and not self._latch.cause
        if warning is None or self._is_warning_obeyed or not drives:
            return
        self._is_warning_obeyed = True
        self._refusal = None
        if refusal := self._turn_home(BATTERY, ErrandKind.CHARGE):
            self._pause(Both(warning, refusal), by_itself=True)

    def free(self, stuck: Fact | None) -> None:
        """Back out and try again where the robot is stuck, as the gate says; None: it gets on.

        Where it cannot, or has tried often enough, the gate stops it for a person.
        """
        is_new, self._stuck = self._stuck is None, stuck
        state, last = self._state, self._last
        if (
            stuck is None
            or not is_new
            or last is None
            or not self._frees_itself
            or isinstance(state, Stopping)
        ):
            return
        back_m = self._freeing.begin(last)
        if isinstance(state, OnErrand):
            self._try_again(state)  # held on its way back, it tries forwards
            return
        errand = make_free_errand(self._freeing.trail, back_m)
        self._stop_for(errand, StopsToBackOut(stuck, "free"))

    def wait_for(self, in_way: Fact | None) -> None:
        """Wait for a person or thing in the way, as the gate says; None: the way is free."""
        self._in_way = in_way

    @property
    def _frees_itself(self) -> bool:
        """Whether it backs out and tries again where the robot is stuck now, or does so already."""
        state, tries = self._state, self._config.free_tries
        if isinstance(state, Driving):
            return self._freeing.may_try(tries)
        if not (isinstance(state, OnErrand | Stopping) and state.errand.kind is ErrandKind.FREE):
            return False
        return isinstance(state, Stopping) or self._freeing.has_tries(tries)

    def _try_again(self, state: OnErrand) -> None:
        """Drive on along the route from as far back as the robot has backed out."""
        if self._job is None:
            return
        self._job.step_back(state.route.progress.s_m)
        self._is_away = False
        self._watch.restart_headway()
        self._state = Driving(self._job)

    def step(self, estimate: Estimate, events: Iterable[RequestEvent] = ()) -> Goal:
        """Take the requests of this tick, then drive on; return what the robot is to do now."""
        self._is_located = estimate.ok and math.isfinite(estimate.x_map_m + estimate.y_map_m)
        self._last = estimate if self._is_located else self._last
        self._obey_latch()
        for event in events:
            self._hear(event)
        self._desk.look(estimate.t_s)
        if isinstance(self._state, Stopping):
            self._set_off(self._state, estimate)
        if isinstance(self._state, Waiting):
            self._wait(self._state, estimate)
        elif isinstance(self._state, Driving | OnErrand):
            self._drive(self._state, estimate)
        return self._make_goal()

    def _make_goal(self) -> Goal:
        status = describe(
            self._task, self._job, self._state, self._refusal,
            stopped=self._latch.cause, warning=self._warning,
        )  # fmt: skip
        if self._desk.is_checking:
            status = msgspec.structs.replace(status, leg=CHECKING)
        if answers := self._answers.take(self._state):
            status = msgspec.structs.replace(status, answers=answers)
        is_driving = isinstance(self._state, Driving | OnErrand) and self._is_located
        goal = make_goal(
            self._way, self._task, self._job, status, self._watch.caution,
            is_driving=is_driving, frees_itself=self._frees_itself,
        )  # fmt: skip
        return goal if self._watch.may_work else msgspec.structs.replace(goal, tool_on=False)

    def _hear(self, event: RequestEvent) -> None:
        """Do what is asked and answer it, at once or when it shows what becomes of it."""
        self._answers.open(event.request)
        self._answers.close(self._obey(event))

    def _obey(self, event: RequestEvent) -> AnyFact | None:
        """Find why it is refused; None where it is done, left alone or to be seen."""
        reaction = react(
            event.request.word,
            self._state,
            is_stopped=self._latch.cause is not None,
            stays_open=self._stays_open,
        )
        if isinstance(reaction, Refuse):
            return self._refuse(reaction.why)
        if isinstance(reaction, Do):
            return self._handlers[reaction](event.request, event)
        return None

    def _refuse(self, why: AnyFact) -> AnyFact:
        self._refusal = why
        return why

    def _list_handlers(self) -> dict[Do, Handler]:
        return {
            Do.HOLD: self._turn_latch,
            Do.RELEASE: self._turn_latch,
            Do.PAUSE: self._pause_as_asked,
            Do.RESUME: lambda *_: self._resume(),
            Do.BEGIN_ANEW: lambda *_: self._begin_anew(),
            Do.CANCEL: self._cancel,
            Do.SKIP_ROW: lambda *_: self._skip_row(),
            Do.NUDGE_LEFT: lambda *_: self._nudge(NUDGE_M),
            Do.NUDGE_RIGHT: lambda *_: self._nudge(-NUDGE_M),
            Do.TURN_HOME: lambda _, event: self._turn_home(event.who.name, ErrandKind.HOME),
            Do.TURN_TO_GOAL: self._turn_to_goal,
            Do.TAKE_PLAN: self._take_plan,
            Do.TAKE_VISIT: self._take_visit,
            Do.SET: self._set,
        }

    def _pause_as_asked(self, request: ControlMission | PauseFor, event: RequestEvent) -> None:
        asked = PausedBy(event.who.name)
        self._pause(request.cause if isinstance(request, PauseFor) else asked)

    def _turn_latch(self, _request: Any, event: RequestEvent) -> None:
        self._latch.hear(event)
        self._obey_latch()

    def _obey_latch(self) -> None:
        """Stand still while the latch holds, whatever closed it."""
        cause, holds = self._latch.cause, self._latch.cause is not None
        if cause is not None and not self._has_stood_for_stop:
            self._pause(StopToResume(cause))
        elif self._has_stood_for_stop and not holds:
            self._pause(ResumeAwaited())
        self._has_stood_for_stop = holds

    def _cancel(self, _request: ControlMission, event: RequestEvent) -> None:
        """End; a run that goes on with this one stands as this one stood, and has its errand."""
        self._end(
            "cancelled",
            CancelledBy(event.who.name),
            stood=find_stood(self._state),
            errand=find_errand(self._state),
        )

    def _skip_row(self) -> AnyFact | None:
        if find_away(self._state):
            return self._refuse(RowNotSkipped(AwayFromRows()))
        if self._job is None:
            return self._refuse(RowNotSkipped(NothingPlanned()))
        self._job.skip_row()
        return None

    def _nudge(self, left_m: float) -> AnyFact | None:
        if self._job is None or find_away(self._state):
            return self._refuse(RowNotMoved(InNoRow()))
        why = self._job.nudge(left_m)
        return self._refuse(RowNotMoved(why)) if why else None

    def relate_to_path(self, estimate: Estimate) -> Estimate:
        """Return the pose in a map whose rows lie where the robot is to drive them.

        They may stand beside their map, and a person may have moved the one under the robot. One
        that was stuck tries again a little beside its path.
        """
        on_rows = estimate.relate_to_rows()
        if self._job is None or find_away(self._state):
            return on_rows
        on_path = self._job.relate_to_nudged(on_rows)
        return on_path.relate_to_aside(self._job.route.yaw_map_rad, self._freeing.left_m)

    def _resume(self) -> AnyFact | None:
        state = self._state
        if not isinstance(state, Paused):
            return None
        try:
            if errand := self._find_errand_to_resume(state):
                self._drop()
                self._answers.await_errand(errand)
                self._state = Stopping(errand, state.reason, state.stood, state.held)
                return None
            if self._way is not None and self._last is not None:
                limit_m = self._config.resume_limit_m
                check_not_carried_away(self._last, self._way.place, limit_m)
        except MissionError as error:
            reason = NotResumed(find_fact(error))
            self._state = msgspec.structs.replace(state, reason=reason)
            return self._refuse(reason)
        self._is_resumed = True
        self._recovery.restart()
        self._freeing.restart()
        if state.away:
            self._run_on(OnErrand(state.away.errand, state.away.route))
        else:
            self._run_on(Driving(self._job) if self._job else Waiting())
        return None

    def _find_errand_to_resume(self, state: Paused) -> Errand | None:
        """Find that of an earlier run, or the way back to where the work stopped.

        Raises: MissionError: there is no way back.
        """
        if state.cut_off:
            return state.cut_off
        if self._is_away and not state.away and self._job:
            self._drop()
            return make_work_errand(self._task, self._job)
        return None

    def _begin_anew(self) -> None:
        """Begin the whole task once more, planned from where the robot stands."""
        self._take_task(self._task)
        self._is_resumed = True
        self._run_on(Waiting())

    def _turn_home(
        self, asked_by: str, kind: Literal[ErrandKind.HOME, ErrandKind.CHARGE]
    ) -> AnyFact | None:
        state = self._state
        errand = state.errand if isinstance(state, OnErrand | Stopping) else None
        if errand is not None and errand.kind.leads_home:
            return None
        try:
            errand = make_home_errand(self._task, self._job, asked_by, kind)
        except MissionError as error:
            return self._refuse(ErrandRefused("home", find_fact(error)))
        self._stop_for(errand, StopsToReturn(asked_by))
        return None

    def _turn_to_goal(self, goal: GoTo, event: RequestEvent) -> AnyFact | None:
        try:
            errand = make_goal_errand(self._task, event.who.name, goal.place)
        except MissionError as error:
            return self._refuse(ErrandRefused("goal", find_fact(error)))
        self._stop_for(errand, StopsForGoal(event.who.name))
        return None

    def _stop_for(self, errand: Errand, reason: Fact) -> None:
        """Stop; the way is planned from where the robot comes to rest."""
        state = self._state
        self._ended = state if isinstance(state, Ended) else self._ended
        self._drop()
        self._refusal = None
        self._answers.await_errand(errand)
        held = state.held if isinstance(state, Stopping | Paused) else None
        self._state = Stopping(errand, reason, find_stood(state), held)

    def _take_plan(self, plan: TakePlan, event: RequestEvent) -> AnyFact | None:
        """Take another task for a robot that stands, once it is checked and resumed."""
        new_tasks, last = self._new_tasks, self._last
        if new_tasks is None:
            return self._refuse(TaskRefused("plan", NoOtherTask()))
        if last and abs(last.v_mps) > STANDING_MPS:
            return self._refuse(TaskRefused("plan", RobotDrives()))
        make = partial(new_tasks.read_plan, plan.geojson)
        self._take(event, make, new_tasks.checking_s)
        return None

    def _take_visit(self, visit: Visit, event: RequestEvent) -> AnyFact | None:
        """Take another task at once, from where the robot is."""
        new_tasks, name, bounds = self._new_tasks, visit.title or "visit", self._task.bounds
        if new_tasks is None:
            return self._refuse(TaskRefused("visit", NoOtherTask()))
        self._take(event, lambda: new_tasks.visit(_read_places(visit), name, bounds), 0.0)
        return None

    def _take(self, event: RequestEvent, make: Callable[[], Task], latency_s: float) -> None:
        def refuse(error: MissionError) -> None:
            task: Literal["plan", "visit"] = "plan" if is_check else "visit"
            self._answers.settle_check(self._refuse(TaskRefused(task, find_fact(error))))

        self._drop()
        self._answers.await_check()
        then, is_check = partial(self._work_at, event), isinstance(event.request, TakePlan)
        self._desk.ask(event.t_s, make, latency_s, then, refuse, is_check=is_check)

    def _work_at(self, event: RequestEvent, task: Task) -> None:
        self._answers.settle_check()
        self._take_task(task)
        self._refusal = None
        reason = NewTask(event.request.word, event.who.name)
        self._state = Paused(reason, stood=reason)
        if isinstance(event.request, Visit) and self._latch.cause is None:
            self._run_on(Waiting())

    def _take_task(self, task: Task) -> None:
        """Take a task; whatever was done and asked before is over."""
        self._task, self._job, self._begun = task, None, None
        self._ended, self._is_away = None, False

    def _set(self, change: ChangeSetting, _event: RequestEvent) -> AnyFact | None:
        """Take a new speed: it counts at once, also for the time that is left."""
        if change.setting != "mission.speed_mps":
            return None
        if change.value > self._most_mps:
            return self._refuse(SpeedRefused(change.value, self._most_mps))
        self._config = msgspec.structs.replace(self._config, speed_mps=change.value)
        if self._job:
            self._job.change_speed(self._config)
        if away := find_away(self._state):
            away.route.change_speed(self._config)
        return None

    def _take_up(self, saved: SavedMission | None) -> None:
        """Stand as the mission that was cut off stood, or until there is a goal."""
        why = None if saved is None else saved.stop or saved.pause
        if saved is not None and saved.stop:
            self._latch.hold(saved.stop)
        if saved is not None and saved.asks_first:
            if saved.planned_from is None:
                self._wait_for_an_answer(saved)
        elif why is not None:
            # the cause is its own, however often the run is cut off
            self._state = Paused(CutOff(why), stood=why)
        elif self._config.waits_for_goals:
            self._state = Paused(GoalAwaited())

    def _wait_for_an_answer(self, saved: SavedMission) -> None:
        """Wait: what an operator sent the robot to goes on only when an operator says so."""
        self._is_away, cut_off = saved.is_away, None
        what: Fact = AwayFromWork() if saved.is_away else OnVisit(saved.visit_name)
        if saved.errand is not None:
            cut_off = restore_errand(saved.errand, self._task, self._job)
            what = OnErrandOf(cut_off.kind.value, saved.errand.source)
        self._state = Paused(CutOff(what), cut_off=cut_off)

    def _wait(self, state: Waiting, estimate: Estimate) -> None:
        if lack := self._find_lack(estimate):
            self._state = Waiting(PositionAwaited(lack))
            if lost := self._watch.check_position(estimate.t_s, lack):
                self._end("failed", lost)
            return
        steady_since_s = state.steady_since_s
        steady_since_s = estimate.t_s if steady_since_s is None else steady_since_s
        if self._desk.is_busy:
            self._state = Waiting(PlanningWay(), steady_since_s)
        elif estimate.t_s - steady_since_s < SETTLE_S:
            self._state = Waiting(Settling(), steady_since_s)
        else:
            self._state = Waiting(state.reason, steady_since_s)
            self._begin(estimate)

    def _find_lack(self, estimate: Estimate) -> Fact | None:
        """Find what the pose lacks for this task; None where it may begin."""
        if not self._is_located:
            return estimate.fact or EstimateNotReady()
        rows = self._task.rows if self._task.has_crop else ()
        return self._watch.check_start(rows, estimate, self._config)

    def _begin(self, estimate: Estimate) -> None:
        """Plan from here. A refused plan ends a mission that begins by itself, and a visit.

        The operator who resumes a mission can drive the robot to a better place and resume it
        again.
        """

        def begin(job: MissionJob) -> None:
            self._job, self._is_away = job, False
            job.change_speed(self._config)
            if self._begun is not None and self._begun.asks_first:
                self._wait_for_an_answer(self._begun)
            else:
                self._run_on(Driving(job))

        def fail(error: MissionError) -> None:
            if self._is_resumed and not self._task.name:
                reason = NotResumed(find_fact(error))
                self._pause(reason)
                self._refusal = reason
            else:
                self._end("failed", find_fact(error))

        work = partial(plan_job, self._task, self._config, estimate, self._begun)
        self._desk.ask(estimate.t_s, work, self._task.planning_s, begin, fail)

    def _set_off(self, state: Stopping, estimate: Estimate) -> None:
        """Plan the way of an errand from here; the robot stands until it is there."""
        stands = abs(estimate.v_mps) <= STANDING_MPS
        if not (self._is_located and stands) or self._desk.is_busy:
            return
        errand = state.errand

        def leave(route: Route) -> None:
            route.change_speed(self._config)
            self._is_away = True
            self._answers.settle_errand()
            self._run_on(OnErrand(errand, route))

        def stay(error: MissionError) -> None:
            why = ErrandRefused(errand.kind.value, find_fact(error))
            if errand.kind is ErrandKind.FREE:
                self._pause(Both(state.reason, why), by_itself=True)
            elif errand.kind is ErrandKind.CHARGE or errand.kind.leaves_row:
                # no operator asked for it, and none may be there to resume
                warning = self._warning
                self._pause(Both(warning, why) if warning else why, by_itself=True)
            else:
                self._pause(why)
            self._answers.settle_errand(self._refuse(why))

        latency_s = self._task.errand_planning_s
        if errand.kind is ErrandKind.FREE:
            latency_s = max(latency_s, BACK_OUT_PAUSE_S)
        work = partial(errand.plan_route, estimate, self._config)
        self._desk.ask(estimate.t_s, work, latency_s, leave, stay)

    def _drive(self, state: Driving | OnErrand, estimate: Estimate) -> None:
        if estimate.contradiction_fact is not None:
            self._pause(estimate.contradiction_fact, by_itself=True)
            return
        if isinstance(state, Driving) and not self._lead_on(state.job):
            return
        route = state.job.route if isinstance(state, Driving) else state.route
        if self._is_located:
            reason = self._advance(state, route, estimate)
        else:
            reason = PositionLost(estimate.fact)
        if self._state is not state:
            return
        self._state = state = msgspec.structs.replace(state, reason=reason)
        if isinstance(state, Driving) and self._is_located:
            self._freeing.follow(estimate)
            self._recover(state, estimate)
        if self._state is not state:
            return
        if stalled := self._watch.check_headway(route, estimate.t_s, reason):
            self._stall(state, stalled)

    def _stall(self, state: Driving | OnErrand, stalled: NoHeadway) -> None:
        """Wait for a person where something is in the way or crop may be; else end."""
        if self._in_way is not None:
            self._pause(ObstacleStays(stalled.limit_s, self._in_way), by_itself=True)
        elif self._watch.is_guarding:
            if isinstance(state, Driving):
                state.job.give_up_row()
            self._pause(stalled, by_itself=True)
        else:
            self._end("failed", stalled)

    def _lead_on(self, job: MissionJob) -> bool:
        """Take the way on where the task finds it while driving; False: there is no way."""
        try:
            job.lead_on()
        except MissionError as error:
            self._end("failed", find_fact(error))
            return False
        return True

    def _recover(self, state: Driving, estimate: Estimate) -> None:
        """Take the next step of the ladder where the row is lost."""
        if not self._task.has_crop:
            return
        watch, route = self._watch, state.job.route
        is_held = watch.caution == 0.0
        step = self._recovery.judge(route, estimate, is_held=is_held, is_lost=watch.is_row_lost)
        if step is not None:
            errand = make_back_errand(state.job, *step)
            reason = state.reason or FoundRowAside()
            leg: Literal["out", "back"] = "out" if step[0] is ErrandKind.OUT else "back"
            self._stop_for(errand, StopsToBackOut(reason, leg))

    def _advance(self, state: Driving | OnErrand, route: Route, estimate: Estimate) -> Fact | None:
        """Move on and find why the robot is held back there; None where nothing is wrong."""
        self._watch.caution = 1.0
        route.progress.advance(estimate.x_map_m, estimate.y_map_m)
        if strayed := self._watch.check_path(route, estimate, self._config.off_path_limit_m):
            self._end("failed", strayed)
            return None
        if isinstance(state, Driving):
            state.job.work(estimate)
        if route.progress.s_m >= route.progress.length_m - END_TOLERANCE_M:
            self._arrive(state, estimate.t_s)
            return None
        reason: Fact | None = None
        has_crop = self._task.has_crop
        if isinstance(state, OnErrand) and state.errand.kind.is_along_own_track:
            return None  # along its track, slowly: backwards
        if isinstance(state, Driving) and route.is_beside_row and has_crop:
            reason = self._watch.check_row(route, estimate, self._config)
        rows = self._task.rows if has_crop else ()
        clearance_m = self._task.clearance_m
        if isinstance(state, Driving):
            clearance_m -= state.job.nudged_here_m + abs(self._freeing.left_m)
        astray = self._watch.check_crop(route, estimate, rows, clearance_m)
        return reason or astray

    def _arrive(self, state: Driving | OnErrand, t_s: float) -> None:
        if isinstance(state, Driving):
            self._end(*state.job.finish(t_s))
        elif state.errand.kind.leads_home:
            ended = self._ended or Ended("cancelled", _describe_return(state.errand))
            self._end(ended.ending, ended.reason)
        elif state.errand.kind is ErrandKind.FREE:
            self._try_again(state)
        elif state.errand.kind.leaves_row and self._job is not None:
            leaves_out = state.errand.kind is ErrandKind.OUT
            self._job.go_back(*state.errand.goal, leaves_out=leaves_out)
            self._is_away = False
            self._watch.restart()
            self._state = Driving(self._job)
        elif state.errand.kind is ErrandKind.WORK and self._job is not None:
            self._job.go_on()
            self._is_away = False
            self._watch.restart_headway()
            self._state = Driving(self._job)
        else:
            by = state.errand.asked_by
            self._stand(AtGoal(by), away=None)

    def _run_on(self, state: Waiting | Driving | OnErrand) -> None:
        self._drop()
        self._state, self._refusal = state, None
        self._watch.restart()

    def _pause(self, reason: Fact, *, by_itself: bool = False) -> None:
        """Pause; `by_itself`, without having been asked: a person has to look, and to resume it.

        An errand that has not begun is given up.
        """
        self._stand(reason, find_away(self._state), by_itself=by_itself)

    def _stand(self, reason: Fact, away: OnErrand | None, *, by_itself: bool = False) -> None:
        """Pause; what had ended before an errand is ended again."""
        self._drop()
        state = self._state
        if isinstance(state, Ended):
            return
        if self._ended is not None and away is None:
            self._state = Ended(self._ended.ending, self._ended.reason)
            return
        cut_off = state.cut_off if isinstance(state, Paused) else None
        self._state = Paused(reason, reason, reason if by_itself else None, away, cut_off)

    def _end(
        self,
        ending: Ending,
        reason: Fact | None,
        stood: Fact | None = None,
        errand: Errand | None = None,
    ) -> None:
        self._drop()
        self._state = Ended(ending, reason, stood, find_away(self._state), errand)

    def _drop(self) -> None:
        """Drop what is being worked out: it is not wanted any more."""
        if self._desk.is_checking:
            self._answers.settle_check(self._refuse(TaskRefused("plan", AskedElse())))
        self._desk.drop()


def _read_places(visit: Visit) -> tuple[MapPoint, ...]:
    """Return the places of a visit. Raises: MissionError: it names none."""
    if not visit.places_map_m:
        raise MissionError(NoPlaces())
    return visit.places_map_m


def _describe_return(errand: Errand) -> CameToBeCharged | ReturnedHome:
    is_to_charge = errand.kind is ErrandKind.CHARGE
    return CameToBeCharged() if is_to_charge else ReturnedHome(errand.asked_by)
