"""The robot on one page: read, estimate, perceive, decide, supervise, write, call the taps."""

from __future__ import annotations

from collections.abc import Callable

import msgspec

from agribot.autonomy.control.follower import Follower
from agribot.autonomy.control.hand_drive import HandControl
from agribot.autonomy.control.keep_out_fence import KeepOutFence
from agribot.autonomy.control.obstacle_zone import ObstacleZone
from agribot.autonomy.control.supervise import Supervisor
from agribot.autonomy.estimate.corrections import load_corrections
from agribot.autonomy.estimate.doubts import load_witnesses
from agribot.autonomy.estimate.filter.stem_map import StemMap
from agribot.autonomy.estimate.localizer import Localizer
from agribot.autonomy.estimate.sensors.mapped_rows import MappedRows
from agribot.autonomy.implements.treatment import Treatment
from agribot.autonomy.implements.zones import ZoneMap
from agribot.autonomy.perceive.class_map import ClassMap
from agribot.autonomy.perceive.ground import GroundLookup
from agribot.autonomy.perceive.plants import look
from agribot.autonomy.perceive.scan_obstacles import ScanObstacles
from agribot.autonomy.perceive.segmenter import Segmenter
from agribot.autonomy.perception_host import (
    NewestPerception,
    NoPerception,
    PerceptionHost,
    ThreadedPerception,
)
from agribot.autonomy.plan.coverage.drive import FieldWork
from agribot.autonomy.plan.mission.mission import Mission
from agribot.autonomy.plan.mission.saved_mission import SavedMission
from agribot.autonomy.plan.mission.task import NewTasks, Task
from agribot.autonomy.plan.ways.footprint import measure_footprint
from agribot.autonomy.plan.ways.keep_out import KeepOut
from agribot.autonomy.plan.ways.speed import find_most_mps
from agribot.autonomy.planning_host import ThreadedPlanning
from agribot.autonomy.weeds.map import WeedMap
from agribot.core.config import RunConfig
from agribot.core.fact_text import render
from agribot.core.keep_out import BodyBox
from agribot.core.latch import Latch
from agribot.core.messages import (
    ByteArray,
    CameraFrame,
    Estimate,
    RobotCommand,
    Scene,
    TickRecord,
)
from agribot.core.platform import Platform
from agribot.core.platforms import runs_in_real_time
from agribot.core.robot import RobotSpec

Tap = Callable[[TickRecord], None]
MaskTap = Callable[[int, ByteArray], None]


class Stack:
    """Owns the parts of one run and their order; the parts know nothing of each other."""

    def __init__(
        self,
        scan_obstacles: ScanObstacles,
        localizer: Localizer,
        perception: PerceptionHost,
        weed_map: WeedMap,
        mission: Mission,
        follower: Follower,
        hand: HandControl,
        treatment: Treatment,
        supervisor: Supervisor,
        planning: ThreadedPlanning,
        mask_taps: list[MaskTap],
        plant_spacing_m: float | None = None,
    ) -> None:
        self.scan_obstacles = scan_obstacles
        self.localizer = localizer
        self.perception = perception
        self.weed_map = weed_map
        self.mission = mission
        self.follower = follower
        self.hand = hand
        self.treatment = treatment
        self.supervisor = supervisor
        self._planning = planning
        self._task, self._spacing_m = mission.task, plant_spacing_m
        self.taps: list[Tap] = []
        self.mask_taps = mask_taps  # called in the network's thread

    def tick(self, platform: Platform) -> TickRecord:
        batch = self.scan_obstacles.add(platform.read())
        estimate = self.localizer.update(batch)
        self.weed_map.track_pose(estimate)
        scenes = self.perception.step(batch)
        for scene in scenes:
            if self.localizer.is_stale(scene):
                continue
            self.weed_map.add(scene)
            self.localizer.observe(scene)
            self._explore(scene, estimate)
        takeover = self.hand.update(batch)
        self.treatment.apply_events(batch.requests)
        self.mission.obey_warning(self.supervisor.warning)
        self.mission.free(self.supervisor.stuck)
        self.mission.wait_for(self.supervisor.in_way)
        on_rows = self.mission.relate_to_path(estimate)
        goal = self.mission.step(on_rows, (*batch.requests, *takeover))
        self._follow_task()
        drive, tracking = self.follower.step(on_rows, goal)
        drive, is_by_hand = self.hand.arbitrate(drive, goal.status)
        implement = self.treatment.step(estimate, self.weed_map, goal.tool_on)
        wanted = RobotCommand(t_s=batch.t_s, drive=drive, implement=implement)
        command, fact = self.supervisor.check(
            wanted, estimate, batch, goal, scenes, is_by_hand=is_by_hand
        )
        platform.write(command)
        record = TickRecord(
            batch=batch,
            scenes=scenes,
            estimate=estimate,
            status=msgspec.structs.replace(goal.status, gate=self.supervisor.gate),
            tracking=tracking,
            command=command,
            reason=render(fact),
            is_plan_late=self._planning.pop_late(),
            fact=fact,
        )
        for tap in self.taps:
            tap(record)
        return record

    def _explore(self, scene: Scene, estimate: Estimate) -> None:
        """Show a picture to whatever finds the rows of the task."""
        explorer, pose = self.mission.task.explorer, self.localizer.place(scene.t_s)
        if explorer is not None and pose is not None:
            explorer.see(scene, pose, estimate.pos_std_m)

    def _follow_task(self) -> None:
        """Look for the rows of a field plan that was taken under way."""
        task = self.mission.task
        if task is not self._task:
            self._task = task
            if task.work is not None:
                self.localizer.take_rows(find_rows(task.work, self._spacing_m))

    def close(self) -> None:
        self.perception.close()
        self._planning.close()


