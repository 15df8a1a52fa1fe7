"""The mission: what to do next, and an honest account of what was done."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence

import msgspec

from agribot.config import MissionConfig
from agribot.errors import MissionError
from agribot.messages import (
    Estimate,
    Goal,
    MissionState,
    MissionStatus,
    OperatorEvent,
    Path,
    Row,
)  # fmt: skip
from agribot.plan.caution import across_std_m, caution_ratio
from agribot.plan.route import TOOL_REACH_M, Route
from agribot.plan.stall import StallWatch

SETTLE_S = 1.0  # the estimate must hold this long before the robot moves
END_TOLERANCE_M = 0.01
Planner = Callable[[Estimate], Path]
FINAL: tuple[MissionState, ...] = ("done", "cancelled", "failed")


class RowResult(msgspec.Struct, frozen=True, kw_only=True):
    """One row as the robot believes it went; times are None where it did not come so far."""

    index: int
    started_s: float | None = None
    finished_s: float | None = None
    done: bool = False
    max_cross_track_m: float = 0.0


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
        tool_reach_m: float = TOOL_REACH_M,
        has_crop: bool = True,
    ) -> None:
        """`plan` is asked once, from where the robot stands when its estimate has settled.

        `waypoints` are places in the map that the planned path visits, in its order. The tool
        works in the rows and up to `tool_reach_m` past their ends. Where there is crop, the
        robot slows down as it knows less well where the rows are.
        """
        self._tool_reach_m = tool_reach_m
        self._has_crop = has_crop
        self._plan = plan
        self._config = config
        self._waypoints = tuple(waypoints)
        self._route: Route | None = None
        self._results = {row.index: RowResult(index=row.index) for row in rows}
        self._state: MissionState = "waiting"
        self._before_pause: MissionState = "waiting"
        self._reason = "waiting for the first estimate"
        self._is_stopped = False
        self._ok_since_s: float | None = None
        self._caution = 1.0
        self._stall = StallWatch(config.stall_timeout_s)
        self._worked_row = -1
        self._rows_done: tuple[int, ...] = ()

    @property
    def path(self) -> Path | None:
        """None until it is planned."""
        return self._route.path if self._route else None

    @property
    def row_results(self) -> tuple[RowResult, ...]:
        return tuple(self._results.values())

    @property
    def waypoints_reached(self) -> tuple[bool, ...]:
        return self._route.visits.reached if self._route else (False,) * len(self._waypoints)

    def step(self, estimate: Estimate, events: Iterable[OperatorEvent] = ()) -> Goal:
        for event in events:
            self._handle(event)
        is_located = estimate.ok and math.isfinite(estimate.x_map_m + estimate.y_map_m)
        if self._state == "waiting":
            self._wait(estimate, is_located)
        elif self._state == "running" and self._route:
            self._run(self._route, estimate, is_located)
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
        elif event.action == "pause" and not self._is_stopped:
            self._pause(f"paused by {event.source}")
        elif event.action == "resume" and self._state == "paused" and not self._is_stopped:
            self._state, self._reason = self._before_pause, ""
            self._stall.restart()

        elif event.action == "set" and event.text == "mission.speed_mps":
            self._config = msgspec.structs.replace(self._config, speed_mps=event.value)
            if self._route is not None:
                self._route.change_speed(self._config)

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
            if self._route is None:
                path = self._plan(estimate)
                self._route = Route(
                    path, tuple(self._results), self._config, self._waypoints, self._tool_reach_m
                )
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
        self._work_row(route.row_here, abs(progress.cross_track_m), estimate.t_s)
        route.visits.update(progress.s_m, x_map_m, y_map_m)
        if progress.s_m >= progress.length_m - END_TOLERANCE_M:
            self._finish(route, estimate.t_s)

    def _be_cautious(self, route: Route, estimate: Estimate) -> None:
        """In and next to the rows, no faster than the robot knows where the plants are."""
        self._caution = 1.0
        if self._state != "running" or not route.tool_on or not self._has_crop:
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

    def _work_row(self, row: int, beside_m: float, t_s: float) -> None:
        if row != self._worked_row and self._worked_row >= 0:
            self._replace(self._worked_row, finished_s=t_s, done=True)
            self._rows_done += (self._worked_row,)
        if row >= 0:
            result = self._results[row]
            worst_m = max(result.max_cross_track_m, beside_m)
            if row != self._worked_row:
                self._replace(row, started_s=t_s, max_cross_track_m=worst_m)
            elif worst_m > result.max_cross_track_m:
                self._replace(row, max_cross_track_m=worst_m)
        self._worked_row = row

    def _replace(self, row: int, **changes: float | bool) -> None:
        self._results[row] = msgspec.structs.replace(self._results[row], **changes)

    def _finish(self, route: Route, t_s: float) -> None:
        self._work_row(-1, 0.0, t_s)
        missed = route.visits.missed()
        undone = [row for row in route.planned_rows if not self._results[row].done]
        if missed:
            self._end(
                "failed",
                f"waypoints {missed} were passed at more than mission.waypoint_radius_m "
                f"{self._config.waypoint_radius_m:.2f} m",
            )
        elif undone:
            self._end("failed", f"the path ended with rows {undone} not driven")
        else:
            self._end("done", "")

    def _end(self, state: MissionState, reason: str) -> None:
        self._state, self._reason = state, reason

    def _goal(self, is_located: bool) -> Goal:
        route, status = self._route, self._status()
        if route is None:
            return Goal(path=None, s_m=0.0, max_speed_mps=0.0, tool_on=False, status=status)
        is_running = self._state == "running" and is_located
        return Goal(
            path=route.path,
            s_m=status.s_m,
            max_speed_mps=self._caution * route.max_speed_mps if is_running else 0.0,
            tool_on=is_running and route.tool_on,
            status=status,
        )

    def _status(self) -> MissionStatus:
        progress = self._route.progress if self._route else None
        return MissionStatus(
            state=self._state,
            reason=self._reason,
            row=self._worked_row,
            rows_total=len(self._results),
            rows_done=self._rows_done,
            s_m=progress.s_m if progress else 0.0,
            length_m=progress.length_m if progress else 0.0,
            waypoints_total=len(self._waypoints),
            waypoints_reached=sum(self.waypoints_reached),
        )
