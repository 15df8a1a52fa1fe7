"""`agribot sim`: the world alone, sensors out and drive commands in, as Gazebo was."""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from agribot.app.run_folder import check_holds_no_run
from agribot.cli.run import bridging, drive_source
from agribot.cli.run.pacing import parse_pace, wait_until
from agribot.cli.run.run_settings import add_setting_arguments, choose_out_dir, read_settings
from agribot.cli.run.world_bridging import open_world_bridges, take_twist
from agribot.cli.stopping import stop_on_signal
from agribot.core.errors import PlatformError
from agribot.core.messages import RobotCommand, SensorBatch
from agribot.core.world import WorldSpec
from agribot.record.report import TimeReport
from agribot.sim.faults.schedule import read_faults, refuse_faults_of
from agribot.sim.truth import Truth

if TYPE_CHECKING:
    from agribot.cli.run.world_bridging import WorldTap
    from agribot.record.world_recorder import WorldRecorder

STACK_PARTS = ("network", "disk")  # faults that only a robot with a stack has
LINE_EVERY_S = 10.0  # period on the clock on the wall


class SimReport(msgspec.Struct, frozen=True, kw_only=True):
    """The result as printed by --json; `distance_m` and `truth` are the simulator's own."""

    ok: bool
    reason: str
    profile: str
    world: str
    robot: str
    sensors: str
    seed: int
    ready_s: float
    time: TimeReport
    samples: dict[str, int]
    distance_m: float
    truth: Truth
    plants_total: int
    plants_crushed: int
    recording: str | None


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_setting_arguments(parser)
    parser.add_argument("--camera", action="store_true", help="render the robot's camera as well")
    driving = parser.add_mutually_exclusive_group()
    driving.add_argument(
        "--drive", metavar="V,YAW_RATE", help="one twist all the time, m/s and rad/s: --drive=0.4,0"
    )
    driving.add_argument(
        "--script", type=Path, metavar="FILE", help="lines T_S V YAW_RATE, each said once"
    )
    driving.add_argument(
        "--stdin", action="store_true", help="lines V YAW_RATE as they arrive on stdin"
    )
    parser.add_argument(
        "--hold",
        action="store_true",
        help="say every line again until the next; without it the motor board's timeout stops",
    )
    parser.add_argument(
        "--speed", default="1", metavar="max|K", help="K x real time (default: 1), or all it can"
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="default: runs/<UTC time>-sim")
    parser.add_argument("--json", action="store_true", help="print the result as the last line")
    bridging.add_arguments(parser, has_stack=False)
    parser.add_argument(
        "--perfect-map",
        action="store_true",
        help="publish map -> odom as well, from the truth, as a localizer without errors would",
    )


class _World:
    """The simulated world and its counts; `report` may be called at any time."""

    def __init__(self, options: argparse.Namespace) -> None:
        from agribot.app.robot_of_run import load_robot_of_run
        from agribot.app.run_clock import Clock
        from agribot.app.run_world import make_run_world
        from agribot.sim.platform import SimPlatform

        self._started_s = time.monotonic()
        camera = f"perception.enabled={str(options.camera).lower()}"
        self.config = read_settings(options, before=[camera])
        refuse_faults_of(
            STACK_PARTS, read_faults(self.config), "agribot sim runs no stack; leave it out"
        )
        self.robot = load_robot_of_run(self.config)
        made = make_run_world(self.config)
        self.world: WorldSpec = made.world
        self.platform = SimPlatform(self.config, made.alter_robot(self.robot), self.world)
        self.recorder = self._recorder(options.out) if self.config.record.enabled else None
        self.taps: list[WorldTap] = [] if self.recorder is None else [self.recorder]
        self.clock = Clock()
        self.samples: Counter[str] = Counter()
        self.distance_m = 0.0
        self.truth = self.platform.truth()
        self.ready_s = time.monotonic() - self._started_s

    def tick(self, source: drive_source.DriveSource) -> SensorBatch:
        """Simulate one tick.

        Raises: PlatformError: the robot overturned or the physics diverged.
        """
        from agribot.ros.messages.world_topic_writer import WorldTick

        batch = self.platform.read()
        command = take_twist(batch.hand) or source.at(batch.t_s)
        if command is not None:
            self.platform.write(RobotCommand(t_s=batch.t_s, drive=command))
        before, self.truth = self.truth, self.platform.truth()
        truth = self.truth
        self.distance_m += math.hypot(
            truth.x_map_m - before.x_map_m, truth.y_map_m - before.y_map_m
        )
        for field in batch.__struct_fields__[1:]:
            self.samples[field] += len(getattr(batch, field))
        pose = (truth.x_map_m, truth.y_map_m, truth.yaw_map_rad)
        twist = (truth.v_mps, truth.yaw_rate_radps)
        tick = WorldTick(batch, command, pose, twist, self.platform.imu_bias)
        for tap in self.taps:
            tap(tick)
        return batch

    def close(self) -> None:
        self.platform.close()
        if self.recorder is not None:
            self.recorder.close()

    def report(self, fault: str) -> SimReport:
        sim_s, clock, config = self.truth.t_s, self.clock, self.config
        rtf_cpu = sim_s / clock.cpu_s if clock.cpu_s else None
        return SimReport(
            ok=not fault,
            reason=fault or "ran as asked",
            profile=config.profile,
            world=self.world.name,
            robot=self.robot.name,
            sensors=config.sim.sensors,
            seed=config.seed,
            ready_s=self.ready_s,
            time=TimeReport(sim_s=sim_s, wall_s=clock.wall_s, cpu_s=clock.cpu_s, rtf_cpu=rtf_cpu),
            samples={name: count for name, count in self.samples.items() if count},
            distance_m=self.distance_m,
            truth=self.truth,
            plants_total=len(self.world.plants),
            plants_crushed=len(self.platform.crushed),
            recording=None if self.recorder is None else str(self.recorder.path),
        )

    def _recorder(self, wanted: Path | None) -> WorldRecorder:
        from agribot.description.loader import export_urdf
        from agribot.record.world_recorder import WorldRecorder

        out_dir = choose_out_dir(wanted, "sim")
        check_holds_no_run(out_dir)
        return WorldRecorder(
            out_dir / "run.mcap", self.config, self.robot, export_urdf(self.config.robot)
        )


