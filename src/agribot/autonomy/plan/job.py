"""The work of a mission: its route, what of it is done, and how to go on after an interruption."""

from __future__ import annotations

import math
from typing import NamedTuple

import msgspec

from agribot.autonomy.plan.covered import CoveredRows, whole_row
from agribot.autonomy.plan.curves import Place
from agribot.autonomy.plan.route import Route
from agribot.autonomy.plan.row_evidence import doubt, is_counted, row_pitch_m
from agribot.autonomy.plan.row_log import RowLog
from agribot.autonomy.plan.saved_mission import (
    PoseTuple,
    SavedMission,
    check_not_carried_away,
    check_same_task,
    task_name,
)
from agribot.autonomy.plan.task import Task
from agribot.core.config import MissionConfig
from agribot.core.errors import MissionError
from agribot.core.messages import Estimate, MissionState, Path

MOST_TOLD = 3  # rows without evidence


class Planned(NamedTuple):
    """The route of a job, the name of its task, and the pose from which it was planned.

    `covered` is what an earlier mission worked. Under another path than that mission's, `done` are
    the rows that need no more work and `skipped` those it was to leave out; where it goes on in
    its own path, `done` is None.
    """

    route: Route
    name: str
    planned_from: PoseTuple
    covered: CoveredRows
    done: tuple[int, ...] | None = None
    skipped: tuple[int, ...] = ()


