"""One run from settings to report: platform, stack and all that listens to them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from typing import Any, Self

import msgspec
import numpy as np

from agribot.app import whole_job
from agribot.app.judge import Judge
from agribot.app.mission_file import MissionFile
from agribot.app.report_card import report_card
from agribot.app.run_clock import Clock
from agribot.app.run_folder import RunFolder
from agribot.app.run_recording import ENDED, RunRecording, files_to_run_again
from agribot.app.run_setup import PLAN_FILE, RunSetup
from agribot.app.unattended import Unattended
from agribot.app.whole_job import WholeJob
from agribot.autonomy.control.fence import measure_growth_m
from agribot.autonomy.perception_host import PerceptionMeter
from agribot.autonomy.plan.coverage.tool_gaps import describe_gaps
from agribot.autonomy.plan.mission.row_log import RowResult
from agribot.autonomy.plan.mission.task import Task
from agribot.autonomy.plan.ways.rows import list_row_ends
from agribot.autonomy.plan.ways.speed import find_most_mps, warn_of_speeds
from agribot.autonomy.stack import MaskTap, Stack, Tap
from agribot.autonomy.weeds.map import WeedMap
from agribot.core import config as settings
from agribot.core.errors import RecordingError
from agribot.core.facts import Part
from agribot.core.implement.kind import ReportLine
from agribot.core.messages import (
    AskerKind,
    ControlMission,
    Inbox,
    MappedPlant,
    MapPoint,
    Row,
    TickRecord,
    Vec3,
    Who,
)
from agribot.core.messages import Path as PlannedPath
from agribot.core.platform import MixedPlatform, Platform, SensorSource, TrueState
from agribot.core.row_shape import row_length_m
from agribot.description.loader import export_urdf
from agribot.gis.drawn_field import DrawnRow, format_drawn_field
from agribot.record.events import Event, EventLog
from agribot.record.report import Report, to_json, write_file
from agribot.record.run_figures import HURRIED, explain_absence
from agribot.record.run_files import write_run_files
from agribot.record.series import RunData, RunSeries, SeriesTap

SESSION = Who("session", AskerKind.PROGRAM)
COMING_TO_REST_S = 2.0
REST_TICKS = 5  # a robot that rocks back passes through standstill


class Run:
    """A stack that drives a platform, simulated or real, and the files and taps of that drive.

    Everything is open before the robot may move, so that bad input is refused at rest. Use it as
    a context: `ticks()` drives, `finish()` writes the files of the run.
    """

    def __init__(
        self,
        setup: RunSetup,
        platform: Platform,
        stack: Stack,
        taps: Sequence[Tap] = (),
        judge: Judge | None = None,
    ) -> None:
        """`taps` come before those of the run itself; `judge` knows the truth, where anybody does.

        Raises: AgribotError: the disk takes no files, or the folder holds a run.
        """
        self.config, self.out_dir = setup.config, setup.out_dir
        self.robot, self.platform, self.stack = setup.robot, platform, stack
        self.notes, self._setup_warnings = setup.notes, setup.warnings
        self.judge = judge
        self._plan_text, self._first_taps = setup.plan_text, tuple(taps)
        self._task = self.task
        saved, earlier = setup.saved, setup.earlier
        self.rows_before = whole_job.rows_only_believed(saved, earlier)
        self.clock = Clock()
        is_unknown = saved is not None and earlier is whole_job.NOTHING
        self.job = WholeJob(self, whole_job.UNKNOWN if is_unknown else earlier)
        self.last: TickRecord | None = None
        self.trouble_taps: list[Callable[[str], None]] = []
        self._closing = ExitStack()
        self.is_written = True  # every file of the run's end could be written
        before = whole_job.plants_before(earlier)
        files = files_to_run_again(
            setup.goals_map_m, saved, before, setup.plan_text, setup.prescription, setup.plants
        )
        self._open_all_files(files, setup.plan_text if setup.is_plan_new else "")

    def _open_all_files(self, recorded: Mapping[str, tuple[str, bytes]], new_plan: str) -> None:
        """Open all files or none: then the folder is as it was before, and can be tried again."""
        self._files = ExitStack()
        try:
            self._open_files(recorded, new_plan)
        except BaseException:
            self.__exit__()
            raise

    def _open_files(self, recorded: Mapping[str, tuple[str, bytes]], new_plan: str) -> None:
        out_dir = self.out_dir
        self._folder = RunFolder(out_dir)
        self._files.callback(self._leave_folder)
        if new_plan:
            write_file(out_dir / PLAN_FILE, new_plan.encode())
        self.event_log = EventLog(out_dir / "events.jsonl", self._say)
        self._files.callback(self.event_log.close)
        self._series = SeriesTap()
        self._report_disk = partial(self.report_problem, parts=("disk",))
        self.recording = RunRecording(self, recorded, self._report_disk)
        self._files.callback(self.recording.close)
        self._mission_file = MissionFile(out_dir, self.stack.mission, self._report_disk)
        self._files.callback(self._mission_file.close)
        self.stack.taps += [*self._first_taps, self._series, self.event_log]
        self._job_file = MissionFile(out_dir, self.job, self._report_disk, whole_job.FILE_NAME)
        self._files.callback(self._job_file.close)
        self.unattended = Unattended(self.config.mission.stall_timeout_s)
        self.stack.taps += [self._mission_file, self.job, self._job_file]
        self.stack.taps += [self.recording, self._follow_task, self.unattended]
        self._write_config()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with self._closing:
            self.platform.close()
            self.stack.close()
            self._files.close()

    def add_close(self, close: Callable[[], None]) -> None:
        """Let this be called after everything else is closed."""
        self._closing.callback(close)

    def _leave_folder(self) -> None:
        if self.last is None:
            self._folder.give_back()
        else:
            self._folder.close()

    @property
    def inbox(self) -> Inbox:
        """Requests of people and programs to the robot; any thread may post."""
        return self.platform.inbox

    @property
    def imu_bias(self) -> Callable[[], tuple[Vec3, Vec3]] | None:
        """True biases of accelerometer and gyro, for those who show them; None: unknown."""
        return None

    @property
    def truth(self) -> Callable[[], TrueState] | None:
        """The true state of the robot, to be shown; None where unknown."""
        return None

    @property
    def conditions(self) -> dict[str, Any] | None:
        """Values drawn for the simulated world, for the report; None of a real one."""
        return None

    @property
    def warnings(self) -> tuple[str, ...]:
        """Oddities of the robot or earlier runs that do not keep it from driving."""
        lost = (f"of the job's earlier runs is lost: {what}" for what in self.job.lacks)
        most_mps = find_most_mps(self.config.safety, self.robot.drive)
        speeds = warn_of_speeds(self.config.mission, most_mps)
        work = self.task.work
        gaps = describe_gaps(work.legs, work.area, work.request, self.robot) if work else ()
        return (*self.robot.warnings, *self._setup_warnings, *lost, *speeds, *gaps)

    def take_sensors(self, sources: Sequence[SensorSource]) -> None:
        """Let sensors from elsewhere stand in for the platform's own; before the first tick."""
        self.platform = MixedPlatform(self.platform, sources)

    @property
    def task(self) -> Task:
        return self.stack.mission.task

    @property
    def rows(self) -> tuple[Row, ...]:
        """Rows of the task: crop rows, or the swaths of a field plan."""
        return tuple(self.task.rows)

    @property
    def row_results(self) -> tuple[RowResult, ...]:
        """Results of the rows, by the robot's own account."""
        return self.stack.mission.row_results

    @property
    def goals_map_m(self) -> tuple[MapPoint, ...]:
        """Waypoints of the task; none for a task of rows."""
        return tuple(self.task.waypoints)

    @property
    def shown_goals_map_m(self) -> tuple[MapPoint, ...]:
        """The waypoints, or both ends of every row: what a map shows as goals."""
        return self.goals_map_m or list_row_ends(self.rows)

    @property
    def planned_path(self) -> PlannedPath | None:
        return self.stack.mission.path

    @property
    def finds_rows(self) -> bool:
        """Whether the robot finds its rows by itself."""
        return self.task.explorer is not None

    def plants(self) -> tuple[MappedPlant, ...]:
        return self.weed_map.export_plants()

    @property
    def weed_map(self) -> WeedMap:
        return self.stack.weed_map

    @property
    def implement_lines(self) -> tuple[ReportLine, ...]:
        return self.stack.treatment.report()

    @property
    def urdf(self) -> str:
        """The robot's description with everything expanded."""
        return export_urdf(self.config.robot)

    @property
    def meter(self) -> PerceptionMeter | None:
        return self.stack.perception.meter

    def worked_area_m2(self, rows: tuple[int, ...]) -> float:
        """Ground of the given rows, as wide as they are apart or as the implement works."""
        work, field = self.task.work, self.config.field
        length_m = sum(row_length_m(row) for row in self.rows if row.index in rows)
        if work is None:
            return length_m * field.row_pitch_m
        planned_m, implement = work.request.implement_width_m, self.robot.implement
        return length_m * (planned_m if implement is None else min(planned_m, implement.width_m))

    def add_tap(self, tap: Tap) -> None:
        self.stack.taps.append(tap)

    def add_mask_tap(self, tap: MaskTap) -> None:
        """`tap(frame_index, class_id)` is called in the network's thread."""
        self.stack.mask_taps.append(tap)

    def ticks(self) -> Iterator[TickRecord]:
        """Drive until the mission ends, the time allowed is over, or a stop is not cleared."""
        self.clock.start()
        while not (self._has_ended() or self._is_time_over() or self.unattended.why_ended):
            yield self._tick()
        self.clock.stop()

    def idle(self) -> Iterator[TickRecord]:
        """Go on after `finish`, for as long as the caller wants: the robot can be driven by hand.

        The report is made and its recording closed by then; events are still logged, another
        recording may be begun, and the robot drives to places and takes new plans.
        """
        over = (self.judge, self._series, self.job, self._job_file)
        self.stack.taps = [tap for tap in self.stack.taps if tap not in over]
        self.stack.mission.stay_open()
        while True:
            yield self._tick()

    def finish(self, why_ended: str = "", may_draw: Callable[[], bool] | None = None) -> Report:
        """Bring the robot to rest, write every file of the run and return the report.

        `why_ended` names an end from outside, such as an interruption. Where `may_draw` says no,
        the figures are left out, which take seconds.
        """
        if not self._has_ended() and not why_ended and self.last is not None:
            as_asked = f"stopped after {self.config.duration_s or 0.0:g} s, as asked"
            why_ended = self.unattended.why_ended or as_asked
        self.come_to_rest()
        self.clock.stop()
        self.stack.perception.settle()  # the last frame counts in every run
        self._job_file.write()
        data = self._data()
        report = report_card(self, why_ended)
        self.recording.attach("report.json", "application/json", to_json(report))
        self.recording.close()
        try:
            write_run_files(self.out_dir, report, data, may_draw)
        except RecordingError as error:
            self.report_problem(self.last.batch.t_s if self.last is not None else 0.0, str(error))
            self.is_written = False
        if left_out := explain_absence() or (HURRIED if may_draw and not may_draw() else ""):
            self._say(left_out)
        return report

    def _draw_field(self, series: RunSeries) -> str:
        """Draw the rows that the robot found; empty where it found none."""
        explorer = self.task.explorer
        rows = explorer.draw() if explorer is not None else []
        if not rows:
            return ""
        track = np.column_stack([series.x_map_m, series.y_map_m])
        drawn = [DrawnRow(line, std_m) for line, std_m in rows]
        unsure_m = self._measure_fence_growth_m(series)
        return format_drawn_field(drawn, track, self.config.field.datum, unsure_m)

    def _measure_fence_growth_m(self, series: RunSeries) -> float:
        """Measure how far from an edge the fence would have kept the robot while it drove."""
        std_m = series.pos_std_m[(series.commanded_mps != 0.0) & np.isfinite(series.pos_std_m)]
        if self.last is None or not len(std_m):
            return 0.0
        quality = self.last.estimate.quality
        return max(0.0, measure_growth_m(float(np.max(std_m)), quality, self.config.safety))

    def _tick(self) -> TickRecord:
        self.last = self.stack.tick(self.platform)
        return self.last

    def _has_ended(self) -> bool:
        waits = self.config.mission.waits_for_goals
        return not waits and self.last is not None and self.last.status.state in ENDED

    def _is_time_over(self) -> bool:
        limit_s = self.config.duration_s
        return limit_s is not None and self.last is not None and self.last.batch.t_s >= limit_s

    def come_to_rest(self) -> None:
        """Cancel what is left of the mission, let no hand drive on, and wait for the wheels."""
        if self.last is None:
            return
        t_s = self.last.batch.t_s
        if not self._has_ended():
            self.inbox.post(ControlMission(action="cancel"), SESSION)
        self.inbox.takes_hands = False
        try:
            self._tick()
            still = 0
            while still < REST_TICKS and self.last.batch.t_s < t_s + COMING_TO_REST_S:
                self._tick()
                still = still + 1 if abs(self.last.estimate.v_mps) <= 0.01 else 0
        finally:
            self.inbox.takes_hands = True

    def _write_config(self) -> None:
        write_file(self.out_dir / "config.toml", settings.to_toml(self.config).encode())

    def report_problem(self, t_s: float, text: str, parts: tuple[Part, ...] = ()) -> None:
        """Report what goes wrong beside the drive, which goes on."""
        self._say(text)
        self.event_log.add(Event(t_s=t_s, kind="fault", reason=text, parts=parts))

    def _say(self, text: str) -> None:
        for hear in self.trouble_taps:
            hear(text)

    def _follow_task(self, record: TickRecord) -> None:
        """Score and show a task that was taken under way, instead of the one before it."""
        task = self.task
        if task is self._task:
            return
        self._task, self.rows_before = task, ()
        if self.judge is not None:
            self.judge.set_task(self.rows, self.goals_map_m)
        if task.work is None:
            return
        path = self.out_dir / PLAN_FILE
        self.config = msgspec.structs.replace(self.config, plan=str(path), waypoints="")
        try:
            write_file(path, task.text.encode())
            self._write_config()
        except RecordingError as error:
            self.report_problem(record.batch.t_s, str(error))

    def _data(self) -> RunData:
        series = self.job.series(self._series.series())
        return RunData(
            config=self.config,
            series=series,
            drawn_field=self._draw_field(series),
            rows=self.rows,
            zones=self.stack.treatment.zones,
            plan=self.stack.mission.path,
            goals_map_m=self.shown_goals_map_m,
            plants=self.job.plants(self.plants()),
            events=self.job.events(self.event_log.events),
        )
