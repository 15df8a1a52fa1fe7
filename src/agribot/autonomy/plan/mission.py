"""The mission: what people and programs may ask of it while it drives."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

import msgspec

from agribot.autonomy.plan.account import FINAL
from agribot.autonomy.plan.driving import Driving
from agribot.autonomy.plan.errand import (
    BATTERY,
    STANDING_MPS,
    Errand,
    Errands,
    goal_errand,
    home_errand,
    work_errand,
)
from agribot.autonomy.plan.job import Job
from agribot.autonomy.plan.saved_mission import check_not_carried_away
from agribot.autonomy.plan.task import Task
from agribot.core.errors import MissionError
from agribot.core.messages import Estimate, Goal, OperatorEvent

# Heard after the end by a mission that stays open.
AFTER_THE_END = (
    "start", "goto", "return_home", "visit", "plan", "stop", "clear_stop", "set",
)  # fmt: skip
MOVING = ("start", "resume", "goto", "return_home")  # what sets the robot in motion by itself
ASKED = (*MOVING, "pause", "cancel", "skip_row", "visit", "plan")  # of a mission, of nobody else


class Mission(Driving):
    """A stop pauses and latches: first `clear_stop`, then `resume`, and the work goes on at the
    same place. Beside its job it drives errands: home, or to a place on demand, after which
    `resume` leads back to the work.
    """

    def step(self, estimate: Estimate, events: Iterable[OperatorEvent] = ()) -> Goal:
        self._locate(estimate)
        self._heed_stop()
        for event in events:
            self._latch.hear(event)
            self._heed_stop()
            refusal = self._handle(event)
            if refusal is not None:
                self._answers.give(event.id, refusal)
        return self._go_on(estimate)

    def heed(self, warning: str) -> None:
        """Go home for a warning once the robot drives; where no way home is known, stand still.

        It is heeded once: whoever then bids the robot go on decides.
        """
        self._warning = warning
        self._is_heeded = self._is_heeded and bool(warning)
        if not warning or self._is_heeded or self._state not in ("running", "waiting"):
            return
        self._is_heeded = True
        self._refusal = ""
        refusal = self._turn_home(BATTERY)
        if refusal:
            self._hold(f"{warning}; {refusal}")

    def _handle(self, event: OperatorEvent) -> str | None:
        """Why it is refused, "" where it is taken or not for a mission; None: that shows later."""
        if self._state in FINAL and not (self._stays_open and event.action in AFTER_THE_END):
            return f"{event.action} refused: the mission has ended" if event.action in ASKED else ""
        if event.action == "cancel":
            stood, self._errands.asked = self._paused, None
            self._end("cancelled", f"cancelled by {event.source}")
            self._paused = stood  # a run that goes on with this one stands as well
        elif event.action == "set":
            self._set(event)
        elif event.action == "skip_row" and self._errands.route is None:
            self._job.skip_row()
        elif event.action in ("plan", "visit"):
            return self._take(event)
        else:
            return self._handle_moving(event)
        return ""

    def _handle_moving(self, event: OperatorEvent) -> str | None:
        if self._is_stopped:
            return self._refuse_stopped(event)
        if event.action == "pause":
            self._pause(f"paused by {event.source}")
        elif event.action in ("start", "resume") and self._state == "paused":
            return self._resume()
        elif event.action == "start" and self._state in FINAL:
            self._begin_anew()
        elif event.action == "return_home":
            return self._turn_home(event.source, event.id)
        elif event.action == "goto":
            return self._turn_to_goal(event)
        return ""

    def _refuse_stopped(self, event: OperatorEvent) -> str:
        if event.action not in MOVING:
            return ""
        what = "goal" if event.action == "goto" else event.action
        refusal = f"{what} refused: the robot is stopped; clear the stop first"
        if event.action == "goto":
            self._refusal = refusal
        return refusal

    def _resume(self) -> str:
        """Why it is not resumed; "" where it is."""
        errands, way = self._errands, self._way
        try:
            if errands.cut_off is not None:
                self._drop()
                errands.ask(errands.cut_off)
                return ""
            if errands.is_away and errands.route is None and way is not None:
                self._drop()
                errands.ask(work_errand(self._job))
                return ""
            if way is not None and self._last is not None:
                check_not_carried_away(self._last, way.place, self._config.resume_limit_m)
        except MissionError as error:
            self._reason = f"not resumed: {error}"
            return self._reason
        self._is_resumed = True
        self._run_on("running" if way else "waiting")
        return ""

    def _begin_anew(self) -> None:
        """The whole task once more, planned from where the robot stands."""
        self._job, self._errands = Job(self.task, self._config), Errands()
        self._ended, self._ok_since_s = None, None
        self._is_resumed = True
        self._run_on("waiting")

    def _turn_home(self, source: str, id: str = "") -> str | None:
        """Why it cannot; None where that shows once it stands."""
        errands = self._errands
        wanted = errands.current if self._state == "running" else errands.asked
        if wanted is not None and wanted.to == "home":
            return ""
        try:
            errand = home_errand(self._job, source, id)
        except MissionError as error:
            self._refusal = f"cannot return home: {error}"
            return self._refusal
        self._stop_for(errand, f"stops to return home, as {source} wants")
        return None

    def _turn_to_goal(self, event: OperatorEvent) -> str | None:
        try:
            errand = goal_errand(self._job, event)
        except MissionError as error:
            self._refusal = f"goal refused: {error}"
            return self._refusal
        self._stop_for(errand, f"stops for a goal of {event.source}")
        return None

    def _stop_for(self, errand: Errand, reason: str) -> None:
        """The way is planned from where the robot comes to rest."""
        if self._state in FINAL:
            self._ended = (self._state, self._reason)
        self._state, self._reason = "paused", reason
        self._drop()
        self._refusal = ""
        self._answers.replace_errand(errand)
        self._errands.ask(errand)

    def _take(self, event: OperatorEvent) -> str | None:
        """Another task from now on, from where the robot stands: a visit at once, a plan later."""
        is_visit, new_tasks = event.action == "visit", self._new_tasks
        is_moving = self._last is not None and abs(self._last.v_mps) > STANDING_MPS
        if new_tasks is None:
            self._refusal = f"{event.action} refused: this mission takes no other task"
            return self._refusal
        if is_moving and not is_visit:
            self._refusal = "plan refused: the robot drives; pause its mission first"
            return self._refusal

        def refuse(error: MissionError) -> None:
            self._is_checking = False
            self._refusal = f"{event.action} refused: {error}"
            self._answers.settle_task(self._refusal)

        self._drop()
        self._answers.await_task(event)
        self._is_checking = not is_visit
        latency_s = 0.0 if is_visit else new_tasks.checking_s
        work, then = partial(new_tasks.of, event), partial(self._work_at, event)
        self._desk.ask(event.t_s, work, latency_s, then, refuse)
        return None

    def _work_at(self, event: OperatorEvent, task: Task) -> None:
        self._answers.settle_task()
        self._is_checking = False
        if event.action == "visit":
            task = task._replace(bounds=self.task.bounds)
        self._job, self._errands = Job(task, self._config), Errands()
        self._ended, self._refusal, self._state = None, "", "paused"
        self._pause(f"new {event.action} from {event.source}; resume begins it")
        if event.action == "visit" and not self._is_stopped:
            self._run_on("waiting")

    def _set(self, event: OperatorEvent) -> None:
        if event.text != "mission.speed_mps":
            return
        self._config = msgspec.structs.replace(self._config, speed_mps=event.value)
        self._job.change_speed(self._config)
        if self._errands.route is not None:
            self._errands.route.change_speed(self._config)
