"""One simulated run from settings to report: platform, stack and all that listens to them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Self

import msgspec

from agribot import config as settings
from agribot import stack as robot_stack
from agribot.calibration.believed import calibrated
from agribot.config import RunConfig
from agribot.description.loader import load_robot, urdf_text
from agribot.description.worlds_sdf import world_of_run
from agribot.errors import RecordingError
from agribot.field_work import field_work, read_plan_text
from agribot.mapped_plant import MappedPlant
from agribot.messages import ByteArray, OperatorEvent, Row, TickRecord
from agribot.messages import Path as PlannedPath
from agribot.mission_file import MissionFile
from agribot.perception_host import PerceptionMeter
from agribot.plan.saved_mission import SavedMission
from agribot.plan.task import Task
from agribot.platform import Platform
from agribot.record.events import Event, EventLog
from agribot.record.report import Report, to_json, write_file
from agribot.record.run_files import write_run_files
from agribot.record.series import RunData, SeriesTap
from agribot.report_card import Clock, report_card
from agribot.row_shape import row_length_m
from agribot.run_recording import RunRecording
from agribot.sim.platform import SimPlatform
from agribot.sim.referee import Referee
from agribot.stack import MaskTap, Tap
from agribot.tasks import MapPoint, read_goals, row_ends
from agribot.weeds.map import WeedMap

ENDED = ("done", "cancelled", "failed")
COMING_TO_REST_S = 2.0
REST_TICKS = 5  # a robot that rocks back passes through standstill
GOALS_ATTACHMENT = "goals.json"
PLAN_ATTACHMENT = "plan.geojson"
SAVED_ATTACHMENT = "resumed.json"  # null in a run that began anew


class Session:
    """Opens everything before the robot may move, so that bad input is refused at rest.

    Use it as a context: `ticks()` drives, `finish()` writes the files of the run.
    """

    def __init__(self, config: RunConfig, out_dir: Path, saved: SavedMission | None = None) -> None:
        """`saved` is a mission to go on with; the simulated robot stands where it was left.

        Raises: AgribotError: something in the settings or on the disk does not fit.
        """
        self.config = config
        self.out_dir = out_dir
        described = load_robot(config.robot)
        self.robot = calibrated(described, config.calibration)
        goals_map_m = read_goals(config)
        self._plan_text = read_plan_text(config)
        self.world = world_of_run(config)
        if saved is not None:
            self.world = msgspec.structs.replace(
                self.world, spawn_xy_map_m=saved.pose[:2], spawn_yaw_map_rad=saved.pose[2]
            )
        self._saved = saved
        self.rows_before = tuple(r.index for r in saved.rows if r.done) if saved else ()
        self.platform = SimPlatform(config, described, self.world, board=self.robot.drive)
        self.sensed: Platform = self.platform  # with sensors from elsewhere, if any
        self._mask_taps: list[MaskTap] = []
        perception = robot_stack.perceiving(config, self.robot, self._show_mask)
        work = field_work(self._plan_text, config, self.robot)
        self.stack = robot_stack.build(config, self.robot, goals_map_m, perception, work, saved)
        is_visit = saved is not None and bool(saved.visit_name)
        self._task = None if is_visit else self.task
        self.referee = Referee(self.platform, self.world, self.rows, self.goals_map_m)
        self._mask_taps.append(self.referee.judge_mask)
        self.clock = Clock()
        self.last: TickRecord | None = None
        self._claim_out_dir()
        self.event_log = EventLog(out_dir / "events.jsonl")
        self._series = SeriesTap()
        self.recording = RunRecording(self, self._attached(goals_map_m), self._tell)
        self._mission_file = MissionFile(out_dir, self.stack.mission)
        self.stack.taps += [self._show_truth, self.referee, self._series, self.event_log]
        self.stack.taps += [self._mission_file, self.recording, self._follow_task]
        self._write_config()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.platform.close()
        self.stack.close()
        self.event_log.close()
        self.recording.close()
        self._mission_file.close()

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
        """Drive until the mission ends or the time allowed is over."""
        self.clock.start()
        while not self._has_ended() and not self._is_time_over():
            yield self._tick()
        self.clock.stop()

    def idle(self) -> Iterator[TickRecord]:
        """Go on after `finish`, for as long as the caller wants: the robot can be driven by hand.

        The report is made and its recording closed by then; events are still logged, another
        recording may be begun, and the robot drives to places and takes new plans.
        """
        over = (self.referee, self._series)
        self.stack.taps = [tap for tap in self.stack.taps if tap not in over]
        self.stack.mission.stay_open()
        while True:
            yield self._tick()

    def finish(self, why_ended: str = "") -> Report:
        """Bring the robot to rest, write every file of the run and return the report.

        `why_ended` names an end from outside, such as an interruption.
        """
        if not self._has_ended() and not why_ended and self.last is not None:
            why_ended = f"stopped after {self.config.duration_s:g} s, as asked"
        self._come_to_rest()
        self.clock.stop()
        self.stack.perception.settle()  # the last frame counts in every run
        report = report_card(self, why_ended)
        self.recording.attach("report.json", "application/json", to_json(report))
        self.recording.close()
        write_run_files(self.out_dir, report, self._data())
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

    def _claim_out_dir(self) -> None:
        try:
            self.out_dir.mkdir(parents=True, exist_ok=True)
            probe = self.out_dir / "events.jsonl"
            probe.touch()
        except OSError as error:
            raise RecordingError(
                f"cannot write into {self.out_dir}: {error.strerror}; choose another --out folder"
            ) from error

    def _attached(self, goals_map_m: tuple[MapPoint, ...]) -> dict[str, tuple[str, bytes]]:
        """What a recording needs to be run again."""
        files = {
            GOALS_ATTACHMENT: ("application/json", msgspec.json.encode(goals_map_m)),
            SAVED_ATTACHMENT: ("application/json", msgspec.json.encode(self._saved)),
        }
        if self._plan_text:
            files[PLAN_ATTACHMENT] = ("application/geo+json", self._plan_text.encode())
        return files

    def _tell(self, t_s: float, text: str) -> None:
        self.event_log.add(Event(t_s=t_s, kind="fault", reason=text))

    def _follow_task(self, _: TickRecord) -> None:
        """A task taken under way is judged and shown, a plan also resumed, in place of the old."""
        task = self.task
        if task is self._task:
            return
        self._task, self.rows_before = task, ()
        self.referee.judge_anew(self.rows, self.goals_map_m)
        if task.work is None:
            return
        path = self.out_dir / "plan.geojson"
        write_file(path, task.text.encode())
        self.config = msgspec.structs.replace(self.config, plan=str(path), waypoints="")
        self._write_config()

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
            series=self._series.series(),
            rows=self.rows,
            plan=self.stack.mission.path,
            goals_map_m=self.shown_goals_map_m,
            plants=self.weed_map.plants(),
            events=self.event_log.events,
            world=self.world,
        )
