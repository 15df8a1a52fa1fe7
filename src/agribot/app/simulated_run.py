"""A run on the simulated robot: its world, its truth, and the referee who judges by it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from agribot.app import whole_job
from agribot.app.run import Run
from agribot.app.run_setup import RunSetup, prepare_run
from agribot.app.run_world import RunWorld, make_run_world
from agribot.app.truth_log import TruthLog
from agribot.app.whole_job import JobSoFar
from agribot.app.world_rows import check_rows
from agribot.autonomy.perception_host import PerceptionHost
from agribot.autonomy.plan.mission.saved_mission import SavedMission
from agribot.autonomy.plan.mission.task import Task
from agribot.autonomy.plan.ways.footprint import measure_footprint
from agribot.autonomy.plan.ways.rows import lay_rows
from agribot.autonomy.stack import Stack
from agribot.core.config import RunConfig
from agribot.core.field_bounds import FieldBounds
from agribot.core.messages import PlantClass, Row, TickRecord, Vec3
from agribot.core.platform import Platform, TrueState
from agribot.core.robot import RobotSpec
from agribot.core.world import WorldSpec
from agribot.record.events import Event
from agribot.record.series import RunData

if TYPE_CHECKING:
    from agribot.sim.faults.layer import FaultLayer
    from agribot.sim.platform import SimPlatform
    from agribot.sim.referee import Referee


class SimulatedRun(Run):
    """`world` is what is simulated, `simulator` what does so, `referee` scores the run by truth."""

    world: WorldSpec
    simulator: SimPlatform
    referee: Referee

    def __init__(self, setup: RunSetup) -> None:
        """Open the simulator and the referee.

        Raises: AgribotError: as `Run`, or the world and the robot do not fit each other.
        """
        from agribot.sim.referee import Referee

        made = make_run_world(setup.config)
        check_rows(made, setup.config)
        self.world = _place_robot(made.world, setup)
        self._drawn = made.conditions
        self.simulator, platform = _open_simulator(
            setup, made.alter_robot(setup.described), self.world
        )
        stack = setup.build_stack()
        task = stack.mission.task
        self.referee = Referee(
            self.simulator,
            self.world,
            tuple(task.rows),
            tuple(task.waypoints),
            _find_bounds(task, setup),
            _choose_row_finder(made, self.world, stack),
            setup.robot,
        )
        if task.explorer is not None:
            self.referee.take_true_rows(lay_rows(setup.config.field))
        if self.simulator.faults is not None:
            stack.perception = self._let_hang(stack.perception, self.simulator.faults)
            platform = _let_stall(platform, self.simulator.faults)
        stack.mask_taps.append(self.referee.judge_mask)
        truth_log = TruthLog(self.simulator, self.world, self._log)
        taps = (self._show_truth, self.referee, truth_log)
        super().__init__(setup, platform, stack, taps, self.referee)

    @property
    def imu_bias(self) -> Callable[[], tuple[Vec3, Vec3]] | None:
        is_elsewhere = bool(self.config.sources.imu)
        return None if is_elsewhere else lambda: self.simulator.imu_bias

    @property
    def truth(self) -> Callable[[], TrueState]:
        return self.simulator.truth

    @property
    def conditions(self) -> dict[str, Any] | None:
        return None if self._drawn is None else msgspec.to_builtins(self._drawn)

    @property
    def warnings(self) -> tuple[str, ...]:
        return (*self.world.warnings, *super().warnings)

    def _let_hang(self, perception: PerceptionHost, layer: FaultLayer) -> PerceptionHost:
        """Put what hangs the network between the stack and the network."""
        faults = [fault for fault in layer.faults if fault.name == "network.hung"]
        if not faults:
            return perception
        from agribot.sim.faults.pictures import HungNetwork

        return HungNetwork(perception, faults, lambda: self.simulator.truth().t_s)

    def _note_faults(self, t_s: float, layer: FaultLayer) -> None:
        """Log what begins and ends; the robot itself gets no notice."""
        for fault, is_on, words in layer.take_changes():
            self.event_log.add(Event(t_s=t_s, kind="injected", reason=words))
            if is_on:
                self.referee.note_fault()
            if fault.name == "disk.full":
                self.recording.fill_disk(is_full=is_on)

    def _show_truth(self, record: TickRecord) -> None:
        if self.task.explorer is not None:
            here = record.estimate
            self.referee.match_rows(self.task.rows, (here.x_map_m, here.y_map_m))
        if self.simulator.faults is not None:
            self._note_faults(record.batch.t_s, self.simulator.faults)
        truth = self.simulator.truth()
        pose = (truth.x_map_m, truth.y_map_m, truth.yaw_map_rad)
        self._series.truth(record.batch.t_s, pose)
        self.recording.truth(record.batch.t_s, pose, (truth.v_mps, truth.yaw_rate_radps))

    def _log(self, event: Event) -> None:
        self.event_log.add(event)

    def _data(self) -> RunData:
        crushed = tuple(sorted(self.referee.crushed))
        return msgspec.structs.replace(super()._data(), world=self.world, crushed=crushed)


def simulate(
    config: RunConfig,
    out_dir: Path,
    saved: SavedMission | None = None,
    earlier: JobSoFar = whole_job.NOTHING,
    plan_text: str = "",
) -> SimulatedRun:
    """Prepare a run and simulate its robot; the arguments are those of `prepare_run`."""
    return SimulatedRun(prepare_run(config, out_dir, saved, earlier, plan_text))


def _open_simulator(
    setup: RunSetup, described: RobotSpec, world: WorldSpec
) -> tuple[SimPlatform, Platform]:
    """Open the simulator, and what the stack drives: it, or real firmware between the two."""
    from agribot.sim.platform import SimPlatform

    if setup.config.platform == "firmware":
        from agribot.app.firmware_platform import open_firmware

        return open_firmware(setup, described, world)
    simulator = SimPlatform(
        setup.config, described, world, board=setup.robot.drive, began_s=setup.earlier.sim_s
    )
    return simulator, simulator


def _choose_row_finder(made: RunWorld, world: WorldSpec, stack: Stack) -> Callable[[Row], Row]:
    """Return what finds the line that a row truly has; who drew one into a plan may have erred."""
    from agribot.sim.row_judge import lay_through_crop

    crop = [(p.x_map_m, p.y_map_m) for p in world.plants if p.plant is PlantClass.CROP]
    crop_xy_m = np.reshape(np.array(crop), (-1, 2))

    def find_true_row(row: Row) -> Row:
        true, task = made.find_true_row(row), stack.mission.task
        is_drawn = task.work is not None and task.has_crop
        return lay_through_crop(true, crop_xy_m) if is_drawn else true

    return find_true_row


def _let_stall(platform: Platform, layer: FaultLayer) -> Platform:
    """Put what stalls the robot's program between the platform and the stack."""
    if not any(fault.name == "program.stalled" for fault in layer.faults):
        return platform
    from agribot.sim.faults.programs import StalledProgram

    return StalledProgram(platform, layer.faults)


def _find_bounds(task: Task, setup: RunSetup) -> FieldBounds | None:
    """Return the field and the robot's rectangle.

    Without a plan the field is the ground that rows, their headland and a turning robot take.
    """
    from agribot.sim.safety_judge import find_boundary

    if task.bounds is not None:
        return task.bounds
    field, mission, implement = setup.config.field, setup.config.mission, setup.robot.implement
    shape = measure_footprint(setup.robot, 0.0 if implement is None else implement.width_m)
    room_m = mission.headland_m + shape.turn_radius_m
    ring = find_boundary(task.rows, field.start_map_m, room_m)
    if ring is None:
        return None
    return FieldBounds(
        rings_map_m=(ring,), front_m=shape.front_m, rear_m=shape.rear_m,
        half_width_m=shape.half_width_m,
    )  # fmt: skip


def _place_robot(world: WorldSpec, setup: RunSetup) -> WorldSpec:
    """Put a robot that goes on where it was left."""
    saved = setup.saved
    if saved is None:
        return world
    return msgspec.structs.replace(
        world, spawn_xy_map_m=saved.pose[:2], spawn_yaw_map_rad=saved.pose[2]
    )