def run(options: argparse.Namespace) -> int:
    pace = parse_pace(options.speed)
    source = _make_source(options)
    bridging.check_bridges(options)
    world = _World(options)
    odd = (*world.robot.warnings, *world.world.warnings)
    sys.stderr.writelines(f"warning: {warning}\n" for warning in odd)
    sys.stderr.write(f"ready in {world.ready_s:.1f} s: {world.robot.name} in {world.world.name}\n")
    is_free = isinstance(source, drive_source.NoTwist)
    try:
        with open_world_bridges(
            options, world.platform, world.robot, world.config, is_free
        ) as taps:
            world.taps.extend(taps)
            fault, stopped = _run(world, source, pace)
    finally:
        world.close()
    report = world.report(fault)
    sys.stderr.write(_format_report(report))
    if options.json:
        sys.stdout.write(msgspec.json.encode(report).decode() + "\n")
    if stopped:
        return 130
    return 0 if report.ok else 1


def _run(world: _World, source: drive_source.DriveSource, pace: float) -> tuple[str, bool]:
    """Tick until the time is over; return a fault in words, and whether somebody stopped it."""
    limit_s = world.config.duration_s or math.inf
    started_s, next_line_s = time.monotonic(), 0.0
    world.clock.start()
    try:
        with stop_on_signal() as stop:
            while not stop and world.truth.t_s < limit_s:
                batch = world.tick(source)
                wait_until(started_s + batch.t_s / pace)
                if time.monotonic() - started_s >= next_line_s:
                    next_line_s += LINE_EVERY_S
                    sys.stderr.write(_format_line(world.truth))
        return "", bool(stop)
    except PlatformError as error:
        return str(error), False
    finally:
        world.clock.stop()


def _make_source(options: argparse.Namespace) -> drive_source.DriveSource:
    if options.drive is not None:
        return drive_source.parse_constant(options.drive)
    if options.script is not None:
        return drive_source.read_script(options.script, hold=options.hold)
    if options.stdin:
        return drive_source.LiveTwists(sys.stdin, sys.stderr, hold=options.hold)
    return drive_source.NoTwist()


def _format_line(truth: Truth) -> str:
    return (
        f"{truth.t_s:7.1f} s  x {truth.x_map_m:+7.2f} m  y {truth.y_map_m:+7.2f} m  "
        f"yaw {math.degrees(truth.yaw_map_rad):+6.1f} deg  {truth.v_mps:+5.2f} m/s\n"
    )


def _format_report(report: SimReport) -> str:
    counts = ", ".join(f"{name} {count}" for name, count in report.samples.items())
    spent = report.time
    speed = "" if spent.rtf_cpu is None else f", {spent.rtf_cpu:.3g} x real time per CPU second"
    return (
        f"{'OK' if report.ok else 'NOT OK'}: {report.reason}\n"
        f"  {report.distance_m:.3g} m driven in {spent.sim_s:.3g} s{speed}\n"
        f"  samples: {counts}\n"
        f"  {report.recording or 'nothing was recorded'}\n"
    )
