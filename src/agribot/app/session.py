"""One simulated run from settings to report: platform, stack and all that listens to them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Self

import msgspec

from agribot.app import whole_job
from agribot.app.calibration.believed import calibrated
from agribot.app.field_work import field_work, read_plan_text
from agribot.app.mission_file import MissionFile
from agribot.app.report_card import report_card
from agribot.app.robot_stack import build_stack
from agribot.app.run_clock import Clock
from agribot.app.run_folder import RunFolder
from agribot.app.run_recording import RunRecording, files_to_run_again
from agribot.app.tasks import read_goals
from agribot.app.unattended import Unattended
from agribot.app.whole_job import JobSoFar, WholeJob
from agribot.autonomy.perception_host import PerceptionMeter
from agribot.autonomy.plan.rows import row_ends
from agribot.autonomy.plan.saved_mission import SavedMission
from agribot.autonomy.plan.task import Task
from agribot.autonomy.stack import MaskTap, Tap, perceiving
from agribot.autonomy.weeds.map import WeedMap
from agribot.core import config as settings
from agribot.core.config import RunConfig
from agribot.core.errors import RecordingError
from agribot.core.messages import ByteArray, MappedPlant, MapPoint, OperatorEvent, Row, TickRecord
from agribot.core.messages import Path as PlannedPath
from agribot.core.platform import Platform
from agribot.core.row_shape import row_length_m
from agribot.description.loader import load_robot, urdf_text
from agribot.description.worlds_sdf import world_of_run
from agribot.record.events import Event, EventLog
from agribot.record.report import Report, to_json, write_file
from agribot.record.run_files import write_run_files
from agribot.record.series import RunData, SeriesTap

ENDED = ("done", "cancelled", "failed")
COMING_TO_REST_S = 2.0
PLAN_FILE = "plan.geojson"
REST_TICKS = 5  # a robot that rocks back passes through standstill


class Session:
    """Opens everything before the robot may move, so that bad input is refused at rest.

    Use it as a context: `ticks()` drives, `finish()` writes the files of the run.
    """

    def __init__(
        self,
        config: RunConfig,
        out_dir: Path,
        saved: SavedMission | None = None,
        earlier: JobSoFar = whole_job.NOTHING,
        plan_text: str = "",
    ) -> None:
        """`saved` is a mission to go on with; the simulated robot stands where it was left.

        `earlier` is what the runs before did of the job; the report then tells of all of it.
        `plan_text` is a field plan that is in no file yet: the run keeps it in its folder.

        Raises: AgribotError: something in the settings or on the disk does not fit, or the folder
            holds a run.
        """
        from agribot.sim.platform import SimPlatform
        from agribot.sim.referee import Referee

        if plan_text:
            config = msgspec.structs.replace(config, plan=str(out_dir / PLAN_FILE))
        self.config, self.out_dir = config, out_dir
        described = load_robot(config.robot)
        self.robot = calibrated(described, config.calibration)
        goals_map_m = read_goals(config)
        self._plan_text = plan_text or read_plan_text(config)
        self.world = world_of_run(config)
        if saved is not None:
            self.world = msgspec.structs.replace(
                self.world, spawn_xy_map_m=saved.pose[:2], spawn_yaw_map_rad=saved.pose[2]
            )
        self.platform = SimPlatform(config, described, self.world, board=self.robot.drive)
        self.sensed: Platform = self.platform  # with sensors from elsewhere, if any
        self._mask_taps: list[MaskTap] = []
        perception = perceiving(config, self.robot, self._show_mask)
        work = field_work(self._plan_text, config, self.robot)
        self.stack = build_stack(config, self.robot, goals_map_m, perception, work, saved)
        self._task = self.task
        self.rows_before = whole_job.rows_only_believed(saved, earlier)
        self.referee = Referee(self.platform, self.world, self.rows, self.goals_map_m)
        self._mask_taps.append(self.referee.judge_mask)
        self.clock = Clock()
        is_unknown = saved is not None and earlier is whole_job.NOTHING
        self.job = WholeJob(self, whole_job.UNKNOWN if is_unknown else earlier)
        self.last: TickRecord | None = None
        self.trouble_taps: list[Callable[[str], None]] = []
        self.is_written = True  # every file of the run's end could be written
        before = whole_job.plants_before(earlier)
        files = files_to_run_again(goals_map_m, saved, before, self._plan_text)
        self._open_all_files(files, plan_text)

    def _open_all_files(self, recorded: Mapping[str, tuple[str, bytes]], new_plan: str) -> None:
        """Or none of them: the folder is as it was before, and can be tried again."""
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
        self.recording = RunRecording(self, recorded, self._tell)
        self._files.callback(self.recording.close)
        self._mission_file = MissionFile(out_dir, self.stack.mission, self._tell)
        self._files.callback(self._mission_file.close)
        self.stack.taps += [self._show_truth, self.referee, self._series, self.event_log]
        self._job_file = MissionFile(out_dir, self.job, self._tell, whole_job.FILE_NAME)
        self._files.callback(self._job_file.close)
        self.unattended = Unattended(self.config.mission.stall_timeout_s)
        self.stack.taps += [self._mission_file, self.job, self._job_file]
        self.stack.taps += [self.recording, self._follow_task, self.unattended]
        self._write_config()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.platform.close()
        self.stack.close()
        self._files.close()

    def _leave_folder(self) -> None:
        if self.last is None:
            self._folder.give_back()
        else:
            self._folder.close()

    @property
    def task(self) -> Task:
        return self.stack.mission.task

    @property
    def rows(self) -> tuple[Row, ...]:
        """Of the task: crop rows, or the swaths of a field plan."""
        return tuple(self.task.rows)

    @property
    def goals_map_m(self) -> tuple[MapPoint, ...]:
        """Of the task: the waypoints, none where it is rows."""
        return tuple(self.task.waypoints)

    @property
    def shown_goals_map_m(self) -> tuple[MapPoint, ...]:
        """The waypoints, or both ends of every row: what a map shows as goals."""
        return self.goals_map_m or row_ends(self.rows)

    @property
    def planned_path(self) -> PlannedPath | None:
        return self.stack.mission.path

    def plants(self) -> tuple[MappedPlant, ...]:
        return self.weed_map.plants()

    @property
    def weed_map(self) -> WeedMap:
        return self.stack.weed_map

    @property
    def urdf(self) -> str:
        """The robot's description with everything expanded."""
        return urdf_text(self.config.robot)

    @property
    def meter(self) -> PerceptionMeter | None:
        return self.stack.perception.meter

    def worked_area_m2(self, rows: tuple[int, ...]) -> float:
        """Ground of the given rows, as wide as they are apart or as the implement is."""
        work, field = self.task.work, self.config.field
        length_m = sum(row_length_m(row) for row in self.rows if row.index in rows)
        return length_m * (field.row_pitch_m if work is None else work.request.implement_width_m)

    def add_tap(self, tap: Tap) -> None:
        self.stack.taps.append(tap)

    def add_mask_tap(self, tap: MaskTap) -> None:
        """`tap(frame_index, class_id)` is called in the network's thread."""
        self._mask_taps.append(tap)

    def ticks(self) -> Iterator[TickRecord]:
        """Drive until the mission ends, the time allowed is over, or nobody clears a stop."""
        self.clock.start()
        while not (self._has_ended() or self._is_time_over() or self.unattended.why_ended):
            yield self._tick()
        self.clock.stop()

    def idle(self) -> Iterator[TickRecord]:
        """Go on after `finish`, for as long as the caller wants: the robot can be driven by hand.

        The report is made and its recording closed by then; events are still logged, another
        recording may be begun, and the robot drives to places and takes new plans.
        """
        over = (self.referee, self._series, self.job, self._job_file)
        self.stack.taps = [tap for tap in self.stack.taps if tap not in over]
        self.stack.mission.stay_open()
        while True:
            yield self._tick()

    def finish(self, why_ended: str = "") -> Report:
        """Bring the robot to rest, write every file of the run and return the report.

        `why_ended` names an end from outside, such as an interruption.
        """
        if not self._has_ended() and not why_ended and self.last is not None:
            as_asked = f"stopped after {self.config.duration_s or 0.0:g} s, as asked"
            why_ended = self.unattended.why_ended or as_asked
        self._come_to_rest()
        self.clock.stop()
        self.stack.perception.settle()  # the last frame counts in every run
        self._job_file.write()
        data = self._data()
        report = report_card(self, why_ended)
        self.recording.attach("report.json", "application/json", to_json(report))
        self.recording.close()
        try:
            write_run_files(self.out_dir, report, data)
        except RecordingError as error:
            self._tell(self.last.batch.t_s if self.last is not None else 0.0, str(error))
            self.is_written = False
        return report

    def _tick(self) -> TickRecord:
        self.last = self.stack.tick(self.sensed)
        return self.last

    def _has_ended(self) -> bool:
        waits = self.config.mission.waits_for_goals
        return not waits and self.last is not None and self.last.status.state in ENDED

    def _is_time_over(self) -> bool:
        limit_s = self.config.duration_s
        return limit_s is not None and self.last is not None and self.last.batch.t_s >= limit_s

    def _come_to_rest(self) -> None:
        """Cancel what is left of the mission and wait for the wheels."""
        if self.last is None:
            return
        t_s = self.last.batch.t_s
        if not self._has_ended():
            self.platform.post(OperatorEvent(t_s=t_s, action="cancel", source="session"))
        self._tick()
        still = 0
        while still < REST_TICKS and self.last.batch.t_s < t_s + COMING_TO_REST_S:
            self._tick()
            still = still + 1 if abs(self.last.estimate.v_mps) <= 0.01 else 0

    def _write_config(self) -> None:
        write_file(self.out_dir / "config.toml", settings.to_toml(self.config).encode())

    def _tell(self, t_s: float, text: str) -> None:
        """What goes wrong beside the drive: it goes on, and everybody hears of it at once."""
        self._say(text)
        self.event_log.add(Event(t_s=t_s, kind="fault", reason=text))

    def _say(self, text: str) -> None:
        for hear in self.trouble_taps:
            hear(text)

    def _follow_task(self, record: TickRecord) -> None:
        """A task taken under way is judged and shown, a plan also resumed, in place of the old."""
        task = self.task
        if task is self._task:
            return
        self._task, self.rows_before = task, ()
        self.referee.judge_anew(self.rows, self.goals_map_m)
        if task.work is None:
            return
        path = self.out_dir / PLAN_FILE
        self.config = msgspec.structs.replace(self.config, plan=str(path), waypoints="")
        try:
            write_file(path, task.text.encode())
            self._write_config()
        except RecordingError as error:
            self._tell(record.batch.t_s, str(error))

    def _show_mask(self, frame_index: int, class_id: ByteArray) -> None:
        for tap in self._mask_taps:
            tap(frame_index, class_id)

    def _show_truth(self, record: TickRecord) -> None:
        truth = self.platform.truth()
        pose = (truth.x_map_m, truth.y_map_m, truth.yaw_map_rad)
        self._series.truth(record.batch.t_s, pose)
        self.recording.truth(record.batch.t_s, pose, (truth.v_mps, truth.yaw_rate_radps))

    def _data(self) -> RunData:
        return RunData(
            config=self.config,
            series=self.job.series(self._series.series()),
            rows=self.rows,
            plan=self.stack.mission.path,
            goals_map_m=self.shown_goals_map_m,
            plants=self.job.plants(self.weed_map.plants()),
            events=self.job.events(self.event_log.events),
            world=self.world,
        )
