"""The robot on one page: read, estimate, perceive, decide, supervise, write, tell the taps."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from agribot.config import RunConfig
from agribot.control.follower import Follower
from agribot.control.hand_drive import HandControl
from agribot.control.supervise import Supervisor
from agribot.estimate.localizer import Localizer
from agribot.messages import (
    ByteArray,
    CameraFrame,
    Estimate,
    FloatArray,
    Path,
    RobotCommand,
    Row,
    Scene,
    TickRecord,
)
from agribot.perceive.ground import GroundLookup
from agribot.perceive.plants import observe
from agribot.perceive.segmenter import Segmenter
from agribot.perception_host import NoPerception, PerceptionHost, ThreadedPerception
from agribot.plan.boustrophedon import plan_home, plan_rows
from agribot.plan.certify import certify
from agribot.plan.coverage.drive import FieldWork
from agribot.plan.errands import Errands
from agribot.plan.mission import Mission
from agribot.plan.rows import field_rows
from agribot.plan.saved_mission import PoseTuple, SavedMission
from agribot.plan.waypoints import plan_waypoints
from agribot.platform import Platform
from agribot.robot import RobotSpec
from agribot.weeds.map import WeedMap
from agribot.weeds.treatment import Treatment

Tap = Callable[[TickRecord], None]
MaskTap = Callable[[int, ByteArray], None]
MapPoint = tuple[float, float]


class Stack:
    """Owns the parts of one run and their order; the parts know nothing of each other."""

    def __init__(
        self,
        localizer: Localizer,
        perception: PerceptionHost,
        weed_map: WeedMap,
        mission: Errands,
        follower: Follower,
        hand: HandControl,
        treatment: Treatment,
        supervisor: Supervisor,
    ) -> None:
        self.localizer = localizer
        self.perception = perception
        self.weed_map = weed_map
        self.mission = mission
        self.follower = follower
        self.hand = hand
        self.treatment = treatment
        self.supervisor = supervisor
        self.taps: list[Tap] = []

    def tick(self, platform: Platform) -> TickRecord:
        batch = platform.read()
        estimate = self.localizer.update(batch)
        self.weed_map.track_pose(estimate)
        scenes = self.perception.step(batch)
        for scene in scenes:
            self.weed_map.add(scene)
            self.localizer.see(scene)
        takeover = self.hand.listen(batch)
        self.treatment.listen(batch.events)
        goal = self.mission.step(estimate, (*batch.events, *takeover))
        drive, tracking = self.follower.step(estimate, goal)
        drive, is_by_hand = self.hand.arbitrate(drive, goal.status)
        implement = self.treatment.step(estimate, self.weed_map, goal.tool_on)
        wanted = RobotCommand(t_s=batch.t_s, drive=drive, implement=implement)
        command, reason = self.supervisor.check(
            wanted, estimate, batch, goal, is_by_hand=is_by_hand
        )
        platform.write(command)
        record = TickRecord(
            batch=batch,
            scenes=scenes,
            estimate=estimate,
            status=goal.status,
            tracking=tracking,
            command=command,
            reason=reason,
        )
        for tap in self.taps:
            tap(record)
        return record

    def close(self) -> None:
        self.perception.close()


def build(
    config: RunConfig,
    robot: RobotSpec,
    waypoints_map_m: tuple[MapPoint, ...] = (),
    perception: PerceptionHost | None = None,
    work: FieldWork | None = None,
    saved: SavedMission | None = None,
) -> Stack:
    """Put the parts together as the settings say.

    `waypoints_map_m` or `work`, a field plan, replaces the rows of the field as the task;
    `perception` replaces the camera network, as a replay does; `saved` is a mission to go on with.
    Raises: AgribotError: the settings, the robot and the field do not fit each other.
    """
    return Stack(
        localizer=Localizer(config.estimate, config.field, robot),
        perception=perceiving(config, robot) if perception is None else perception,
        weed_map=WeedMap(config.weeds),
        mission=Errands(
            _mission(config, robot, waypoints_map_m, work, saved),
            _visiting(config, robot, waypoints_map_m, work),
            waits=config.mission.waits_for_goals,
        ),
        follower=Follower(config.control, robot),
        hand=HandControl(config.safety),
        treatment=Treatment(config.treatment, robot.sprayer),
        supervisor=Supervisor(config.safety, robot),
    )


def perceiving(
    config: RunConfig, robot: RobotSpec, on_mask: MaskTap | None = None
) -> PerceptionHost:
    """The camera network off the control loop; `on_mask` hears every frame index and class map."""
    settings = config.perception
    if not settings.enabled or robot.camera is None:
        return NoPerception()
    segmenter = Segmenter(settings.model, settings.threads)
    ground = GroundLookup(
        robot.camera, robot.body_from_camera(), segmenter.map_shape, settings.max_range_m
    )

    def observer(frame: CameraFrame, ready_s: float) -> Scene:
        class_map = segmenter.segment(frame.image_rgb)
        if on_mask is not None:
            on_mask(frame.index, class_map.class_id)
        return observe(frame, class_map, ground, settings, ready_s)

    return ThreadedPerception(observer, settings.latency_s)


def _mission(
    config: RunConfig,
    robot: RobotSpec,
    waypoints_map_m: tuple[MapPoint, ...],
    work: FieldWork | None,
    saved: SavedMission | None,
) -> Mission:
    if work is not None:
        return Mission(
            lambda estimate: work.path_from(
                (estimate.x_map_m, estimate.y_map_m, estimate.yaw_map_rad)
            ),
            work.rows,
            config.mission,
            tool_reach_m=0.0,
            has_crop=work.has_crop,
            home=lambda estimate, home, ahead: work.path_home(
                (estimate.x_map_m, estimate.y_map_m), home[:2], ahead
            ),
            saved=saved,
        )
    rows = () if waypoints_map_m else field_rows(config.field)
    planner = _planner(config, robot, rows, waypoints_map_m)

    def go_home(estimate: Estimate, home: PoseTuple, _: FloatArray) -> Path:
        start = (estimate.x_map_m, estimate.y_map_m, estimate.yaw_map_rad)
        if not rows:
            return plan_waypoints((home[:2],), start, robot, config.mission)
        path = plan_home(rows, start, home, robot, config.mission)
        certify(path, rows, robot, config.mission.plant_clearance_m)
        return path

    return Mission(planner, rows, config.mission, waypoints_map_m, home=go_home, saved=saved)


def _visiting(
    config: RunConfig,
    robot: RobotSpec,
    waypoints_map_m: tuple[MapPoint, ...],
    work: FieldWork | None,
) -> Callable[[Sequence[MapPoint]], Mission]:
    """A mission over places that somebody names while the robot runs; it spares the same rows."""
    rows = () if waypoints_map_m else field_rows(config.field) if work is None else work.rows
    has_crop = work is None or work.has_crop

    def visiting(points_map_m: Sequence[MapPoint]) -> Mission:
        def plan(estimate: Estimate) -> Path:
            start = (estimate.x_map_m, estimate.y_map_m, estimate.yaw_map_rad)
            path = plan_waypoints(points_map_m, start, robot, config.mission)
            if has_crop:
                certify(path, rows, robot, config.mission.plant_clearance_m)
            return path

        return Mission(plan, (), config.mission, points_map_m)

    return visiting


def _planner(
    config: RunConfig,
    robot: RobotSpec,
    rows: tuple[Row, ...],
    waypoints_map_m: tuple[MapPoint, ...],
) -> Callable[[Estimate], Path]:
    """Plans from where the robot finds itself, and lets no path out that harms a row."""

    def plan(estimate: Estimate) -> Path:
        start = (estimate.x_map_m, estimate.y_map_m, estimate.yaw_map_rad)
        if waypoints_map_m:
            return plan_waypoints(waypoints_map_m, start, robot, config.mission)
        path = plan_rows(rows, start, robot, config.mission)
        certify(path, rows, robot, config.mission.plant_clearance_m)
        return path

    return plan