class Job:
    """Rows and waypoints to be worked along one path, which is planned when work begins."""

    def __init__(
        self, task: Task, config: MissionConfig, saved: SavedMission | None = None
    ) -> None:
        """`saved` is one that was cut off; where it had no path yet, it begins anew."""
        saved = saved if saved is not None and saved.planned_from is not None else None
        self.task = task
        self._config = config
        self._waypoints = tuple(task.waypoints)
        self._saved = saved
        self._name = ""
        self._detours: tuple[tuple[int, int], ...] = ()
        self.rows = RowLog(row.index for row in task.rows)
        self._pitch_m = row_pitch_m(task.rows)
        self._covered = CoveredRows(task.rows)
        self._tool_m = (math.nan, math.nan)
        self.route: Route | None = None
        self.planned_from: PoseTuple = (math.nan, math.nan, math.nan)

    @property
    def waypoints_reached(self) -> tuple[bool, ...]:
        return self.route.visits.reached if self.route else (False,) * len(self._waypoints)

    def plan(self, estimate: Estimate) -> Planned:
        """From here; after an interruption, the same path as then, to go on in it.

        Raises: MissionError: no path, the robot was carried away, or the task is another one.
        """
        saved = self._saved
        covered = CoveredRows(self.task.rows)
        if saved is None or saved.planned_from is None:
            return self._planned(estimate, self.task.plan(estimate), covered)
        check_not_carried_away(estimate, saved.pose[:2], self._config.resume_limit_m)
        x_m, y_m, yaw_rad = saved.planned_from
        then = msgspec.structs.replace(estimate, x_map_m=x_m, y_map_m=y_m, yaw_map_rad=yaw_rad)
        path = self.task.plan(then)
        skipped = CoveredRows(self.task.rows)
        is_same_ground = covered.restore(saved.covered) | skipped.restore(saved.skipped)
        if is_same_ground and task_name(self.rows.indices, self._waypoints, path) != saved.task:
            return self._planned_rest(estimate, covered, skipped.complete)
        planned = self._planned(then, path, covered, saved.detours)
        check_same_task(saved, planned.name, planned.route.progress.length_m)
        planned.route.go_on(saved.s_m, saved.waypoints_reached)
        return planned

    def _planned_rest(
        self, estimate: Estimate, covered: CoveredRows, skipped: tuple[int, ...]
    ) -> Planned:
        """Another path over rows of which some were worked: begin with it where the robot is."""
        done = covered.complete
        left = [index for index in self.rows.indices if index not in done + skipped]
        if not left:
            raise MissionError("every row was worked or skipped before; nothing is left to resume")
        rest = self.task.rest
        path = rest(estimate, left) if rest else self.task.plan(estimate)
        return self._planned(estimate, path, covered)._replace(done=done, skipped=skipped)

    def _planned(
        self,
        estimate: Estimate,
        path: Path,
        covered: CoveredRows,
        detours: tuple[tuple[int, int], ...] = (),
    ) -> Planned:
        name = task_name(self.rows.indices, self._waypoints, path)
        for index, row in detours:
            path = self.task.around(path, index, row) if self.task.around else path
        pose = estimate.x_map_m, estimate.y_map_m, estimate.yaw_map_rad
        return Planned(self._route(path), name, pose, covered)

    def begin(self, planned: Planned) -> None:
        """Work along what `plan` found."""
        saved = self._saved
        self.route, self._name, self.planned_from, self._covered, done, skipped = planned
        if done is not None:
            for index in done:
                self.rows.take_as_done(index)
            for index in skipped:
                self.rows.skip(index)
        elif saved is not None:
            self._detours = saved.detours
            self.rows.restore(saved.rows, saved.row, saved.s_m)

    def change_speed(self, config: MissionConfig) -> None:
        self._config = config
        if self.route is not None:
            self.route.change_speed(config)

    def saved(self, state: MissionState, last: Estimate) -> SavedMission:
        route = self.route
        return SavedMission(
            task=self._name,
            state=state,
            t_s=last.t_s,
            planned_from=self.planned_from if route else None,
            pose=(last.x_map_m, last.y_map_m, last.yaw_map_rad),
            length_m=route.progress.length_m if route else 0.0,
            s_m=route.progress.s_m if route else 0.0,
            row=self.rows.here,
            rows=self.rows.results,
            waypoints_reached=self.waypoints_reached,
            detours=self._detours,
            covered=self._covered.stretches(but=self.rows.unproven),
            skipped=tuple(
                whole_row(row) for row in self.task.rows if self.rows.is_skipped(row.index)
            ),
            visit=self._waypoints if self.task.name else (),
            visit_name=self.task.name,
        )

    def work(self, estimate: Estimate) -> None:
        """The robot is on the route, where its progress says."""
        assert self.route is not None
        progress = self.route.progress
        beside_m = abs(progress.cross_track_m)
        why = doubt(self.task, estimate, self.route.yaw_map_rad, self._pitch_m)
        self.rows.work(
            self.route.row_here, beside_m, progress.s_m, estimate.t_s, why,
            is_counted=is_counted(self.task, estimate),
        )  # fmt: skip
        self._cover(self.route.tool_row, estimate)
        self.route.visits.update(progress.s_m, estimate.x_map_m, estimate.y_map_m)

    def _cover(self, row: int, estimate: Estimate) -> None:
        ahead_m, yaw_rad = self.task.tool.x_m, estimate.yaw_map_rad
        x_m = estimate.x_map_m + ahead_m * math.cos(yaw_rad)
        y_m = estimate.y_map_m + ahead_m * math.sin(yaw_rad)
        self._tool_m = (x_m, y_m)
        if self.is_wanted(row):
            self._covered.work(row, x_m, y_m)
        else:
            self._covered.leave()

    @property
    def place_to_go_on(self) -> Place:
        """Where the robot, after a drive elsewhere, gets back to its route.

        In crop that is straight before the row under it: rows are only entered at their ends.
        """
        assert self.route is not None
        index = self.route.before_row if self.task.has_crop else self.route.progress.index
        x_m, y_m = self.route.path.xy_map_m[index]
        return float(x_m), float(y_m), float(self.route.path.yaw_map_rad[index])

    def go_on(self) -> None:
        """The robot is at `place_to_go_on`."""
        assert self.route is not None
        if self.task.has_crop:
            back_m = float(self.route.path.s_m[self.route.before_row])
            self.rows.leave()
            self.route.go_on(min(back_m, self.route.progress.s_m), self.route.visits.reached)

    def skip_row(self) -> None:
        """The row under the robot: it is passed with the tool off. Called again, the next one.

        That one is left out of the way, where a clear way leads around it.
        """
        route = self.route
        if route is None:
            return
        here = self.rows.here
        row = here if here >= 0 and not self.rows.is_skipped(here) else route.next_row
        self.rows.skip(row)
        if row in (-1, here) or self.task.around is None:
            return
        index = route.progress.index
        try:
            path = self.task.around(route.path, index, row)
        except MissionError:
            return  # it is passed with the tool off
        self._detours += ((index, row),)
        self.route = self._route(path)
        self.route.go_on(route.progress.s_m, route.visits.reached)

    def is_wanted(self, row: int) -> bool:
        """Whether the tool is to work this row here; -1 is none."""
        if row < 0 or self.rows.is_skipped(row):
            return False
        return not self._covered.was_worked(row, *self._tool_m)

    def _route(self, path: Path) -> Route:
        return Route(path, self.rows.indices, self._config, self._waypoints, self.task.tool)

    def finish(self, t_s: float) -> tuple[MissionState, str]:
        """How the job ended at the end of its route, and why."""
        assert self.route is not None
        self.rows.work(-1, 0.0, self.route.progress.s_m, t_s)
        missed = self.route.visits.missed()
        unproven = self.rows.unproven
        left = self.rows.open_rows(self.route.planned_rows)
        undone = [row for row in left if row not in unproven]
        if missed:
            return "failed", (
                f"waypoints {missed} were passed at more than mission.waypoint_radius_m "
                f"{self._config.waypoint_radius_m:.2f} m"
            )
        if undone:
            return "failed", f"the path ended with rows {undone} not driven"
        if unproven:
            told = "; ".join(self.rows.missing(row) for row in unproven[:MOST_TOLD])
            more = f" and {len(unproven) - MOST_TOLD} more" * (len(unproven) > MOST_TOLD)
            return "failed", (
                f"{told}{more}: not counted as done; check the start mark and the camera"
            )
        skipped = list(self.rows.skipped)
        return "done", f"rows {skipped} were skipped, as asked" if skipped else ""

    @property
    def leg(self) -> str:
        """Where on its way the robot is, for people; rows count from 1."""
        if self.route is None:
            return ""
        here = self.rows.here
        if here >= 0:
            return f"past row {here + 1}" if self.rows.is_skipped(here) else f"row {here + 1}"
        following = self.route.next_row
        return f"to row {following + 1}" if following >= 0 else "way"
