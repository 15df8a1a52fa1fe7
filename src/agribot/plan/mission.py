"""The mission: what to do next, and an honest account of what was done."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence

import msgspec

from agribot.config import MissionConfig
from agribot.errors import MissionError
from agribot.messages import (
    Estimate,
    FloatArray,
    Goal,
    MissionState,
    MissionStatus,
    OperatorEvent,
    Path,
    Row,
)  # fmt: skip
from agribot.plan.caution import across_std_m, caution_ratio
from agribot.plan.job import Detour, Job, Planner
from agribot.plan.route import AT_ORIGIN, Route, Tool
from agribot.plan.row_log import RowResult
from agribot.plan.saved_mission import PoseTuple, SavedMission, check_not_carried_away
from agribot.plan.stall import StallWatch

SETTLE_S = 1.0  # the estimate must hold this long before the robot moves
END_TOLERANCE_M = 0.01
FINAL: tuple[MissionState, ...] = ("done", "cancelled", "failed")


# The way from where the robot is to its home pose, first along the rest of the row under it (N, 2).
HomePlanner = Callable[[Estimate, PoseTuple, FloatArray], Path]


class Mission:
    """State machine over one path, which it plans itself once the robot knows where it is.

    waiting -> running <-> paused -> done | cancelled | failed. A stop pauses and latches: first
    `clear_stop`, then `resume`, and the work goes on at the same place.
    """

    def __init__(
        self,
        plan: Planner,
        rows: Sequence[Row],
        config: MissionConfig,
        waypoints: Sequence[tuple[float, float]] = (),
        tool: Tool = AT_ORIGIN,
        has_crop: bool = True,
        home: HomePlanner | None = None,
        saved: SavedMission | None = None,
        around: Detour | None = None,
    ) -> None:
        """`plan` is asked once, from where the robot stands when its estimate has settled.

        `waypoints` are places in the map that the planned path visits, in its order. Where there
        is crop, the robot slows down as it knows less well where the rows are. `saved` is a
        mission that was cut off: it goes on where it was. `around` leaves a skipped row out of
        the path; without it the row is passed with the tool off.
        """
        self._job = Job(plan, rows, config, waypoints, tool, saved, around)
        self._tool = tool
        self._plan_home = home
        self._home: Route | None = None
        self._home_reason = ""
        self._has_crop = has_crop
        self._config = config
        self._last: Estimate | None = None
        self._state: MissionState = "waiting"
        self._before_pause: MissionState = "waiting"
        self._reason = "waiting for the first estimate"
        self._is_stopped = False
        self._ok_since_s: float | None = None
        self._caution = 1.0
        self._stall = StallWatch(config.stall_timeout_s)

    @property
    def path(self) -> Path | None:
        """None until it is planned; the way home once the robot was called there."""
        return self._way.path if self._way else None

    @property
    def _way(self) -> Route | None:
        return self._home or self._job.route

    @property
    def row_results(self) -> tuple[RowResult, ...]:
        return self._job.rows.results

    @property
    def waypoints_reached(self) -> tuple[bool, ...]:
        return self._job.waypoints_reached

    def saved(self) -> SavedMission | None:
        """All that is needed to go on later; None before a path is planned."""
        return self._job.saved(self._state, self._last) if self._last else None

    def step(self, estimate: Estimate, events: Iterable[OperatorEvent] = ()) -> Goal:
        is_located = estimate.ok and math.isfinite(estimate.x_map_m + estimate.y_map_m)
        self._last = estimate if is_located else self._last
        for event in events:
            self._handle(event)
        if self._state == "waiting":
            self._wait(estimate, is_located)
        elif self._state == "running" and self._way:
            self._run(self._way, estimate, is_located)
        return self._goal(is_located)

    def _run(self, route: Route, estimate: Estimate, is_located: bool) -> None:
        if is_located:
            self._reason = ""
            self._advance(route, estimate)
            self._be_cautious(route, estimate)
        else:
            self._reason = f"position lost: {estimate.reason or 'not finite'}"
        is_stalled = self._stall.is_stalled(route.progress.s_m, estimate.t_s)
        if is_stalled and self._state == "running":
            where = f"after {route.progress.s_m:.1f} m of {route.progress.length_m:.1f} m"
            why = f" ({self._reason})" if self._reason else ""
            limit_s = self._config.stall_timeout_s
            self._end("failed", f"no headway for {limit_s:g} s {where}{why}")

    def _handle(self, event: OperatorEvent) -> None:
        if self._state in FINAL:
            return
        if event.action == "cancel":
            self._end("cancelled", f"cancelled by {event.source}")
        elif event.action == "stop":
            self._is_stopped = True
            self._pause(f"stopped by {event.source}; clear the stop, then resume")
        elif event.action == "clear_stop" and self._is_stopped:
            self._is_stopped = False
            self._reason = "stop cleared; waiting for resume"
        elif event.action == "set":
            self._set(event)
        elif event.action == "skip_row":
            if self._home is None:
                self._job.skip_row()
        elif not self._is_stopped:
            self._handle_moving(event)

    def _handle_moving(self, event: OperatorEvent) -> None:
        if event.action == "pause":
            self._pause(f"paused by {event.source}")
        elif event.action == "resume" and self._state == "paused":
            self._resume()
        elif event.action == "return_home" and self._home is None:
            self._turn_home(event.source)

    def _resume(self) -> None:
        try:
            if self._way is not None and self._last is not None and self._before_pause == "running":
                check_not_carried_away(self._last, self._way.place, self._config.resume_limit_m)
        except MissionError as error:
            self._reason = f"not resumed: {error}"
            return
        self._state, self._reason = self._before_pause, ""
        self._stall.restart()

    def _turn_home(self, source: str) -> None:
        route = self._job.route
        if route is None or self._last is None or self._plan_home is None:
            self._reason = "no way home: nothing was planned yet"
            return
        ahead = route.row_ahead if self._has_crop else route.path.xy_map_m[:0]
        try:
            path = self._plan_home(self._last, self._job.planned_from, ahead)
        except MissionError as error:
            self._reason = f"cannot return home: {error}"
            return
        self._home = Route(path, (), self._config, ())
        self._home_reason = f"returned home, called by {source}"
        self._state, self._reason = "running", ""
        self._stall.restart()

    def _set(self, event: OperatorEvent) -> None:
        if event.text != "mission.speed_mps":
            return
        self._config = msgspec.structs.replace(self._config, speed_mps=event.value)
        self._job.change_speed(self._config)
        if self._home is not None:
            self._home.change_speed(self._config)

    def _pause(self, reason: str) -> None:
        if self._state != "paused":
            self._before_pause = self._state
        self._state, self._reason = "paused", reason
        self._ok_since_s = None

    def _wait(self, estimate: Estimate, is_located: bool) -> None:
        if not is_located:
            self._ok_since_s = None
            self._reason = f"waiting for position: {estimate.reason or 'no estimate'}"
            if self._stall.is_stalled(0.0, estimate.t_s):
                limit_s = self._config.stall_timeout_s
                self._end("failed", f"no position for {limit_s:g} s ({estimate.reason})")
            return
        if self._ok_since_s is None:
            self._ok_since_s = estimate.t_s
        if estimate.t_s - self._ok_since_s >= SETTLE_S:
            self._start(estimate)
        else:
            self._reason = "waiting for the estimate to settle"

    def _start(self, estimate: Estimate) -> None:
        """Plan from here, unless this is the way back from a pause; a refused plan ends it all."""
        try:
            if self._job.route is None:
                self._job.begin(estimate)
        except MissionError as error:
            self._end("failed", str(error))
        else:
            self._state, self._reason = "running", ""
            self._stall.restart()

    def _advance(self, route: Route, estimate: Estimate) -> None:
        x_map_m, y_map_m = estimate.x_map_m, estimate.y_map_m
        progress = route.progress
        progress.advance(x_map_m, y_map_m)
        limit_m = self._config.off_path_limit_m
        if progress.off_path_m > limit_m:
            off_m = progress.off_driven_path_m(x_map_m, y_map_m)
            if off_m > limit_m:
                self._fail_off_path(off_m, estimate)
                return
        is_at_end = progress.s_m >= progress.length_m - END_TOLERANCE_M
        if self._home is not None:
            if is_at_end:
                self._end("cancelled", self._home_reason)
            return
        self._job.work(estimate)
        if is_at_end:
            self._end(*self._job.finish(estimate.t_s))

    def _be_cautious(self, route: Route, estimate: Estimate) -> None:
        """In and next to the rows, no faster than the robot knows where the plants are."""
        self._caution = 1.0
        if self._state != "running" or not route.is_beside_row or not self._has_crop:
            return
        std_m = across_std_m(estimate, route.yaw_map_rad)
        self._caution = caution_ratio(std_m, self._config)
        if self._caution == 0.0:
            self._reason = (
                f"row lost: known across it to {std_m:.2f} m > {self._config.max_row_std_m:.2f} m; "
                "check camera and crop, or use a receiver with corrections"
            )

    def _fail_off_path(self, off_m: float, estimate: Estimate) -> None:
        self._end(
            "failed",
            f"off path by {off_m:.2f} m > {self._config.off_path_limit_m:.2f} m at East "
            f"{estimate.x_map_m:.2f} m, North {estimate.y_map_m:.2f} m; check the position "
            "source, then plan again from here",
        )

    def _end(self, state: MissionState, reason: str) -> None:
        self._state, self._reason = state, reason

    def _goal(self, is_located: bool) -> Goal:
        route, status = self._way, self._status()
        if route is None:
            return Goal(path=None, s_m=0.0, max_speed_mps=0.0, tool_on=False, status=status)
        is_running = self._state == "running" and is_located
        tool_on = is_running and self._job.is_wanted(route.tool_row)
        return Goal(
            path=route.path,
            s_m=status.s_m,
            max_speed_mps=self._caution * route.max_speed_mps if is_running else 0.0,
            tool_on=tool_on,
            status=status,
            tracked_x_m=self._tool.tracked_x_m if tool_on else 0.0,
        )

    def _status(self) -> MissionStatus:
        way, rows = self._way, self._job.rows
        progress = way.progress if way else None
        leg = "way home" if self._home else self._job.leg
        return MissionStatus(
            state=self._state,
            reason=self._reason,
            row=-1 if self._home else rows.here,
            rows_total=len(rows.indices),
            rows_done=rows.done,
            s_m=progress.s_m if progress else 0.0,
            length_m=progress.length_m if progress else 0.0,
            waypoints_total=len(self.waypoints_reached),
            waypoints_reached=sum(self.waypoints_reached),
            leg="" if self._state in FINAL else leg,
            distance_left_m=progress.length_m - progress.s_m if progress else 0.0,
            eta_s=way.time_left_s if way else None,
        )