def build(
    config: RunConfig,
    robot: RobotSpec,
    task: Task,
    new_tasks: NewTasks | None = None,
    perception: PerceptionHost | None = None,
    saved: SavedMission | None = None,
    zones: ZoneMap | None = None,
    planning: ThreadedPlanning | None = None,
    plants: StemMap | None = None,
) -> Stack:
    """Put the parts together as the settings say.

    `task` is what the robot works at, `new_tasks` makes those that come in under way;
    `perception` replaces the camera network and `planning` the thread that plans, as a replay does;
    `saved` is a mission to go on with, `zones` are those of a prescription, `plants` the crop that
    an earlier run mapped. On a platform that runs in real time neither network nor plan is waited
    for.
    Raises: AgribotError: the settings, the robot and the field do not fit each other.
    """
    if planning is None:
        planning = ThreadedPlanning(waits=not runs_in_real_time(config.platform))
    latch = Latch()
    mask_taps: list[MaskTap] = []

    def show_mask(frame_index: int, class_id: ByteArray) -> None:
        for tap in tuple(mask_taps):
            tap(frame_index, class_id)

    if perception is None:
        perception = perceiving(config, robot, show_mask, find_row_spacing_m(config, task))
    most_mps = find_most_mps(config.safety, robot.drive)
    body = _measure_body(robot)
    return Stack(
        scan_obstacles=ScanObstacles(robot, body),
        localizer=_localize(config, robot, task, plants),
        perception=perception,
        weed_map=WeedMap(config.weeds),
        mission=Mission(task, config.mission, saved, new_tasks, planning, latch, most_mps),
        follower=Follower(config.control, robot),
        hand=HandControl(config.safety),
        treatment=Treatment(config.treatment, robot.implement, zones, config.plugins),
        supervisor=_guard(config, robot, body, latch),
        planning=planning,
        mask_taps=mask_taps,
        plant_spacing_m=config.field.plant_spacing_m,
    )


def _guard(config: RunConfig, robot: RobotSpec, body: BodyBox, latch: Latch) -> Supervisor:
    obstacles = ObstacleZone(config.safety, body, must_report=robot.lidar is not None)
    return Supervisor(config.safety, robot, latch, _fence_out(config, robot, body), obstacles)


def _measure_body(robot: RobotSpec) -> BodyBox:
    shape = measure_footprint(robot, 0.0)
    return BodyBox(shape.front_m, shape.rear_m, shape.half_width_m)


def _fence_out(config: RunConfig, robot: RobotSpec, body: BodyBox) -> KeepOutFence | None:
    """Build the fence around the areas of the settings; None without any."""
    rings = config.field.keep_out_map_m
    if not rings:
        return None
    clearance_m, decel_mps2 = config.mission.obstacle_clearance_m, robot.drive.max_accel_mps2
    return KeepOutFence(KeepOut(rings), body, config.safety, clearance_m, decel_mps2)


def _localize(config: RunConfig, robot: RobotSpec, task: Task, plants: StemMap | None) -> Localizer:
    """Build the filter, and give it what is known of the crop."""
    corrections = load_corrections(config.plugins)
    witnesses = load_witnesses(config.plugins)
    localizer = Localizer(config.estimate, config.field, robot, corrections, witnesses)
    if task.work is not None:
        localizer.take_rows(find_rows(task.work, config.field.plant_spacing_m))
    elif task.explorer is not None or not config.field.has_crop:
        localizer.take_rows(MappedRows(()))
    if plants is not None:
        localizer.take_plants(plants)
    return localizer


def find_rows(work: FieldWork, spacing_m: float | None) -> MappedRows:
    """Take the crop rows of a field plan, and none where it has none, as the filter knows them.

    Plants stand as far apart in them as the field's do.
    """
    return MappedRows(work.area.rows, spacing_m)


def find_row_spacing_m(config: RunConfig, task: Task) -> float | None:
    """Find how far apart the field's rows are; None where they are unknown or from a plan."""
    field = config.field
    is_known = task.work is None and task.explorer is None and field.row_count > 1
    return field.row_pitch_m if is_known and field.has_crop else None


def perceiving(
    config: RunConfig,
    robot: RobotSpec,
    on_mask: MaskTap | None = None,
    row_spacing_m: float | None = None,
) -> PerceptionHost:
    """Put the camera network off the control loop; `on_mask` gets frame indices and class maps.

    `row_spacing_m` is that of the field's rows, None where it is not known.
    """
    settings = config.perception
    if not settings.enabled or robot.camera is None:
        return NoPerception()
    segmenter = Segmenter(settings.model, settings.threads)
    ground = GroundLookup(
        robot.camera, robot.body_from_camera(), segmenter.map_shape, settings.max_range_m,
        row_spacing_m,
    )  # fmt: skip

    def observer(frame: CameraFrame, ready_s: float) -> Scene:
        def show_names(class_map: ClassMap) -> None:
            if on_mask is not None:
                on_mask(frame.index, class_map.class_id)

        class_map = segmenter.segment(frame.image_rgb)
        return look(frame, class_map, ground, settings, ready_s, show_names)

    if runs_in_real_time(config.platform):
        return NewestPerception(observer, settings.latency_s)
    return ThreadedPerception(observer, settings.latency_s)
