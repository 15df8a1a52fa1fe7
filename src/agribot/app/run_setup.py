"""What a run begins with, read and checked before anything may move."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import NamedTuple

import msgspec

from agribot.app import whole_job
from agribot.app.calibration.measured_robot import apply_calibration
from agribot.app.declination import settle_declination
from agribot.app.field_work import read_field_work, read_plan_text
from agribot.app.keep_out import settle_keep_out
from agribot.app.known_plants import read_plant_file, read_plants
from agribot.app.prescribed_zones import read_prescription_file, read_zones
from agribot.app.robot_of_run import load_robot_of_run
from agribot.app.robot_stack import build_stack
from agribot.app.run_world import settle_origin
from agribot.app.tasks import read_goals
from agribot.app.whole_job import JobSoFar
from agribot.app.world_rows import take_world_rows
from agribot.autonomy.plan.coverage.drive import FieldWork
from agribot.autonomy.plan.mission.saved_mission import SavedMission
from agribot.autonomy.stack import Stack
from agribot.core.config import RunConfig
from agribot.core.messages import MapPoint
from agribot.core.platforms import list_must_report
from agribot.core.robot import RobotSpec

PLAN_FILE = "plan.geojson"


class RunSetup(NamedTuple):
    """Settings, robot and task of a run, and what earlier runs of the same job left.

    `described` is the robot as its description says, `robot` the same as calibration corrects it.
    `plan_text` is the field plan, empty without one; `is_plan_new` where it is in no file yet.
    `prescription` is the file of that name, `plants` the crop of an earlier run, empty without.
    """

    config: RunConfig
    out_dir: Path
    described: RobotSpec
    robot: RobotSpec
    goals_map_m: tuple[MapPoint, ...]
    plan_text: str
    is_plan_new: bool
    work: FieldWork | None
    saved: SavedMission | None
    earlier: JobSoFar
    prescription: bytes
    plants: bytes
    notes: tuple[str, ...] = ()  # sources of settings that the user did not give
    warnings: tuple[str, ...] = ()  # doubtful settings

    def build_stack(self) -> Stack:
        """Build the stack.

        Raises: AgribotError: settings, robot and task do not fit each other.
        """
        zones = read_zones(self.prescription, self.config, self.work)
        return build_stack(
            self.config, self.robot, self.goals_map_m, None, self.work, self.saved, zones,
            plants=read_plants(self.plants),
        )  # fmt: skip


def prepare_run(
    config: RunConfig,
    out_dir: Path,
    saved: SavedMission | None = None,
    earlier: JobSoFar = whole_job.NOTHING,
    plan_text: str = "",
) -> RunSetup:
    """Read all that the settings of a run name.

    `saved` is a mission to go on with, `earlier` what the runs before did of the job; the report
    then covers all of it. `plan_text` is a field plan that is in no file yet: the run keeps it in
    its folder.

    Raises: AgribotError: something in the settings or on the disk does not fit.
    """
    if plan_text:
        config = msgspec.structs.replace(config, plan=str(out_dir / PLAN_FILE))
    config = settle_keep_out(settle_origin(take_world_rows(_settle_inputs(config))))
    described = load_robot_of_run(config)
    config, notes, warnings = settle_declination(config, described, datetime.date.today())
    if config.faults:
        from agribot.sim.faults.schedule import read_faults

        read_faults(config, has_camera=described.camera is not None, began_s=earlier.sim_s)
    robot = apply_calibration(described, config.calibration)
    text = plan_text or read_plan_text(config)
    return RunSetup(
        config=config,
        out_dir=out_dir,
        described=described,
        robot=robot,
        goals_map_m=read_goals(config),
        plan_text=text,
        is_plan_new=bool(plan_text),
        work=read_field_work(text, config, robot),
        saved=saved,
        earlier=earlier,
        prescription=read_prescription_file(config),
        plants=read_plant_file(config),
        notes=notes,
        warnings=warnings,
    )


def _settle_inputs(config: RunConfig) -> RunConfig:
    """Let the platform say which safety inputs the robot must have, where the settings do not."""
    if config.safety.must_report is not None:
        return config
    must_report = list_must_report(config.platform)
    safety = msgspec.structs.replace(config.safety, must_report=must_report)
    return msgspec.structs.replace(config, safety=safety)
