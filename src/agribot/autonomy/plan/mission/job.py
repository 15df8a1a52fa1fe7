"""The work of a mission along its planned route: what of it is done, and how to go on with it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Literal

from agribot.autonomy.plan.mission.covered import CoveredRows, cover_row
from agribot.autonomy.plan.mission.route import Route
from agribot.autonomy.plan.mission.row_evidence import (
    find_doubt,
    is_counted,
    link_stretches,
    row_pitch_m,
)
from agribot.autonomy.plan.mission.row_log import MOST_NUDGED_M, RowLog
from agribot.autonomy.plan.mission.saved_mission import (
    PoseTuple,
    SavedMission,
    name_task,
    take_pose,
)
from agribot.autonomy.plan.mission.task import Task
from agribot.autonomy.plan.ways.curves import Place
from agribot.core.config import MissionConfig
from agribot.core.errors import MissionError
from agribot.core.facts import (
    Fact,
    InNoRow,
    RowMovedFar,
    RowsSkipped,
    RowsUndriven,
    RowsUnproven,
    WaypointsMissed,
)
from agribot.core.messages import Estimate, MissionState, Path, Row
from agribot.core.pose import Pose2
from agribot.core.row_shape import chord_yaw_rad, row_length_m

Ending = Literal["done", "cancelled", "failed"]  # end of a mission
MOST_NAMED = 3  # rows without evidence


class MissionJob:
    """Rows and waypoints that are worked along one route."""

    def __init__(
        self,
        task: Task,
        config: MissionConfig,
        path: Path,
        planned_from: PoseTuple,
        covered: CoveredRows | None = None,
        detours: tuple[tuple[int, int], ...] = (),
    ) -> None:
        """Take the path that was planned from a pose.

        `covered` is what an earlier mission worked of the rows, `detours` are the points of the
        path from which a row was left out, and the rows.

        Raises: MissionError: the path does not fit the task, or no way leads around a row.
        """
        self.task, self.planned_from = task, planned_from
        self._config = config
        self._waypoints = tuple(task.waypoints)
        self.rows = RowLog([row.index for row in task.rows], link_stretches(task.rows))
        self.name = name_task(self.rows.indices, self._waypoints, path)
        self._pitch_m = row_pitch_m(task.rows)
        self._covered = CoveredRows(task.rows) if covered is None else covered
        self._tool_m = (math.nan, math.nan)
        self._detours = detours
        for index, row in detours:
            path = task.plan_around(path, index, row)
        self.route = self._make_route(path)

    @property
    def waypoints_reached(self) -> tuple[bool, ...]:
        return self.route.visits.reached

    @property
    def leg(self) -> str:
        """Stretch of its way where the robot is, for people; rows count from 1."""
        here = self.rows.here
        if here >= 0:
            return f"past row {here + 1}" if self.rows.is_skipped(here) else f"row {here + 1}"
        following = self.route.next_row
        return f"to row {following + 1}" if following >= 0 else "way"

    def change_speed(self, config: MissionConfig) -> None:
        if config is not self._config:
            self._config = config
            self.route.change_speed(config)

    def restore(self, saved: SavedMission) -> None:
        """Go on in the same path where an earlier mission was cut off."""
        self.route.go_on(saved.s_m, saved.waypoints_reached)
        self.rows.restore(saved.rows, saved.row, saved.s_m)

    def leave_out(self, done: Iterable[int], skipped: Iterable[int]) -> None:
        """Leave out rows that an earlier mission worked whole, and those that it was to skip."""
        for index in done:
            self.rows.take_as_done(index)
        for index in skipped:
            self.rows.skip(index)

    def save(self, state: MissionState, last: Estimate) -> SavedMission:
        route, task = self.route, self.task
        return SavedMission(
            task=self.name,
            state=state,
            t_s=last.t_s,
            planned_from=self.planned_from,
            pose=(last.x_map_m, last.y_map_m, last.yaw_map_rad),
            length_m=route.progress.length_m,
            s_m=route.progress.s_m,
            row=self.rows.here,
            rows=self.rows.results,
            waypoints_reached=self.waypoints_reached,
            detours=self._detours,
            covered=self._covered.stretches(but=self.rows.unproven),
            skipped=tuple(cover_row(row) for row in task.rows if self.rows.is_skipped(row.index)),
            visit=self._waypoints if task.name else (),
            visit_name=task.name,
        )

    def lead_on(self) -> None:
        """Go on along another path, where the task finds its rows under way.

        Raises: MissionError: no way leads to the next row.
        """
        explorer, route = self.task.explorer, self.route
        path = None if explorer is None else explorer.lead(route.path, route.progress.s_m)
        if path is None:
            return
        self.rows.keep([row.index for row in self.task.rows])
        self.route = self._make_route(path)
        self.route.go_on(route.progress.s_m, route.visits.reached)

    def nudge(self, left_m: float) -> InNoRow | RowMovedFar | None:
        """Move the line of the row under the robot to the left as it drives, or find why not."""
        row = self.rows.here
        if row < 0:
            return InNoRow()
        if not self.rows.nudge(row, self._read_along(row) * left_m):
            return RowMovedFar(row + 1, MOST_NUDGED_M)
        return None

    def relate_to_nudged(self, estimate: Estimate) -> Estimate:
        """Return the pose in a map in which the row under the robot lies where a person moved it.

        So the robot follows the path that far aside.
        """
        row = self.rows.here
        nudged_m = self.rows.nudged_m(row)
        if not nudged_m:
            return estimate
        line = self._find_row(row)
        return estimate.relate_to_aside(chord_yaw_rad(line), nudged_m)

    @property
    def nudged_here_m(self) -> float:
        """Offset of the row's line under the robot, either way."""
        return abs(self.rows.nudged_m(self.rows.here))

    def _read_along(self, row: int) -> float:
        """1.0 where the robot drives a row in its direction, -1.0 against it."""
        line = self._find_row(row)
        is_along = math.cos(self.route.yaw_map_rad - chord_yaw_rad(line)) >= 0.0
        return 1.0 if is_along else -1.0

    def work(self, estimate: Estimate) -> None:
        """Count what the robot passes: it is on the route, where its progress says."""
        progress = self.route.progress
        beside_m = abs(progress.cross_track_m)
        why = find_doubt(self.task, estimate, self.route.yaw_map_rad, self._pitch_m)
        self.rows.work(
            self.route.row_here, beside_m, progress.s_m, estimate.t_s, why,
            is_counted=is_counted(self.task, estimate),
        )  # fmt: skip
        self._cover(self.route.tool_row, estimate)
        self.route.visits.update(progress.s_m, estimate.x_map_m, estimate.y_map_m)

    def _cover(self, row: int, estimate: Estimate) -> None:
        x_m, y_m = Pose2(*take_pose(estimate)).transform(self.task.tool.x_m, 0.0)
        self._tool_m = (x_m, y_m)
        if self.is_wanted(row):
            self._covered.work(row, x_m, y_m)
        else:
            self._covered.leave()

    @property
    def place_to_go_on(self) -> Place:
        """Place where the robot, after a drive elsewhere, gets back to its route.

        In crop that is straight before the row under it: rows are only entered at their ends.
        """
        index = self.route.before_row if self.task.has_crop else self.route.progress.index
        x_m, y_m = self.route.path.xy_map_m[index]
        return float(x_m), float(y_m), float(self.route.path.yaw_map_rad[index])

    def go_on(self) -> None:
        """Take up the work again: the robot is at `place_to_go_on`."""
        if self.task.has_crop:
            back_m = float(self.route.path.s_m[self.route.before_row])
            self.rows.leave()
            self.route.go_on(min(back_m, self.route.progress.s_m), self.route.visits.reached)

    def go_back(self, s_m: float, *, leaves_out: bool) -> None:
        """Go on from an earlier distance of the route, with the row there or with the next one."""
        self.rows.leave()
        self.route.go_on(min(s_m, self.route.progress.s_m), self.route.visits.reached)
        if leaves_out:
            self.skip_row()

    def give_up_row(self) -> None:
        """Judge the row under the robot, if any: it stands there and waits for a person."""
        if self.rows.here >= 0:
            self.rows.give_up(row_length_m(self._find_row(self.rows.here)))

    def step_back(self, back_m: float) -> None:
        """Go on from `back_m` behind on the route, in the same row or turn, after backing out."""
        route, index = self.route, self.route.progress.index
        s_m, row = route.path.s_m, route.row
        to_m = route.progress.s_m - back_m
        while index > 0 and to_m < s_m[index - 1] < s_m[index] and row[index - 1] == row[index]:
            index -= 1
        route.go_on(max(to_m, float(s_m[index])), route.visits.reached)

    def skip_row(self) -> None:
        """Pass the row under the robot with the tool off. Called again, the next one.

        That one is left out of the way, where a clear way leads around it.
        """
        route, here = self.route, self.rows.here
        row = here if here >= 0 and not self.rows.is_skipped(here) else route.next_row
        self.rows.skip(row)
        if row in (-1, here):
            return
        index = route.progress.index
        try:
            path = self.task.plan_around(route.path, index, row)
        except MissionError:
            return  # it is passed with the tool off
        self._detours += ((index, row),)
        self.route = self._make_route(path)
        self.route.go_on(route.progress.s_m, route.visits.reached)

    def is_wanted(self, row: int) -> bool:
        """Return whether the tool is to work this row here; -1 is no row."""
        if row < 0 or self.rows.is_skipped(row):
            return False
        return not self._covered.was_worked(row, *self._tool_m)

    def _find_row(self, index: int) -> Row:
        return next(row for row in self.task.rows if row.index == index)

    def _make_route(self, path: Path) -> Route:
        return Route(path, self.rows.indices, self._config, self._waypoints, self.task.tool)

    def finish(self, t_s: float) -> tuple[Ending, Fact | None]:
        """Close the account at the end of the route: how the job ended, and why."""
        self.rows.work(-1, 0.0, self.route.progress.s_m, t_s)
        missed = self.route.visits.list_missed()
        unproven = self.rows.unproven
        left = self.rows.open_rows(self.route.planned_rows)
        undone = [row for row in left if row not in unproven]
        if missed:
            return "failed", WaypointsMissed(tuple(missed), self._config.waypoint_radius_m)
        if self.task.explorer is not None and self.task.explorer.unfinished:
            return "failed", self.task.explorer.unfinished
        if undone:
            return "failed", RowsUndriven(tuple(undone))
        if unproven:
            named = tuple(map(self.rows.object_to, unproven[:MOST_NAMED]))
            return "failed", RowsUnproven(rows=named, more=len(unproven) - len(named))
        skipped = tuple(self.rows.skipped)
        return "done", RowsSkipped(skipped) if skipped else None
