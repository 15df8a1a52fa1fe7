"""The stack of a run, with the task that its settings give it."""

from __future__ import annotations

from agribot.app.tasks import TasksUnderWay, choose_task
from agribot.autonomy.estimate.filter.stem_map import StemMap
from agribot.autonomy.implements.zones import ZoneMap
from agribot.autonomy.perception_host import PerceptionHost
from agribot.autonomy.plan.coverage.drive import FieldWork
from agribot.autonomy.plan.mission.saved_mission import SavedMission
from agribot.autonomy.planning_host import ThreadedPlanning
from agribot.autonomy.stack import Stack, build
from agribot.core.config import RunConfig
from agribot.core.messages import MapPoint
from agribot.core.plugins import require_plugins
from agribot.core.robot import RobotSpec


def build_stack(
    config: RunConfig,
    robot: RobotSpec,
    waypoints_map_m: tuple[MapPoint, ...] = (),
    perception: PerceptionHost | None = None,
    work: FieldWork | None = None,
    saved: SavedMission | None = None,
    zones: ZoneMap | None = None,
    planning: ThreadedPlanning | None = None,
    plants: StemMap | None = None,
) -> Stack:
    """Build the stack for a task over the rows of the field, or what stands in for them.

    `waypoints_map_m` or `work`, a field plan, replaces the rows; `perception` replaces the camera
    network and `planning` what plans, as a replay does; `saved` is a mission to go on with;
    `zones` is a prescription, `plants` the crop that an earlier run mapped.
    Raises: AgribotError: the settings, the robot and the field do not fit each other.
    """
    require_plugins(config.plugins)
    task = choose_task(config, robot, waypoints_map_m, work)
    under_way = TasksUnderWay(task, config, robot)
    return build(config, robot, task, under_way, perception, saved, zones, planning, plants)
